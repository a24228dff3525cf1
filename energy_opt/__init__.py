"""Joint moves of robot arms to minimum energy, and power models calibrated from measured data.

    import energy_opt as eo

    robot = eo.load_robot("panda")
    model = eo.source_model(robot) + eo.CoulombFriction(tau_c=0.3)
    result = eo.optimize(robot, model, start=[...], goal=[...], duration=2.0)

All names are looked up when they are first used, so that importing the package is fast. Where to look behind them:
`effects` (what uses energy, one class each), `power` (the model that joins them), `robot` and `dynamics` (the arm),
`motion` (optimization of one move), `tradeoff` and `bench` (many of them), `measured` and `diagnose` (logged data),
`virtual_arm` (data without hardware), `front` (what is offered here), `cli` (the command line).
"""

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:  # what editors and type checkers see; at run time `_PLACES` says where things are
    from energy_opt.effects import *  # noqa: F403
    from energy_opt.effects.check import check_effect as check_effect
    from energy_opt.errors import BadInput as BadInput
    from energy_opt.errors import EnergyOptError as EnergyOptError
    from energy_opt.errors import Infeasible as Infeasible
    from energy_opt.front.answer import Answer as Answer
    from energy_opt.front.data import diagnose as diagnose
    from energy_opt.front.data import identify as identify
    from energy_opt.front.evaluating import evaluate as evaluate
    from energy_opt.front.given import source_model as source_model
    from energy_opt.front.placing import place as place
    from energy_opt.front.planning import bench as bench
    from energy_opt.front.planning import optimize as optimize
    from energy_opt.front.tradeoff import Tradeoff as Tradeoff
    from energy_opt.front.tradeoff import tradeoff as tradeoff
    from energy_opt.motion import Move as Move
    from energy_opt.motion import Planner as Planner
    from energy_opt.motion import Result as Result
    from energy_opt.motion import Settings as Settings
    from energy_opt.motion import Trajectory as Trajectory
    from energy_opt.passport import Passport as Passport
    from energy_opt.passport import PassportRequest as PassportRequest
    from energy_opt.passport import passport as passport
    from energy_opt.place import PlaceRequest as PlaceRequest
    from energy_opt.poses import AnyOf as AnyOf
    from energy_opt.poses import Pose as Pose
    from energy_opt.poses import pose_from as pose_from
    from energy_opt.power import PowerModel as PowerModel
    from energy_opt.power import load_model as load_model
    from energy_opt.robot import Robot as Robot
    from energy_opt.robot import known_robots as known_robots
    from energy_opt.robot import load_robot as load_robot

_PLACES = {
    "energy_opt.errors": ("BadInput", "EnergyOptError", "Infeasible"),
    "energy_opt.robot": ("Robot", "known_robots", "load_robot"),
    "energy_opt.place": ("PlaceRequest",),
    "energy_opt.poses": ("AnyOf", "Pose", "pose_from"),
    "energy_opt.power": ("PowerModel", "load_model"),
    "energy_opt.motion": ("Move", "Planner", "Result", "Settings", "Trajectory"),
    "energy_opt.passport": ("Passport", "PassportRequest", "passport"),
    "energy_opt.front.given": ("source_model",),
    "energy_opt.front.evaluating": ("evaluate",),
    "energy_opt.front.answer": ("Answer",),
    "energy_opt.front.placing": ("place",),
    "energy_opt.front.planning": ("bench", "optimize"),
    "energy_opt.front.tradeoff": ("Tradeoff", "tradeoff"),
    "energy_opt.front.data": ("diagnose", "identify"),
    "energy_opt.effects.check": ("check_effect",),
    "energy_opt.power.per_year": ("PerYear",),
}
_PLACE_OF = {name: place for place, names in _PLACES.items() for name in names}
_EFFECTS = "energy_opt.effects"  # every other name is looked for among the effects


def __getattr__(name: str) -> Any:
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(_PLACE_OF.get(name, _EFFECTS)), name, None)
    if found is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return found


def __dir__() -> list[str]:
    return sorted([*_PLACE_OF, *importlib.import_module(_EFFECTS).__all__, "__version__"])


class _Verb(ModuleType):
    """A package that bears a verb's name: it can be called as the verb, and its contents are still there."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        verb = self.__name__.rpartition(".")[2]
        return getattr(importlib.import_module(_PLACE_OF[verb]), verb)(*arguments, **named)


class _Package(ModuleType):
    """This package: importing `energy_opt.tradeoff` must not hide the verb `tradeoff` behind a module."""

    def __setattr__(self, name: str, value: object) -> None:
        if isinstance(value, ModuleType) and name in _PLACE_OF:
            value.__class__ = _Verb
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
