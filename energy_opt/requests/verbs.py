"""The requests of all verbs but those that plan moves (see `moves`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar

from energy_opt.requests import groups
from energy_opt.requests.groups import MODEL, ROBOT
from energy_opt.requests.option import Request, option

if TYPE_CHECKING:
    from energy_opt.power import PowerModel
    from energy_opt.requests.groups import AnyModel, AnyRobot, Motion
    from energy_opt.results import Found
    from energy_opt.robot import Robot

    AnyMotion = Motion | Found | str | PathLike[str]  # results of optimize and job


@dataclass(frozen=True)
class BenchRequest(
    groups.WorthGroup, groups.PlannedCellGroup, groups.DeadlineGroup, groups.PayloadGroup, groups.RobotGroup
):
    """A batch of moves, in parallel, resumable."""

    verb = "bench"
    summary = "plan many moves in parallel, with a report; an interrupted run can be resumed"
    report = printed = True

    suite: str | PathLike[str] | None = option(
        None, "file of the suite (`energy-opt --example suite` prints one)", "SUITE.toml", place="?"
    )
    out: str | PathLike[str] | None = option(None, "folder of results (bench_<suite>)", "DIR", main=True)
    _: KW_ONLY
    jobs: int | None = option(None, "number of processes on this machine (one per free core)", "N", main=True)
    resume: bool = option(False, "continue an earlier run into the same --out", main=True)
    force: bool = option(False, "overwrite the results of another suite, or of another version of it", main=True)
    scheduler: str | None = option(
        None, "compute on a Dask cluster, such as tcp://host:8786 (none)", "ADDRESS", main=True
    )
    compare: Sequence[str | PathLike[str]] | None = option(
        None, "compare two results: which moves got better or worse", "OLD NEW", many=True, nargs=2, main=True
    )
    robot: AnyRobot | None = option(None, "robot of every move (the suite's)", "NAME_OR_URDF", main=True)
    model: AnyModel | None = option(None, f"{MODEL} (the suite's)", "MODEL", main=True)
    seed: int | None = option(None, "seed of random moves and of the solver's starts (the suite's)", "N")
    compile: str = option("auto", "compile the model's functions to machine code: auto, always or never (auto)", "WHEN")
    self_collision: bool | None = option(None, "keep the arm clear of itself (the suite's)", "on|off")
    planner: str | None = option(None, "planner of the initial path: auto, none or ompl (the suite's)", "NAME")
    overrides: Mapping[str, Any] | None = option(None, "values for these keys of every table", internal=True)


@dataclass(frozen=True)
class IdentifyRequest(groups.CellGroup, groups.SeedGroup, groups.PayloadGroup, groups.RobotGroup):
    """The source paper's two methods, from static poses."""

    verb = "identify"
    summary = "overhead and winding losses from static poses: the source paper's two methods"
    results, report, answer = "identify", True, "identify.json"

    set: str | PathLike[str] | None = option(None, "the measured set: a folder with a log.toml", "DIR", place="?")
    robot: AnyRobot | None = option(None, f"{ROBOT} (the one that log.toml names)", "NAME_OR_URDF", main=True)
    _: KW_ONLY
    suggest: int | None = option(None, "propose N poses (3 or more) that determine the losses best", "N", main=True)


@dataclass(frozen=True)
class DiagnoseRequest(groups.PlannedCellGroup, groups.SeedGroup, groups.PayloadGroup, groups.RobotGroup):
    """Which effect a power model lacks, from measured data."""

    verb = "diagnose"
    summary = "find from measured data which effect a power model lacks"
    results, report, answer = "diagnosis", True, "diagnosis.json"

    set: str | PathLike[str] = option(..., "the measured set: a folder with a log.toml", "DIR", place="1")
    model: AnyModel | None = option(
        None,
        "the declared model: a file or a name (the set's own declared.toml, else mechanical power plus fitted standby "
        "and copper loss)", "DECLARED.toml", main=True,
    )  # fmt: skip
    _: KW_ONLY
    robot: AnyRobot | None = option(None, f"{ROBOT} (the one that log.toml names)", "NAME_OR_URDF", main=True)
    tolerance: float = option(
        3.0, "largest error of a motion's energy with which the model is good enough for planning [%] (3)", "PERCENT",
        main=True,
    )  # fmt: skip


