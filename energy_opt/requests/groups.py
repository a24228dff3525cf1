"""Options that several verbs share, each group defined once; a verb's request is made of them.

Values may be given as the command line spells them (`"0,1,0"`, `"1.5,0,0,0.1"`) or as Python has them (lists, arrays).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

from energy_opt.errors import BadInput
from energy_opt.files import finite_number, words_of
from energy_opt.requests.option import Request, option

if TYPE_CHECKING:
    import numpy as np

    from energy_opt.cell.request import CellRequest
    from energy_opt.conditions import Condition, Limit
    from energy_opt.effects import Payload
    from energy_opt.motion.result import Result
    from energy_opt.motion.trajectory import Trajectory
    from energy_opt.poses.pose import AnyOf, Pose
    from energy_opt.power import PowerModel
    from energy_opt.power.per_year import PerYear
    from energy_opt.robot import Robot

    AnyRobot = Robot | str | PathLike[str]
    AnyModel = PowerModel | str | PathLike[str] | Mapping[str, Any]
    Vector = Sequence[float] | np.ndarray
    Positions = Vector | Mapping[str, float] | str
    AnyPayload = float | Sequence[float] | Payload | Mapping[str, Any] | str
    Motion = Trajectory | Result
    AnyPath = Motion | Callable[[Any], Vector] | Sequence[Vector] | np.ndarray | Mapping[str, Any] | str | PathLike[str]
    AnyPose = Pose | Vector | Sequence[Vector] | Mapping[str, Any] | str

ROBOT = "a name (`energy-opt robots`) or a URDF"
MODEL = "power model: a file, or source-method-1, source-method-2, careful"


def numbers_of(given: Any, count: int, flag: str, expected: str) -> tuple[float, ...]:
    """Finite numbers from words (`words_of`) or any sequence.

    Args:
        given: words or numbers. count: how many there must be. flag: the option, and expected: its form, for messages.

    Raises:
        BadInput: another count, or something that is no number.
    """
    listed = given if hasattr(given, "__iter__") else [given]
    words = words_of(given) if isinstance(given, str) else [f"{x}" for x in listed]
    shown = given if isinstance(given, str) else ",".join(words)
    numbers = tuple(finite_number(word, f"{flag} {shown}", expected) for word in words)
    if len(numbers) != count:
        raise BadInput(f"{flag} {shown}: {len(numbers)} numbers; expected {expected}")
    return numbers


@dataclass(frozen=True, kw_only=True)
class RobotGroup(Request):
    """robot and model"""

    limits: str | PathLike[str] | None = option(
        None, "joint limits in MoveIt's joint_limits.yaml (published ones, else the URDF's)", "FILE", main=True
    )
    lock: Mapping[str, float] | Sequence[str] = option(
        (), "hold a joint at a position [rad, m] (repeatable)", "JOINT=VALUE[,…]", many=True
    )

    def __post_init__(self) -> None:
        if hasattr(self.lock, "items"):
            words = tuple(f"{joint}={value}" for joint, value in self.lock.items())
            object.__setattr__(self, "lock", words)
        super().__post_init__()

    def document(self) -> dict[str, Any]:
        """See `Request.document`; locked joints by name."""
        return super().document() | ({"lock": self.locked} if self.lock else {})

    @property
    def locked(self) -> dict[str, float]:
        """The joints that `lock` holds, and their positions [rad, m]."""
        out = {}
        for word in (part for words in self.lock for part in str(words).split(",")):
            joint, _, value = word.partition("=")
            out[joint] = finite_number(value, f"--lock {word}", "JOINT=VALUE")
        return out


@dataclass(frozen=True, kw_only=True)
class PrefixGroup(Request):
    """robot and model"""

    joint_prefix: str = option("", "the joint names in files have this prefix (none)", "PREFIX")


@dataclass(frozen=True, kw_only=True)
class PayloadGroup(Request):
    """robot and model"""

    payload: AnyPayload | None = option(
        None, "point mass [kg] and its position in the last joint's frame [m] (none)", "MASS[,CX,CY,CZ]", main=True
    )


@dataclass(frozen=True, kw_only=True)
class RobustGroup(Request):
    """several models"""

    robust: str | Mapping[str, Any] | None = option(
        None,
        "mean or worst: which energy of several models to minimise (mean); with one model: of draws from its "
        "covariance and of its rival models (neither)", "KIND",
    )  # fmt: skip

    def document(self) -> dict[str, Any]:
        """See `Request.document`; several models are in `robust`.

        `model` is the name of the first model, under which results are stated. Only named documents are written so.
        """
        found, models = super().document(), getattr(self, "model", None)
        if not models or not all(isinstance(model, Mapping) for model in models):
            return found
        first = {key: value for key, value in models[0].items() if key != "name"}
        kind = found.get("robust")
        robust = None if kind is None else {"kind": kind, "models": [dict(model) for model in models]}
        return found | {"model": first, "model_name": models[0].get("name"), "robust": robust}

    @classmethod
    def read(cls, given: dict[str, Any]) -> dict[str, Any]:
        """The inverse of `document`: `model` holds all models, and `robust` is the kind."""
        given = super().read(given)
        name, robust = given.pop("model_name", None), given.get("robust")
        if isinstance(robust, Mapping):
            return given | {"model": robust.get("models"), "robust": robust.get("kind")}
        if isinstance(model := given.get("model"), Mapping):
            given["model"] = [{**model, **({} if name is None else {"name": name})}]
        return given


@dataclass(frozen=True, kw_only=True)
class MoveGroup(Request):
    """move"""

    start: Positions | Pose | None = option(
        None, "joint positions [rad, m]: comma-separated, name=value pairs, or a pose's name in the SRDF", "Q",
        main=True,
    )  # fmt: skip
    goal: Positions | Pose | AnyOf | None = option(
        None, "joint positions at the end (repeatable: the goal of least energy is taken)", "Q", several=True, main=True
    )
    path: AnyPath | None = option(
        None, "waypoints [rad, m] or a trajectory, in place of --start and --goal", "FILE", main=True
    )
    via: Sequence[Positions | Pose] = option(
        (), "joint positions to pass, within 1e-4 rad or m (with --mode reshape; repeatable)", "Q", many=True
    )
    mode: str = option(
        "reshape", "reshape: optimize path and timing; retime: timing alone (reshape)", "MODE", main=True
    )


@dataclass(frozen=True, kw_only=True)
class PoseGroup(Request):
    """poses of the tool (--tool) in the robot's base frame"""

    start_pose: AnyPose | None = option(
        None,
        "pose of the tool, in place of --start: X,Y,Z,R,P,Y or X,Y,Z,QX,QY,QZ,QW [m, rad]; with `OBJECT: ` before it "
        "in that object's frame; or the name of a pose in the scene file; or a file FILE.yaml", "POSE",
    )  # fmt: skip
    goal_pose: AnyPose | Sequence[AnyPose] | None = option(
        None, "pose of the tool at the goal, reached by the cheapest joint positions; if it is given several "
        "times, the cheapest one is taken", "POSE", several=True, main=True,
    )  # fmt: skip
    via_pose: Sequence[AnyPose] = option((), "pose to pass (with --mode reshape; repeatable)", "POSE", many=True)
    free: Sequence[str] = option(
        (), "axis x, y, z, rx, ry or rz of the tool's frame that is free at goal and via poses, in a range [mm, deg] "
        "(repeatable)", "AXIS[:FROM:TO]", many=True,
    )  # fmt: skip
    pose_tolerance: str | Sequence[float] | None = option(
        None, "largest distance and angle from the poses (1e-6 m, 1e-6 rad)", "1mm,1deg"
    )


