"""The tables of a suite file: the allowed values of each key, converted to SI units; and the moves that they describe.

Moves are given by joint name or in order, as poses, by a file, or at random with a seed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, StrictBool, StrictStr, field_validator, model_validator

from energy_opt.batches.task import MODES, OBJECTIVES, Duration, Surroundings
from energy_opt.cell.scene import Scene
from energy_opt.effects import Payload as PointLoad
from energy_opt.errors import BadInput, shown, suggest
from energy_opt.files import is_number
from energy_opt.motion import Settings
from energy_opt.poses.given import Ends, Given, in_base, poses_of_scene
from energy_opt.requests.moves import OptimizeRequest
from energy_opt.robot import Robot
from energy_opt.robot.degrees import onto_limits, refuse_degrees
from energy_opt.schema import Name, Number, Table, reads

MEAN = "mean"  # the mean of source-method-2 and careful, the default of every verb
MOST_MOVES = 10**6  # most random moves of a table: at ten a second, more take days
OF_POSES = ("start_pose", "goal_pose", "via_pose", "free", "pose_tolerance")
Payload = tuple[float, ...]  # mass [kg] and centre of mass (3) [m]; empty for the model's own


def payload_values(value: Any) -> Payload:
    """(4,) from a number, "MASS[,CX,CY,CZ]" or a list of the same.

    Raises:
        BadInput: it is none of these, or mass or centre are outside the bounds of a payload.
    """
    parts = value.split(",") if isinstance(value, str) else _as_list(value)
    try:
        numbers = tuple(float(part) for part in parts if not isinstance(part, bool))
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    if len(numbers) not in (1, 4) or not all(map(is_number, numbers)):
        raise BadInput('expected a mass in kg, or "MASS,CX,CY,CZ" with the centre of mass in m')
    mass, *centre = numbers if len(numbers) == 4 else (numbers[0], 0.0, 0.0, 0.0)
    PointLoad(mass=mass, com=centre)
    return mass, *centre


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


Listed = BeforeValidator(_as_list)  # one value counts as a list of one
Filled = Field(min_length=1)
Timings = Annotated[list[Annotated[Duration, reads(Duration.parse)]], Listed]


class MoveTable(Table):
    """One [[moves]] table; ends may be joint positions, poses of the tool, or those of a path's file."""

    name: Name | None = None
    start: Any = None
    goal: Any = None
    via: list[Any] = []
    path: StrictStr | None = None
    durations: Timings = []
    start_pose: Any = None
    goal_pose: Any = None
    via_pose: list[Any] = []
    free: Any = ()
    pose_tolerance: Any = None

    @model_validator(mode="after")
    def _ends(self) -> Self:
        """A move has a start and a goal (each as joint positions or as a pose), or a path."""
        for key in ("start", "goal"):
            given = [x for x in (key, f"{key}_pose", "path") if getattr(self, x) is not None]
            if not given:
                raise ValueError(f"{key} is missing")
            if len(given) > 1:
                raise ValueError(f"{' and '.join(given)} are given; a move has start and goal, or a path")
        return self

    @property
    def chosen(self) -> bool:
        """True if an end or a via point is a pose of the tool, or there are several goals: positions are chosen."""
        return bool(self.model_fields_set.intersection(OF_POSES)) or len(_alternatives(self.goal)) > 1


def _alternatives(value: Any, pose: bool = False) -> list[Any]:
    """The goals of a list of them, else the only one; a `pose` may be a matrix, a list of lists of four numbers."""
    first = value[0] if isinstance(value, list) and value else None
    matrix = pose and isinstance(first, list) and len(first) == 4 and is_number(first[0])
    return value if isinstance(first, (list, Mapping, str)) and not matrix else [value]


class RandomTable(Table):
    """Random moves: their number, seed, and share of the joints' ranges."""

    count: Annotated[int, Field(strict=True, gt=0, le=MOST_MOVES)]
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    range: Annotated[Number, Field(gt=0, le=1)] = 0.6


class CellTable(Table):
    """The cell of the moves, as in `CellRequest`; files are named relative to the suite."""

    self_collision: StrictBool | None = None
    planner: StrictStr | None = None
    tool: StrictStr | None = None
    floor: Number | None = None
    clearance: Number | None = None
    base: list[Number] | None = None
    payload_size: list[Number] | None = None
    package_dirs: list[StrictStr] | None = None
    scene: StrictStr | None = None
    srdf: StrictStr | None = None