@dataclass(frozen=True)
class ImportRequest(groups.RobotGroup):
    """Convert a lab's logs to a measured set."""

    verb = "import"
    summary = "make a measured set from a lab's logs; columns and units are guessed"

    files: Sequence[str | PathLike[str]] | str = option(
        ..., "tables of joints and of power meters, or bags, in any order", "FILE", place="+"
    )
    out: str | PathLike[str] = option(..., "folder of the measured set to write", "SET", main=True)
    robot: AnyRobot | None = option(None, f"{ROBOT} (found from columns and torques)", "NAME_OR_URDF", main=True)
    _: KW_ONLY
    time: str | None = option(None, "column of time stamps (found by its header)", "COLUMN[:UNIT]", main=True)
    power: str | None = option(
        None, "column of the whole robot's power, or two as VOLTAGE*CURRENT (found by its header)", "COLUMN[:UNIT]",
        main=True,
    )  # fmt: skip
    joint: Sequence[str] = option(
        (), "column of a joint's position (found by its header; repeatable)", "JOINT=COLUMN[:UNIT]", many=True,
        main=True,
    )  # fmt: skip
    force: bool = option(False, "replace a set that exists already", main=True)


@dataclass(frozen=True)
class SimulateRequest(groups.CellGroup, groups.SeedGroup, groups.PayloadGroup, groups.PrefixGroup, groups.RobotGroup):
    """Trajectories played on a virtual arm, and the measured set of it."""

    verb = "simulate"
    summary = "play trajectories on a virtual arm and write a measured set"

    trajectories: AnyMotion | Sequence[AnyMotion] = option(
        ..., "trajectories to play, in this order", "TRAJECTORY", place="+"
    )
    plant: PowerModel | str | PathLike[str] = option(
        ..., "model file, or a name beside a robot: the true effects of the virtual arm", "MODEL.toml", main=True
    )
    out: str | PathLike[str] = option("simulated", "folder of the measured set (simulated)", "DIR", main=True)
    robot: AnyRobot | None = option(None, f"{ROBOT} (the plant file's)", "NAME_OR_URDF", main=True)
    model: AnyModel | None = option(
        None, "declared model to put into the set: a file or a name (none)", "DECLARED.toml", main=True
    )
    _: KW_ONLY
    repeat: int = option(1, "play all trajectories N times (1)", "N", main=True)
    rest: float = option(0.3, "time at rest before and after each trajectory [s] (0.3)", "S")
    static: float = option(0.0, "also record S seconds at rest at the start of each trajectory (0)", "S", main=True)
    noise: float = option(0.6, "standard deviation of the meter's noise [W] (0.6)", "W", main=True)
    rate: float = option(125.0, "encoder samples per second [Hz] (125)", "HZ")
    meter_rate: float | None = option(
        None, "the meter has its own file and clock, with this many readings per second [Hz] (none)", "HZ"
    )
    resolution: float = option(0.02, "resolution of the meter [W] (0.02)", "W")
    encoder: float = option(2e-5, "resolution of the encoders [rad] (2e-5)", "RAD")
    jitter: float = option(0.0, "standard deviation of the sampling times [s] (0)", "S")
    log: Sequence[str] = option((), "further signals to log: velocity, effort", "SIGNAL", nargs="*", many=True)
    force: bool = option(False, "overwrite the results of another request in DIR", main=True)


