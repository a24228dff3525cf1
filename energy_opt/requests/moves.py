"""The requests of verbs that plan one move, or a cycle of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar

from energy_opt.errors import BadInput, shown
from energy_opt.requests import groups
from energy_opt.requests.groups import MODEL, ROBOT
from energy_opt.requests.option import option

if TYPE_CHECKING:
    import numpy as np

    from energy_opt.requests.groups import AnyModel, AnyRobot


OF_A_MOVE = ("start", "goal", "path", "payload", "model", "limits", "scene", "seed")


@dataclass(frozen=True)
class MoveRequest(
    groups.WorthGroup, groups.PlannedCellGroup, groups.SeedGroup, groups.DeadlineGroup, groups.SolvingGroup,
    groups.ConditionGroup, groups.PoseGroup, groups.MoveGroup, groups.RobustGroup, groups.PayloadGroup,
    groups.PrefixGroup, groups.RobotGroup,
):  # fmt: skip
    """One move: what `optimize` and `tradeoff` have in common."""

    always: ClassVar[tuple[str, ...]] = OF_A_MOVE

    robot: AnyRobot | None = option(None, ROBOT, "NAME_OR_URDF", main=True)
    model: AnyModel | Sequence[AnyModel] | None = option(
        None, f"{MODEL} (the mean of source-method-2 and careful; repeatable)", "MODEL", many=True, main=True
    )

    def document(self) -> dict[str, Any]:
        """See `Request.document`; several goals are written as `goals`."""
        found = super().document()
        if isinstance(self.goal, Mapping) and "any_of" in self.goal:
            found |= {"goal": None, "goals": found["goal"]["any_of"]}
        return found

    @classmethod
    def read(cls, given: dict[str, Any]) -> dict[str, Any]:
        """The same read back."""
        goals = given.pop("goals", None)
        if not isinstance(goals, (list, tuple, type(None))):
            raise BadInput(f"goals = {shown(goals)}: expected a list")
        given = super().read(given)
        if given.get("path") is not None:  # the path determines start and goal
            given |= {"start": None, "goal": None}
        return given if goals is None else {**given, "goal": {"any_of": goals}}


@dataclass(frozen=True)
class OptimizeRequest(groups.WriteGroup, MoveRequest):
    """One move to minimum energy."""

    verb = "optimize"
    summary = "plan one move with minimum energy"
    results, report, answer = "energy_opt_out", True, "result.json"
    always: ClassVar[tuple[str, ...]] = (*OF_A_MOVE, "mode", "duration", "max_duration")

    _: KW_ONLY
    duration: float | None = option(None, "exact duration [s] (free)", "T", main=True)
    max_duration: float | None = option(None, "longest duration [s] (free)", "T", main=True)
    standard: str | None = option(
        None, "write standard joint moves (a speed and an acceleration each) instead of a free trajectory", "moves",
        flag="--as", choices=("moves",),
    )  # fmt: skip
    vias: int | None = option(None, "largest number of via points that --as moves may add (0)", "K")


@dataclass(frozen=True)
class TradeoffRequest(MoveRequest):
    """Energy against duration of one move, or of a job over its cycle time."""

    verb = "tradeoff"
    summary = "energy against duration, of one move or of a job"
    results, report, answer = "energy_opt_tradeoff", True, "tradeoff.json"

    _: KW_ONLY
    job: str | PathLike[str] | Mapping[str, Any] | None = option(
        None, "a job, in place of one move: its energy over its cycle time", "JOB.toml", place="?"
    )
    durations: str | Sequence[float] | np.ndarray | None = option(
        None, "durations of the points [s] (20 points, chosen by the program)", "FIRST:LAST:COUNT", main=True
    )
    duration: float | None = option(None, "only one point, at this duration [s]", "T")
    max_duration: float | None = option(
        None, "longest duration of the front [s] (chosen by the program)", "T", main=True
    )
    cycle: float | None = option(
        None, "also state the energy over a cycle of T seconds, including the wait (no cycle)", "T", main=True
    )
    idle_power: float | None = option(None, "power overhead while the arm waits [W] (the model's standby)", "W")
    resume: bool = option(False, "with JOB.toml: continue an earlier run into the same --out", written=False)
    folder: str | PathLike[str] | None = option(None, "where the files are that the job names", internal=True)


@dataclass(frozen=True)
class JobRequest(
    groups.WorthGroup, groups.PlannedCellGroup, groups.SeedGroup, groups.DeadlineGroup, groups.WriteGroup,
    groups.RobustGroup, groups.PayloadGroup, groups.PrefixGroup, groups.RobotGroup,
):  # fmt: skip
    """A cycle of moves and waits."""

    verb = "job"
    summary = "plan a cycle of moves and waits, of one robot or several, with minimum energy"
    results, report, answer = "energy_opt_job", True, "job.json"

    job: str | PathLike[str] | Mapping[str, Any] = option(
        ..., "file of the cycle (`energy-opt --example job` prints one)", "JOB.toml", place="1"
    )
    robot: AnyRobot | None = option(
        None, "robot instead of the one in the job file: a name or a URDF", "NAME_OR_URDF", main=True
    )
    model: AnyModel | Sequence[AnyModel] | None = option(
        None, f"{MODEL} (the mean of source-method-2 and careful; repeatable)", "MODEL", many=True, main=True
    )
    _: KW_ONLY
    starts: int | None = option(None, "largest number of starting points of each move (24)", "N", main=True)
    compile: str = option("auto", "compile the model's functions to machine code: auto, always or never (auto)", "WHEN")
    jitter: float | None = option(
        None, "how early or late each of several robots may be [s] (the job file's, or 0.02)", "S", main=True
    )
    resume: bool = option(False, "one robot: continue an earlier run into the same --out", main=True, written=False)
    folder: str | PathLike[str] | None = option(None, "where the files are that the job names", internal=True)


@dataclass(frozen=True)
class PlaceRequest(
    groups.PlannedCellGroup, groups.SeedGroup, groups.RobustGroup, groups.PrefixGroup, groups.RobotGroup
):
    """The base pose that makes a job cheapest."""

    verb = "place"
    summary = "find the base pose at which a job takes the least energy"
    results, report, answer = "energy_opt_place", True, "place.json"

    job: str | PathLike[str] | Mapping[str, Any] = option(
        ..., "file of a cycle with steps that end at poses of the tool", "JOB.toml", place="1"
    )
    base_box: str | Sequence[float] = option(
        ...,
        "range of the base's position in the scene's frame [m]; `,yaw`: it may also turn; `,YAW0,YAW1`: it may turn "
        "within this range [rad]", "X0,X1,Y0,Y1,Z0,Z1[,yaw]", main=True,
    )  # fmt: skip
    model: AnyModel | Sequence[AnyModel] | None = option(
        None, f"{MODEL} (the mean of source-method-2 and careful; repeatable)", "MODEL", many=True, main=True
    )
    _: KW_ONLY
    fixture: str | None = option(
        None, "place this object of the scene instead of the base; poses in its frame move with it", "OBJECT"
    )
    robot: AnyRobot | None = option(
        None, "robot instead of the one in the job file: a name or a URDF", "NAME_OR_URDF", main=True
    )
    looked_at: int = option(120, "number of placements to estimate (120)", "N")
    seeds: int = option(3, "number of best estimates at which a rough cycle is solved (3)", "N")
    steps: int = option(5, "largest number of further rough cycles, from the best one (5)", "N")
    starts: int | None = option(None, "largest number of starting points of each move (24)", "N")
    compile: str = option("auto", "compile the model's functions to machine code: auto, always or never (auto)", "WHEN")
    folder: str | PathLike[str] | None = option(None, "where the files are that the job names", internal=True)