class GroupTable(CellTable):
    """A product of lists: the top level of a suite, or one of its [[groups]] on top of that."""

    robots: Annotated[list[StrictStr], Listed, Filled]
    modes: Annotated[list[Literal["retime", "reshape"]], Listed, Filled] = ["reshape"]
    durations: Annotated[Timings, Filled] = [Duration(multiple=1.5)]
    payloads: Annotated[list[Annotated[Payload, reads(payload_values)]], Listed, Filled] = [()]
    models: Annotated[list[StrictStr], Listed, Filled] = [MEAN]
    objectives: Annotated[list[Literal[OBJECTIVES]], Listed, Filled] = ["energy"]  # type: ignore[valid-type]
    moves: list[MoveTable] = []
    random: Annotated[list[RandomTable], Listed] = []
    limits: StrictStr | None = None
    lock: dict[str, Number] = {}
    settings: dict[str, Any] = {}

    @field_validator("modes")
    @classmethod
    def _in_order(cls, modes: list[str]) -> list[str]:
        return [mode for mode in MODES if mode in modes]

    @field_validator("settings")
    @classmethod
    def _of_the_solver(cls, given: dict[str, Any]) -> dict[str, Any]:
        """Settings that the solver knows, with lists as tuples."""
        known = [f.name for f in dataclasses.fields(Settings) if f.name not in ("objective", "compile", "own_limits")]
        for key in given:
            if key not in known:
                raise ValueError(f"{key}: unknown setting; known: {', '.join(known)}")
        try:
            OptimizeRequest(**given)  # checks their types
            Settings(**given)
        except BadInput as error:
            raise ValueError(str(error)) from None
        return {key: tuple(value) if isinstance(value, list) else value for key, value in given.items()}


@dataclass(frozen=True)
class NamedMove:
    """Start and goal (n,) [rad] under a name, with via points, or a path: suffix and text of its file.

    Attributes:
        ends: text of `Ends.to_text` if they are poses of the tool; `start`, `goal` are then ignored.
    """

    name: str
    start: tuple[float, ...]
    goal: tuple[float, ...]
    via: tuple[tuple[float, ...], ...] = ()
    path: tuple[str, str] = ("", "")
    ends: str = ""


def random_moves(robot: Robot, count: int, seed: int, share: float = 0.6) -> list[NamedMove]:
    """`count` moves with start and goal uniform within the middle `share` of each joint's range.

    A longer list with the same seed begins with the shorter one.
    """
    lower, upper = robot.limits.ranges
    middle, half = (lower + upper) / 2, (upper - lower) / 2 * share
    draws = middle + half * np.random.default_rng(seed).uniform(-1.0, 1.0, size=(count, 2, robot.n))
    width = max(2, len(str(count)))
    return [
        NamedMove(f"random{seed}-{k:0{width}d}", tuple(start.tolist()), tuple(goal.tolist()))
        for k, (start, goal) in enumerate(draws, start=1)
    ]


def joint_values(value: Any, robot: Robot, say: Callable[[str], None] = lambda _: None) -> tuple[float, ...]:
    """A configuration (n,) [rad] from a list in the robot's order, or from a table by joint name.

    `say` receives notes on rounded positions.

    Raises:
        BadInput: wrong count, unknown or missing joints, a value that is not a finite number, or degrees.
    """
    joints = robot.joints
    if isinstance(value, Mapping):
        unknown = [name for name in value if name not in joints]
        missing = [name for name in joints if name not in value]
        if unknown:
            hint = suggest(unknown[0], joints)
            raise BadInput(f"unknown joint {unknown[0]!r}{hint}; the robot's joints are {', '.join(joints)}")
        if missing:
            raise BadInput(f"joint {missing[0]!r} is missing")
        value = [value[name] for name in joints]
    if not isinstance(value, list):
        raise BadInput(f"{shown(value)} is not a list of joint positions")
    if any(isinstance(item, (list, Mapping)) for item in value):
        raise BadInput("several positions; expected those of one place, as a list of numbers")
    if len(value) != len(joints):
        raise BadInput(f"{len(value)} values; the robot has {len(joints)} joints")
    for name, item in zip(joints, value, strict=True):
        if not is_number(item):
            raise BadInput(f"{name} = {item!r} is not a finite number")
    q = np.array(value, dtype=float)
    refuse_degrees(robot, q)
    inside, notes = onto_limits(robot, q)
    for note in notes:
        say(note)
    return tuple(inside.tolist())


def posed_move(
    name: str, row: MoveTable, robot: Robot, folder: Path, around: Surroundings, say: Callable[[str], None]
) -> NamedMove:
    """A move between poses of the tool, or joint positions and such poses, or to any of several goals.

    Args:
        name: of the move. row: its table. robot: the arm. folder: with the files of poses. around: scene and base.
        say: receives notes on rounded positions.

    Raises:
        BadInput: no such pose, or a frame that is not in the scene; or via points are joint positions.
    """
    if row.via:
        raise BadInput("via belongs to a move between two joint positions; expected via_pose")
    scene = Scene.from_text(around.scene) if around.scene else None
    reader = Given(folder, poses_of_scene(scene))
    scene = None if scene is None else scene.among(around.request.arms(robot))

    def pose(value: Any, what: str, axes: Any = ()) -> Any:
        return in_base(reader.pose(value, what, axes, row.pose_tolerance), robot, scene, around.request.base_pose)

    def positions(value: Any) -> np.ndarray:
        return np.array(joint_values(value, robot, say))

    start = None if row.start_pose is None else pose(row.start_pose, "start_pose")
    begin = np.zeros(robot.n) if row.start is None else positions(row.start)
    if row.goal_pose is None:
        goals = tuple(map(positions, _alternatives(row.goal)))
    else:
        goals = tuple(pose(value, "goal_pose", row.free) for value in _alternatives(row.goal_pose, True))
    via = tuple(pose(value, "via_pose", row.free) for value in row.via_pose)
    return NamedMove(name, tuple(begin.tolist()), (0.0,) * robot.n, ends=Ends(start, goals, via).to_text())
