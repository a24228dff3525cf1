"""Joint moves of robot arms to minimum energy, and power models calibrated from measured data.

    import energy_opt as eo

    robot = eo.load_robot("panda")
    model = eo.source_model(robot) + eo.effects.CoulombFriction(tau_c=0.3)
    result = eo.optimize(robot, model, start=[...], goal=[...], duration=2.0)

All names are looked up when they are first used, so that importing the package is fast. Effects are under
`eo.effects`. Where to look behind the names: docs/architecture.md.
"""

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:  # what editors and type checkers see; at run time `_PLACES` says where things are
    from energy_opt import conditions as conditions
    from energy_opt import effects as effects
    from energy_opt.effects import *  # noqa: F403
    from energy_opt.errors import BadInput as BadInput
    from energy_opt.errors import EnergyOptError as EnergyOptError
    from energy_opt.errors import Infeasible as Infeasible
    from energy_opt.front.answer import Answer as Answer
    from energy_opt.front.bench import bench as bench
    from energy_opt.front.check import check as check
    from energy_opt.front.diagnose import diagnose as diagnose
    from energy_opt.front.evaluate import evaluate as evaluate
    from energy_opt.front.given import source_model as source_model
    from energy_opt.front.identify import identify as identify
    from energy_opt.front.importing import import_logs as import_logs
    from energy_opt.front.job import job as job
    from energy_opt.front.optimize import optimize as optimize
    from energy_opt.front.passport import passport as passport
    from energy_opt.front.place import place as place
    from energy_opt.front.robots import robots as robots
    from energy_opt.front.run import repeat as repeat
    from energy_opt.front.simulate import simulate as simulate
    from energy_opt.front.tradeoff import Tradeoff as Tradeoff
    from energy_opt.front.tradeoff import tradeoff as tradeoff
    from energy_opt.motion import Move as Move
    from energy_opt.motion import Planner as Planner
    from energy_opt.motion import Settings as Settings
    from energy_opt.motion import Trajectory as Trajectory
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
    "energy_opt.poses": ("AnyOf", "Pose", "pose_from"),
    "energy_opt.power": ("PowerModel", "load_model"),
    "energy_opt.motion": ("Move", "Planner", "Settings", "Trajectory"),
    "energy_opt.front.given": ("source_model",),
    "energy_opt.effects.check": ("check_effect",),
    "energy_opt.power.per_year": ("PerYear",),
    **{
        f"energy_opt.front.{verb}": (verb,)
        for verb in (
            "bench",
            "check",
            "diagnose",
            "evaluate",
            "identify",
            "job",
            "optimize",
            "passport",
            "place",
            "simulate",
        )
    },
    "energy_opt.front.tradeoff": ("Tradeoff", "tradeoff"),
    "energy_opt.front.importing": ("import_logs",),
    "energy_opt.front.answer": ("Answer",),
    "energy_opt.front.run": ("repeat",),
}
_PLACE_OF = {name: place for place, names in _PLACES.items() for name in names}
_EFFECTS = "energy_opt.effects"  # every other name is looked for among the effects


def __getattr__(name: str) -> Any:
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name in ("conditions", "effects"):
        return importlib.import_module(f"energy_opt.{name}")
    found = getattr(importlib.import_module(_PLACE_OF.get(name, _EFFECTS)), name, None)
    if found is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return found


def __dir__() -> list[str]:
    return sorted([*_PLACE_OF, "conditions", "effects", *importlib.import_module(_EFFECTS).__all__, "__version__"])


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
