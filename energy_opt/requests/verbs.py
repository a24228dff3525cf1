"""The requests of all verbs but those that plan moves (see `moves`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from energy_opt.requests.groups import (
    MODEL,
    ROBOT,
    CellGroup,
    DeadlineGroup,
    PayloadGroup,
    PlannedCellGroup,
    PrefixGroup,
    RobotGroup,
    SeedGroup,
    WorthGroup,
    WriteGroup,
)
from energy_opt.requests.option import Request, option

if TYPE_CHECKING:
    from energy_opt.motion.trajectory import Trajectory
    from energy_opt.requests.groups import AnyModel, AnyRobot


@dataclass(frozen=True)
class BenchRequest(WorthGroup, PlannedCellGroup, DeadlineGroup, PayloadGroup, RobotGroup):
    """A batch of moves, in parallel, resumable."""

    verb: ClassVar[str] = "bench"

    suite: str | PathLike[str] | None = option(None, "what to run", "SUITE.toml", kind=Path, place="?")
    out: str | PathLike[str] | None = option(None, "folder of results (bench_<suite>)", "DIR", kind=Path, main=True)
    _: KW_ONLY
    jobs: int | None = option(None, "processes on this machine (one per free core)", "N", kind=int, main=True)
    resume: bool = option(False, "do what an earlier run into --out left", kind=bool, main=True)
    force: bool = option(False, "overwrite results of another suite or version of it", kind=bool, main=True)
    scheduler: str | None = option(None, "compute on a Dask cluster, e.g. tcp://host:8786 (none)", "ADDRESS", main=True)
    compare: Sequence[str | PathLike[str]] | None = option(
        None, "two results: what got better or worse", "OLD NEW", kind=Path, many=True, nargs=2, main=True
    )
    robot: AnyRobot | None = option(None, "robot for every move (the suite's)", "NAME_OR_URDF", main=True)
    model: AnyModel | None = option(None, f"{MODEL} (the suite's)", "MODEL", main=True)
    seed: int | None = option(None, "seed of random moves and of the solver's starts (the suite's)", "N", kind=int)
    compile: str = option("auto", "compile the model's functions: auto, always or never (auto)", "WHEN")
    self_collision: bool | None = option(None, "the arm keeps clear of itself (the suite's)", "on|off", kind=bool)
    planner: str | None = option(None, "source of the first path: auto, none or ompl (the suite's)", "NAME")
    overrides: Mapping[str, Any] | None = option(None, "entries in place of every table's own", internal=True)


@dataclass(frozen=True)
class IdentifyRequest(CellGroup, SeedGroup, PayloadGroup, RobotGroup):
    """The source paper's two methods, from static poses."""

    verb: ClassVar[str] = "identify"

    set: str | PathLike[str] | None = option(
        None, "the measured set: a folder with a log.toml", "DIR", kind=Path, place="?"
    )
    robot: AnyRobot | None = option(None, f"{ROBOT} (the one that log.toml names)", "NAME_OR_URDF", main=True)
    _: KW_ONLY
    suggest: int | None = option(None, "propose N static poses that would tell most", "N", kind=int, main=True)


@dataclass(frozen=True)
class DiagnoseRequest(PlannedCellGroup, SeedGroup, PayloadGroup, RobotGroup):
    """Which effect a power model lacks, from measured data."""

    verb: ClassVar[str] = "diagnose"

    set: str | PathLike[str] = option(..., "the measured set: a folder with a log.toml", "DIR", kind=Path, place="1")
    model: AnyModel | None = option(
        None,
        "the declared model, a file or a name (the set's own declared.toml, else mechanical power with standby and "
        "copper loss fitted)",
        "DECLARED.toml", main=True,
    )  # fmt: skip
    _: KW_ONLY
    robot: AnyRobot | None = option(None, f"{ROBOT} (the one that log.toml names)", "NAME_OR_URDF", main=True)
    tolerance: float = option(
        3.0, "energy error within which a model is good enough to plan with [%] (3)", "PERCENT", kind=float, main=True
    )


@dataclass(frozen=True)
class ImportRequest(RobotGroup):
    """Logs as labs have them to a measured set."""

    verb: ClassVar[str] = "import"

    files: Sequence[str | PathLike[str]] | str = option(
        ..., "tables of joints and of meters, or bags, any order", "FILE", kind=Path, place="+"
    )
    out: str | PathLike[str] = option(..., "folder of the measured set", "SET", kind=Path, main=True)
    robot: AnyRobot | None = option(None, f"{ROBOT} (found by columns and torques)", "NAME_OR_URDF", main=True)
    _: KW_ONLY
    time: str | None = option(None, "the column of stamps (found by its header)", "COLUMN[:UNIT]", main=True)
    power: str | None = option(
        None, "the whole robot's power; VOLTAGE*CURRENT is a product (found by its header)", "COLUMN[:UNIT]", main=True
    )
    joint: Sequence[str] = option(
        (), "a joint's position (found by its header; repeatable)", "JOINT=COLUMN[:UNIT]", many=True, main=True
    )
    force: bool = option(False, "replace a set that is there already", kind=bool, main=True)


