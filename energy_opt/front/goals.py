"""Moves whose start or goal is a set: a pose of the tool, or any of several positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.front.answer import Answer
from energy_opt.front.given import positions
from energy_opt.motion import Settings, Trajectory
from energy_opt.poses.choose import Chosen
from energy_opt.poses.ends import Ends
from energy_opt.poses.judge import pose_document
from energy_opt.poses.pose import AnyOf, Pose
from energy_opt.robot import Robot


def ends_from(
    robot: Robot, start: object, goal: object, asked: CellRequest, via: Sequence[object] = ()
) -> tuple[object, object, Ends | None]:
    """Start and goal as `move_for` takes them, and the ends where one of them is a pose or several goals.

    Args:
        start: positions or a `Pose`; goal: positions, a `Pose`, or `AnyOf` these; via: positions, or poses alone.
        asked: in whose scene's frames poses may stand.
    """
    poses = tuple(each for each in via if isinstance(each, Pose))
    if poses and len(poses) < len(via):
        raise BadInput("via: positions and poses of the tool are both given; give one kind")
    if not isinstance(start, Pose) and not isinstance(goal, (Pose, AnyOf)) and not poses:
        return start, goal, None
    many = [each for each in (goal if isinstance(goal, AnyOf) else (goal,)) if each is not None]
    goals = tuple(each if isinstance(each, Pose) else positions(each, robot, "goal") for each in many)  # type: ignore[arg-type]
    begin = robot.limits.near_zero if isinstance(start, Pose) else start
    ends = Ends(start if isinstance(start, Pose) else None, goals, poses)
    return begin, begin, ends.in_base(robot, asked)


def _passing(trajectory: Trajectory, q: np.ndarray) -> np.ndarray:
    """Where a motion is nearest to positions q (n,)."""
    from scipy.optimize import minimize_scalar

    time = trajectory.time
    k = int(np.argmin(np.linalg.norm(trajectory.position - q, axis=1)))
    ends = time[max(k - 1, 0)], time[min(k + 1, len(time) - 1)]

    def miss(t: float) -> float:
        return float(np.linalg.norm(trajectory.sample(np.array([t]))[0][0] - q))

    found = minimize_scalar(miss, bounds=ends, method="bounded", options={"xatol": 1e-12})
    return np.asarray(trajectory.sample(np.array([found.x]))[0][0])


def with_goals(result: Answer, chosen: Chosen, poses: dict[str, Pose], settings: Settings) -> Answer:
    """The answer with the goals that were looked at, and by what its ends miss their poses."""
    rows = result.trajectory.position
    at = {"start": rows[0], "goal": rows[-1]}
    for k, q in enumerate(chosen.move.via, start=1):
        at[f"via {k}"] = _passing(result.trajectory, q)
    said = pose_document(result.arm, settings.tool, poses, at)
    status = result.status
    if not all(end["valid"] for end in said.values()):
        status = "not_converged"
    return replace(result, status=status, goals={**chosen.document(), "poses": said})
