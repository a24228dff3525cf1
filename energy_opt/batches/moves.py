"""Moves of a suite: given ones by joint name or in order, and random ones with a seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.batches.tables import MoveTable
from energy_opt.batches.task import Surroundings
from energy_opt.errors import BadInput, near
from energy_opt.files import is_number, read_text
from energy_opt.formats import read_path
from energy_opt.robot import Limits, Robot


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


def joint_ranges(limits: Limits) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper end (n,) of each joint's range; a joint without limits counts as one turn, [-pi, pi]."""
    bounded = np.isfinite(limits.lower) & np.isfinite(limits.upper)
    return np.where(bounded, limits.lower, -np.pi), np.where(bounded, limits.upper, np.pi)


def random_moves(robot: Robot, count: int, seed: int, share: float = 0.6) -> list[NamedMove]:
    """`count` moves with start and goal uniform within the middle `share` of each joint's range.

    A longer list with the same seed begins with the shorter one.
    """
    lower, upper = joint_ranges(robot.limits)
    middle, half = (lower + upper) / 2, (upper - lower) / 2 * share
    draws = middle + half * np.random.default_rng(seed).uniform(-1.0, 1.0, size=(count, 2, robot.n))
    width = max(2, len(str(count)))
    return [
        NamedMove(f"random{seed}-{k:0{width}d}", tuple(start.tolist()), tuple(goal.tolist()))
        for k, (start, goal) in enumerate(draws, start=1)
    ]


def joint_values(value: Any, joints: Sequence[str]) -> tuple[float, ...]:
    """A configuration (n,) [rad] from a list in the robot's order, or from a table by joint name.

    Raises:
        BadInput: wrong count, unknown or missing joints, or a value that is not a finite number.
    """
    if isinstance(value, Mapping):
        unknown = [name for name in value if name not in joints]
        missing = [name for name in joints if name not in value]
        if unknown:
            hint = near(unknown[0], joints)
            raise BadInput(f"unknown joint {unknown[0]!r}{hint}; the robot's joints are {', '.join(joints)}")
        if missing:
            raise BadInput(f"joint {missing[0]!r} is missing")
        value = [value[name] for name in joints]
    if not isinstance(value, list):
        raise BadInput(f"{value!r} is not a list of joint positions")
    if len(value) != len(joints):
        raise BadInput(f"{len(value)} values; the robot has {len(joints)} joints")
    for name, item in zip(joints, value, strict=True):
        if not is_number(item):
            raise BadInput(f"{name} = {item!r} is not a finite number")
    return tuple(float(item) for item in value)


def posed_move(name: str, row: MoveTable, robot: Robot, folder: Path, around: Surroundings) -> NamedMove:
    """A move between poses of the tool, or joint positions and such poses; `folder` has the files of poses.

    Raises:
        BadInput: no such pose, or a frame that is not in the scene.
    """
    from energy_opt.cell.scene_files import carried
    from energy_opt.poses.ends import Ends
    from energy_opt.poses.given import Given, in_base, poses_of_scene

    scene = carried.from_text(around.scene) if around.scene else None
    reader = Given(folder, poses_of_scene(scene))

    def pose(value: Any, what: str, axes: Any = ()) -> Any:
        return in_base(reader.pose(value, what, axes, row.pose_tolerance), robot, scene, around.request.base_pose)

    start = None if row.start_pose is None else pose(row.start_pose, "start_pose")
    goal = None if row.goal_pose is None else pose(row.goal_pose, "goal_pose", row.free)
    begin, end = ((0.0,) * robot.n if q is None else joint_values(q, robot.joints) for q in (row.start, row.goal))
    via = tuple(pose(value, "via_pose", row.free) for value in row.via_pose)
    ends = Ends(start, (np.array(end) if goal is None else goal,), via)
    return NamedMove(name, begin, end, (), ("", ""), ends.to_text())


def given_path(name: str, file: Path, joints: Sequence[str]) -> NamedMove:
    """A move along the path in a file.

    Raises:
        BadInput: it has no waypoints or trajectory of these joints.
    """
    found = read_path(file, joints)
    return NamedMove(name, tuple(found.start.tolist()), tuple(found.goal.tolist()), (), (file.suffix, read_text(file)))