@dataclass(frozen=True, kw_only=True)
class ConditionGroup(Request):
    """conditions"""

    max_power: float | None = option(None, "largest electrical power of the arm [W] (none)", "W")
    tool_speed: float | None = option(None, "largest speed of the tool's origin [m/s] (none)", "V")
    tool_acceleration: float | None = option(None, "largest acceleration of the tool's origin [m/s^2] (none)", "A")
    keep: str | Sequence[str] = option(
        (), "keep the tool upright[:DEG] (5), in its start orientation[:DEG] (2), or on a line[:MM] (1) (repeatable)",
        "WHAT", many=True,
    )  # fmt: skip
    tube: str | None = option(None, "largest distance from --path: 0.1rad (each joint) or 0.02m (tool) (none)", "WIDTH")
    conditions: Sequence[Condition | Limit | str | PathLike[str]] = option(
        (), "Python file that defines your own limits (repeatable)", "FILE.py", many=True
    )
    own_limits: Sequence[Limit] = option((), "set by `conditions`, not given", internal=True, written=False, many=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "keep", tuple(part for word in self.keep for part in word.split(",")))
        if self.conditions and not self.own_limits:
            from energy_opt.conditions import options_and_limits

            options, limits = options_and_limits(self.conditions)
            for name, value in options.items():
                held = getattr(self, name)
                if held not in (None, (), value) and name != "keep":
                    raise BadInput(f"--{name.replace('_', '-')} is given twice, as an option and as a condition")
                merged = tuple(dict.fromkeys((*held, *value))) if name == "keep" else value
                object.__setattr__(self, name, merged)
            object.__setattr__(self, "own_limits", limits)
            kept = (each for each in self.conditions if isinstance(each, (str, PathLike)) or each in limits)
            object.__setattr__(self, "conditions", tuple(kept))
            super().__post_init__()  # the options of the conditions are checked, too


@dataclass(frozen=True, kw_only=True)
class SolvingGroup(Request):
    """solving"""

    solver: str = option(
        "ipopt", "sqp: sequential quadratic programming; ipopt: then also IPOPT if it has not converged (ipopt)", "NAME"
    )
    starts: int | None = option(None, "largest number of starting points with --mode reshape (24)", "N")
    initial_paths: int | None = option(
        None, "number of collision-free initial paths to find (1, or 2 if little is saved; 0 for a free --path)", "N",
        aliases=("--ways",),
    )  # fmt: skip
    controls: int | None = option(None, "control points per joint with --mode reshape (48)", "N")
    end_acceleration: str = option("zero", "ends' acceleration: zero (not at free durations) or free (zero)", "KIND")
    compile: str = option("auto", "compile the model's functions to machine code: auto, always or never (auto)", "WHEN")
    objective: str = option("energy", "minimise energy, torque, power_squared, path_length or time (energy)", "NAME")
    verify_samples: int | None = option(
        None, "least number of samples of the certificate (10 between two samples of the trajectory)", "N"
    )
    dynamics: str = option(
        "auto", "symbolic dynamics: compact (this package's), pinocchio (its CasADi build) or auto (auto)", "SOURCE"
    )


