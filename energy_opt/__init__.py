"""Joint moves of robot arms to minimum energy, and power models calibrated from measured data.

    import energy_opt as eo

    robot = eo.load_robot("panda")
    model = eo.source_model(robot) + eo.effects.CoulombFriction(tau_c=0.3)
    result = eo.optimize(robot, model, start=[...], goal=[...], duration=2.0)

Names are looked up when they are first used, so that importing the package is fast. Effects are under `eo.effects`,
conditions under `eo.conditions`. docs/architecture.md lists the packages that define them.
"""

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:  # for editors and type checkers; at run time `_PLACES` has the places
    from energy_opt import conditions as conditions
    from energy_opt import effects as effects
    from energy_opt.cell.scene_files import read_scene as load_scene
    from energy_opt.errors import BadInput as BadInput
    from energy_opt.errors import EnergyOptError as EnergyOptError
    from energy_opt.errors import Infeasible as Infeasible
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
    from energy_opt.front.simulate import simulate as simulate
    from energy_opt.front.tradeoff import tradeoff as tradeoff
    from energy_opt.front.verbs import repeat as repeat
    from energy_opt.motion import Planner as Planner
    from energy_opt.motion import Result as Result
    from energy_opt.motion import Trajectory as Trajectory
    from energy_opt.poses import AnyOf as AnyOf
    from energy_opt.poses import pose_from as pose_from
    from energy_opt.power import PowerModel as PowerModel
    from energy_opt.power import load_model as load_model
    from energy_opt.robot import Robot as Robot
    from energy_opt.robot import load_robot as load_robot

__all__ = [
    "AnyOf", "BadInput", "EnergyOptError", "Infeasible", "Planner", "PowerModel", "Result", "Robot", "Trajectory",
    "bench", "check", "conditions", "diagnose", "effects", "evaluate", "identify", "import_logs", "job", "load_model",
    "load_robot", "load_scene", "optimize", "passport", "place", "pose_from", "repeat", "robots", "simulate",
    "source_model", "tradeoff",
]  # fmt: skip

_VERBS = (
    "bench", "check", "diagnose", "evaluate", "identify", "job", "optimize", "passport", "place", "robots", "simulate",
    "tradeoff",
)  # fmt: skip
_PLACES = {
    **{name: f"energy_opt.front.{name}" for name in _VERBS},
    **dict.fromkeys(("BadInput", "EnergyOptError", "Infeasible"), "energy_opt.errors"),
    **dict.fromkeys(("Robot", "load_robot"), "energy_opt.robot"),
    **dict.fromkeys(("AnyOf", "pose_from"), "energy_opt.poses"),
    **dict.fromkeys(("PowerModel", "load_model"), "energy_opt.power"),
    **dict.fromkeys(("Planner", "Result", "Trajectory"), "energy_opt.motion"),
    "import_logs": "energy_opt.front.importing",
    "load_scene": "energy_opt.cell.scene_files",
    "repeat": "energy_opt.front.verbs",
    "source_model": "energy_opt.front.given",
}
_OWN_NAMES = {"load_scene": "read_scene"}
# Names of version 0.1 that are kept for one version; effects are kept, too.
_EARLIER = {
    **dict.fromkeys(("Move", "Settings"), "energy_opt.motion"),
    "Answer": "energy_opt.front.optimize",
    "PerYear": "energy_opt.power.per_year",
    "Pose": "energy_opt.poses",
    "Tradeoff": "energy_opt.front.tradeoff",
    "check_effect": "energy_opt.effects.check",
    "known_robots": "energy_opt.robot",
}


def __getattr__(name: str) -> Any:
    if name in ("conditions", "effects"):
        return importlib.import_module(f"energy_opt.{name}")
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    place = _PLACES.get(name) or _EARLIER.get(name, "energy_opt.effects")
    found = getattr(importlib.import_module(place), _OWN_NAMES.get(name, name), None)
    if found is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