@dataclass(frozen=True)
class SimulateRequest(CellGroup, SeedGroup, PayloadGroup, PrefixGroup, RobotGroup):
    """Trajectories played on a virtual arm, and the measured set of it."""

    verb: ClassVar[str] = "simulate"

    trajectories: Sequence[str | PathLike[str]] | str = option(
        ..., "files of trajectories, in order", "TRAJECTORY", kind=Path, place="+"
    )
    plant: str | PathLike[str] = option(..., "what the arm truly is: a model file", "MODEL.toml", kind=Path, main=True)
    out: str | PathLike[str] = option(
        "simulated", "folder of the measured set (simulated)", "DIR", kind=Path, main=True
    )
    robot: AnyRobot | None = option(None, f"{ROBOT} (the plant file's)", "NAME_OR_URDF", main=True)
    model: AnyModel | None = option(
        None, "what the owner believes, a file or a name: put into the set", "DECLARED.toml", main=True
    )
    _: KW_ONLY
    repeat: int = option(1, "play all of them N times (1)", "N", kind=int, main=True)
    rest: float = option(0.3, "standing before and after each [s] (0.3)", "S", kind=float)
    static: float = option(
        0.0, "also a static run of S seconds where each begins (0: none)", "S", kind=float, main=True
    )
    noise: float = option(0.6, "standard deviation of the meter's noise [W] (0.6)", "W", kind=float, main=True)
    rate: float = option(125.0, "encoder samples per second [Hz] (125)", "HZ", kind=float)
    meter_rate: float | None = option(
        None, "readings per second of a meter with a file and clock of its own [Hz] (none)", "HZ", kind=float
    )
    resolution: float = option(0.02, "of the meter [W] (0.02)", "W", kind=float)
    encoder: float = option(2e-5, "resolution of the encoders [rad] (2e-5)", "RAD", kind=float)
    jitter: float = option(0.0, "standard deviation of sampling times [s] (0)", "S", kind=float)
    log: Sequence[str] = option((), "also log velocity, effort", "SIGNAL", nargs="*", many=True)
    force: bool = option(False, "overwrite what DIR holds of another request", kind=bool, main=True)


@dataclass(frozen=True)
class EvaluateRequest(CellGroup, SeedGroup, WriteGroup, PayloadGroup, PrefixGroup, RobotGroup):
    """Motions as they are: energy under models, limits, clearance, baselines."""

    verb: ClassVar[str] = "evaluate"
    always: ClassVar[tuple[str, ...]] = ("files", "robot", "payload", "limits")

    files: Trajectory | str | PathLike[str] | Sequence[Trajectory | str | PathLike[str]] = option(
        ...,
        "a trajectory, program, bag or recording; or a result of optimize or job (folder, JSON or table), with its "
        "payloads and brakes",
        "FILE", place="+",
    )  # fmt: skip
    robot: AnyRobot | None = option(None, f"{ROBOT} (the one that the files name or have)", "NAME_OR_URDF", main=True)
    model: AnyModel | Sequence[AnyModel] | None = option(
        (), f"{MODEL} (source-method-2 and careful)", "MODEL", many=True, main=True
    )

    def document(self) -> dict[str, Any]:
        """As every request; models are `models`."""
        found = super().document()
        return found | {"models": found.pop("model", [])}

    @classmethod
    def read(cls, given: dict[str, Any]) -> dict[str, Any]:
        """The same read back."""
        models = given.pop("models", None)
        return given if models is None else {**given, "model": models}


@dataclass(frozen=True)
class PassportRequest(Request):
    """An arm's electrical passport from its models; several side by side."""

    verb: ClassVar[str] = "passport"

    models: AnyModel | Sequence[AnyModel] = option(
        ...,
        "model files, or names of robots (published values where there are any); the others are compared with the "
        "first",
        "MODEL", place="+",
    )  # fmt: skip
    robot: AnyRobot | None = option(None, "the models' robot (the one that each names)", "NAME_OR_URDF", main=True)
    _: KW_ONLY
    limits: str | PathLike[str] | None = option(
        None, "MoveIt's joint_limits.yaml (published or the URDF's)", "FILE", kind=Path, main=True
    )

    @classmethod
    def read(cls, given: dict[str, Any]) -> dict[str, Any]:
        """Without `contents`, what the files held."""
        return {key: value for key, value in given.items() if key != "contents"}


@dataclass(frozen=True)
class CheckRequest(CellGroup, PayloadGroup, PrefixGroup, RobotGroup):
    """Whether logs, trajectories, models, limits, suites, scenes, jobs and URDFs are usable."""

    verb: ClassVar[str] = "check"

    files: Sequence[str | PathLike[str]] | str = option(..., "what to check", "FILE_OR_DIR", kind=Path, place="+")
    robot: AnyRobot | None = option(None, "the robot whose joints and limits are meant", "NAME_OR_URDF", main=True)
    model: AnyModel | None = option(None, "model for the torque of a trajectory (source-method-2)", "MODEL")


@dataclass(frozen=True)
class RobotsRequest(Request):
    """The robots known by name, with joints and limits."""

    verb: ClassVar[str] = "robots"

    names: Sequence[str] | str = option((), "only these (all known by name)", "NAME_OR_URDF", place="*")


@dataclass(frozen=True)
class EffectsRequest(Request):
    """The effects known, with parameters, units and laws."""

    verb: ClassVar[str] = "effects"

    names: Sequence[str] | str = option((), "only these (all)", "NAME", place="*")


@dataclass(frozen=True)
class RunRequest(Request):
    """Repeats a request that was written down."""

    verb: ClassVar[str] = "run"

    request: str | PathLike[str] | Mapping[str, Any] = option(
        ..., "a request (JSON), or a result that holds one", "REQUEST.json", place="1"
    )