@dataclass(frozen=True, kw_only=True)
class SeedGroup(Request):
    """output"""

    seed: int = option(0, "seed of all random choices (0)", "N")


@dataclass(frozen=True, kw_only=True)
class DeadlineGroup(Request):
    """solving"""

    deadline: float | None = option(
        None, "after S seconds, end the search for each motion and take its best proven answer (never)", "S"
    )


@dataclass(frozen=True, kw_only=True)
class CellGroup(Request):
    """body and cell"""

    self_collision: bool | None = option(True, "keep the arm clear of itself (on)", "on|off")
    srdf: str | PathLike[str] | None = option(None, "SRDF: pairs of links that may touch (a known robot's own)", "FILE")
    package_dir: Sequence[str | PathLike[str]] = option(
        (), "folder of the packages in package:// names", "DIR", many=True
    )
    scene: str | PathLike[str] | None = option(
        None, "scene: MoveIt PlanningScene, .scene text, or short YAML (none)", "FILE", main=True
    )
    base: str | Sequence[float] | None = option(
        None, "pose of the robot's base in the scene's frame [m, rad] (the scene's frame itself)", "X,Y,Z,R,P,Y"
    )
    floor: float | None = option(None, "height of a floor in the scene's frame [m], solid below (none)", "Z", main=True)
    clearance: float | None = option(
        None, "smallest distance from all bodies [m] (0.002; half of an end's if that is less)", "M"
    )
    tool: str | None = option(None, "a frame, and the tool's pose in it [m, rad] (last joint)", "FRAME[,X,Y,Z[,R,P,Y]]")
    payload_size: str | Sequence[float] | None = option(
        None, "edges of a box around the payload's centre of mass [m] (the payload is a point)", "X,Y,Z"
    )
    planner: str | None = option("auto", "planner of the initial path; not used by this verb", "NAME", hidden=True)
    allow_outside: bool = option(False, "allow a file to name files outside of its own folder")
    allow_large: bool = option(False, "also read files and meshes above the usual size limits")
    cell: CellRequest | None = option(None, "all options of body and cell as one object", internal=True, written=False)

    def __post_init__(self) -> None:
        if self.cell is not None:
            for name, value in vars(self.cell).items():
                mine = {"package_dirs": "package_dir"}.get(name, name)
                if hasattr(self, mine) and value != getattr(type(self.cell), name, None):
                    object.__setattr__(self, mine, value)
            object.__setattr__(self, "cell", None)
        super().__post_init__()
        if self.base is not None:
            base = numbers_of(self.base, 6, "--base", "X,Y,Z [m] and R,P,Y [rad]")
            object.__setattr__(self, "base", base)
        if self.payload_size is not None:
            size = numbers_of(self.payload_size, 3, "--payload-size", "three edges X,Y,Z [m]")
            object.__setattr__(self, "payload_size", size)


@dataclass(frozen=True, kw_only=True)
class PlannedCellGroup(CellGroup):
    """body and cell"""

    planner: str | None = option("auto", "planner of the initial path: auto, none or ompl (auto)", "NAME")


@dataclass(frozen=True, kw_only=True)
class WriteGroup(Request):
    """for controllers"""

    write: Sequence[str] = option(
        (), "also write the motion as csv, yaml, json, mcap, follow-joint-trajectory, urscript or franka (repeatable)",
        "FORMAT", many=True, main=True,
    )  # fmt: skip
    rate: float | None = option(
        None, "samples per second of --write [Hz] (franka: 1000; urscript: chosen; else the judged samples)", "HZ"
    )


@dataclass(frozen=True, kw_only=True)
class WorthGroup(Request):
    """saving in a year"""

    cycles_per_year: float | None = option(None, "cycles in a year: also state the saving in a year", "N")
    price: float | None = option(None, "price of one kWh, in any currency", "PER_KWH")
    co2: float | None = option(None, "carbon dioxide of one kWh [kg]", "KG_PER_KWH")
    per_year: PerYear | None = option(None, "cycles_per_year, price, co2 as one PerYear", internal=True, written=False)

    def __post_init__(self) -> None:
        if self.per_year is not None:
            for name, value in vars(self.per_year).items():
                object.__setattr__(self, name, value)
            object.__setattr__(self, "per_year", None)
        super().__post_init__()

    @property
    def worth(self) -> PerYear | None:
        """The values of `--cycles-per-year`, `--price` and `--co2`; None if none is given."""
        from energy_opt.power.per_year import per_year_of

        return per_year_of(self.cycles_per_year, self.price, self.co2)
