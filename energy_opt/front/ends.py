"""Ends of a move that are poses of the tool or one of several positions: those asked for, and those chosen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.front.answer import Answer
from energy_opt.front.given import positions, refuse_degrees
from energy_opt.motion import Settings, Trajectory
from energy_opt.poses.chosen import Chosen
from energy_opt.poses.ends import Ends, pose_document
from energy_opt.poses.given import Given, poses_of_request
from energy_opt.poses.pose import EXACT, AnyOf, Freedom, Pose
from energy_opt.requests.moves import MoveRequest
from energy_opt.robot import Robot


def ends_of(request: MoveRequest, robot: Robot, around: CellRequest) -> Ends | None:
    """The ends that a request describes; None where start and goal are one position each.

    Args:
        around: poses may be given in frames of its scene.

    Raises:
        BadInput: ends that are missing, given twice, or given beside a path.
    """
    start, goals = request.start, _goals(request.goal)
    posed = request.start_pose if request.start_pose is not None else start if _is_pose(start) else None
    passed = [*request.via_pose, *(each for each in request.via if _is_pose(each))]
    if posed is None and request.goal_pose is None and not passed and len(goals) < 2 and not any(map(_is_pose, goals)):
        for option in ("free", "pose_tolerance"):
            if getattr(request, option):
                raise BadInput(f"--{option.replace('_', '-')} belongs to --goal-pose")
        return None
    if request.path is not None:
        raise BadInput("--path fixes start and goal; give either --path or poses")
    if request.start_pose is not None and start is not None:
        raise BadInput("--start and --start-pose are both given; give one")
    if request.free and request.goal_pose is None and not request.via_pose:
        raise BadInput("--free belongs to --goal-pose")
    if passed and len(passed) < len(request.via) + len(request.via_pose):
        raise BadInput("--via and --via-pose are both given; give one")
    if passed and request.mode == "retime":
        raise BadInput("--via-pose belongs to --mode reshape; for retime give the points as a --path file")
    reader, tolerance = Given(None, poses_of_request(around)), request.pose_tolerance
    allowed: Any = tolerance if tolerance is None or isinstance(tolerance, str) else tuple(tolerance)

    def pose(given: Any, name: str, free: Any = ()) -> Pose:
        if isinstance(given, Pose):
            return given
        return written(given, name) if _is_pose(given) else reader.pose(given, name, free, allowed)

    ends: list[Any] = []
    for goal in goals:
        if _is_pose(goal):
            ends.append(pose(goal, "--goal-pose"))
            continue
        q = positions(goal, robot, "goal", None if request.srdf is None else Path(request.srdf))
        refuse_degrees(robot, q, "--goal")
        ends.append(q)
    if request.goal_pose is not None:
        ends.append(pose(request.goal_pose, "--goal-pose", request.free))
    if not ends:
        raise BadInput("--goal is missing; give --goal or --goal-pose")
    if posed is None and start is None:
        raise BadInput("--start is missing; give --start or --start-pose")
    via = tuple(pose(each, "--via-pose", request.free) for each in passed)
    begin = None if posed is None else pose(posed, "--start-pose")
    return Ends(begin, tuple(ends), via).in_base(robot, around)


def _is_pose(given: Any) -> bool:
    return isinstance(given, Pose) or (isinstance(given, Mapping) and "matrix" in given)


def _goals(given: Any) -> list[Any]:
    """The given goals as a list."""
    if given is None:
        return []
    if isinstance(given, Mapping) and "any_of" in given:
        return list(given["any_of"])
    many = isinstance(given, AnyOf) or (isinstance(given, (list, tuple)) and given and isinstance(given[0], str))
    return [each for each in given if each is not None] if many else [given]


def written(given: Mapping[str, Any], name: str) -> Pose:
    """A pose from its document, see `Pose.document`.

    Raises:
        BadInput: it lacks something.
    """
    try:
        ranges = [
            Freedom(axis, -np.inf if low is None else float(low), np.inf if high is None else float(high))
            for axis, low, high in given.get("free", ())
        ]
        distance, angle = (float(x) for x in given.get("tolerance", EXACT))
        matrix = np.asarray(given["matrix"], dtype=float)
    except (KeyError, TypeError, ValueError) as fault:
        raise BadInput(f"{name}: {fault}; a pose has matrix, free and tolerance") from None
    return Pose(matrix, tuple(ranges), (distance, angle), name, str(given.get("frame", "")))


def _passing(trajectory: Trajectory, q: np.ndarray) -> np.ndarray:
    """Position (n,) of a motion that is nearest to q (n,)."""
    from scipy.optimize import minimize_scalar

    time = trajectory.time
    k = int(np.argmin(np.linalg.norm(trajectory.position - q, axis=1)))
    ends = time[max(k - 1, 0)], time[min(k + 1, len(time) - 1)]

    def miss(t: float) -> float:
        return float(np.linalg.norm(trajectory.sample(np.array([t]))[0][0] - q))

    found = minimize_scalar(miss, bounds=ends, method="bounded", options={"xatol": 1e-12})
    return np.asarray(trajectory.sample(np.array([found.x]))[0][0])


def with_goals(result: Answer, chosen: Chosen, poses: dict[str, Pose], settings: Settings) -> Answer:
    """The answer with the goals that were considered, and the errors of its ends at their poses."""
    positions = result.trajectory.position
    at = {"start": positions[0], "goal": positions[-1]}
    for k, q in enumerate(chosen.move.via, start=1):
        at[f"via {k}"] = _passing(result.trajectory, q)
    said = pose_document(result.arm, settings.tool, poses, at)
    status = result.status
    if not all(end["valid"] for end in said.values()):
        status = "not_converged"
    return replace(result, status=status, goals={**chosen.document(), "poses": said})