@dataclass(frozen=True)
class EvaluateRequest(
    groups.CellGroup, groups.SeedGroup, groups.WriteGroup, groups.PayloadGroup, groups.PrefixGroup, groups.RobotGroup
):
    """Given motions: energy under models, limits, clearance, baselines."""

    verb = "evaluate"
    summary = "energy, limits and clearance of given motions; write them in other formats"
    results = "energy_opt_evaluation"
    always: ClassVar[tuple[str, ...]] = ("files", "robot", "payload", "limits")

    files: AnyMotion | Sequence[AnyMotion] = option(
        ..., "a trajectory, a program, a bag, a recording, a measured set, or a result of optimize or job "
        "(folder, JSON or table)", "FILE", place="+",
    )  # fmt: skip
    robot: AnyRobot | None = option(None, f"{ROBOT} (the one that the files name)", "NAME_OR_URDF", main=True)
    model: AnyModel | Sequence[AnyModel] | None = option(
        None, f"{MODEL} (source-method-2 and careful; repeatable)", "MODEL", many=True, main=True
    )

    def document(self) -> dict[str, Any]:
        """See `Request.document`; the models are written as `models`."""
        found = super().document()
        return found | {"models": found.pop("model", [])}

    @classmethod
    def read(cls, given: dict[str, Any]) -> dict[str, Any]:
        """The same read back."""
        models = given.pop("models", None)
        return {**given, "model": models} if models else given


@dataclass(frozen=True)
class PassportRequest(groups.RobotGroup):
    """An arm's electrical passport from its models; several side by side."""

    verb = "passport"
    summary = "the electrical passport of an arm: values, intervals, sources; compare several"
    results, report = "passport", True

    models: AnyModel | Robot | Sequence[AnyModel | Robot] = option(
        ...,
        "model files, or names of robots (published values, else assumed ones); the first is compared with the others",
        "MODEL", place="+",
    )  # fmt: skip
    robot: AnyRobot | None = option(
        None, "robot of the models (the one that each model names)", "NAME_OR_URDF", main=True
    )

    @classmethod
    def read(cls, given: dict[str, Any]) -> dict[str, Any]:
        """The inverse of `document`; `contents` (the text of the files) is left out."""
        return super().read({key: value for key, value in given.items() if key != "contents"})


@dataclass(frozen=True)
class CheckRequest(groups.CellGroup, groups.PayloadGroup, groups.PrefixGroup, groups.RobotGroup):
    """Whether logs, trajectories, models, limits, suites, scenes, jobs and URDFs are usable."""

    verb = "check"
    summary = "check whether logs, trajectories, models and other files are usable"

    files: Sequence[str | PathLike[str]] | str = option(..., "files and folders to check", "FILE_OR_DIR", place="+")
    robot: AnyRobot | None = option(
        None, "robot whose joints and limits a trajectory or limits file is checked against", "NAME_OR_URDF", main=True
    )
    model: AnyModel | None = option(None, "model that gives the torque of a trajectory (source-method-2)", "MODEL")


@dataclass(frozen=True)
class RobotsRequest(Request):
    """The robots known by name, with joints and limits."""

    verb = "robots"
    summary = "list the known robots, with joints and limits"
    printed = True

    names: Sequence[str] | str = option((), "robots to list (all known by name)", "NAME_OR_URDF", place="*")


@dataclass(frozen=True)
class EffectsRequest(Request):
    """The effects known, with parameters, units and laws."""

    verb = "effects"
    summary = "list the known effects, with parameters, units and laws"
    printed = True

    names: Sequence[str] | str = option((), "effects to list (all)", "NAME", place="*")


@dataclass(frozen=True)
class RunRequest(Request):
    """Repeats a request from a file."""

    verb = "run"
    summary = "repeat the request of a result, or one written by hand"
    report = True

    request: Request | Found | str | PathLike[str] | Mapping[str, Any] = option(
        ..., "a request (JSON), or a result that holds one: its file or folder", "REQUEST_OR_DIR", place="1"
    )
