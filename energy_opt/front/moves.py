"""From a request to the move, the settings of the solver, and the request with everything resolved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.front.given import named_robot, positions, refuse_degrees
from energy_opt.motion import Move, Settings
from energy_opt.motion.path import JointPath, of_trajectory, through
from energy_opt.motion.plan.robust import Kind, Rival
from energy_opt.motion.standing import check_moves_on
from energy_opt.motion.trajectory import Trajectory
from energy_opt.poses.ends import Ends
from energy_opt.requests.moves import MoveRequest
from energy_opt.robot import Robot

SAMPLED = 401  # points at which a path given as a function is sampled
DERIVED = ("draw ", "rival ")  # prefixes of models that follow from another one's covariance and rivals
OF_TRAJECTORY = ("time", "position", "velocity", "acceleration")
Asked = TypeVar("Asked", bound=MoveRequest)


def path_from(given: Any, robot: Robot, prefix: str = "", say: Callable[[str], None] = lambda _: None) -> JointPath:
    """A path from waypoints (K, n) [rad], a trajectory, a file of either, or any function q(s) on [0, 1].

    Args:
        prefix: of the joints' names in a file. say: receives the notes of its reader.

    Raises:
        BadInput: of another number of joints, or not finite.
    """
    if isinstance(given, (str, PathLike)):
        from energy_opt.formats import read

        table = read(Path(given))
        for note in table.notes:
            say(note)
        table = table.of(robot.joints, prefix)
        refuse_degrees(robot, table.position, table.where)
        given = table.path()
    if isinstance(given, Mapping):
        try:
            given = Trajectory(robot.joints, *(np.asarray(given[name], dtype=float) for name in OF_TRAJECTORY))
        except (KeyError, ValueError, TypeError) as fault:
            raise BadInput(f"--path: {fault}; a trajectory has {', '.join(OF_TRAJECTORY)}") from None
    if isinstance(given, Trajectory):
        check_moves_on(given, "--path")
        given = of_trajectory(given)
    if isinstance(given, JointPath):
        path = given
    else:
        try:
            points = np.asarray(given(np.linspace(0.0, 1.0, SAMPLED)) if callable(given) else given, dtype=float)
        except (ValueError, TypeError):
            raise BadInput(f"--path: expected waypoints (K, {robot.n}) [rad]") from None
        if points.ndim != 2 or len(points) < 2 or points.shape[1] != robot.n or not np.isfinite(points).all():
            raise BadInput(f"--path: shape {points.shape}; expected waypoints (K, {robot.n}), K at least 2, all finite")
        path = through(points)
    if path.n != robot.n:
        raise BadInput(f"--path: {path.n} joints; {robot.name} has {robot.n}")
    return path


def move_of(
    request: MoveRequest,
    robot: Robot,
    ends: Ends | None = None,
    say: Callable[[str], None] = lambda _: None,
    **duration: float | None,
) -> Move:
    """The move that a request asks for. With `ends`, the goal (and a start pose) are chosen later.

    Args:
        request: start, goal, path and via points. robot: the arm. ends: poses of the tool, if there are any. say: takes
            notes of readers of files.
        duration: `duration` and `max_duration` [s].

    Raises:
        BadInput: ends are missing or given twice, of another shape, or not finite.
    """
    path, source = None, None
    if request.path is not None:
        if request.start is not None or request.goal is not None:
            raise BadInput("--path fixes start and goal; give either --path, or --start and --goal")
        path = path_from(request.path, robot, request.joint_prefix, say)
        source = path.source
        start, goal = (path.start, path.goal) if source is None else (source.position[0], source.position[-1])
    elif ends is not None:
        start = robot.limits.near_zero if ends.start else _end(request, robot, "start")
        goal = start
    else:
        for option in ("start", "goal"):
            if getattr(request, option) is None:
                raise BadInput(f"--{option} is missing; give --start and --goal, or --path")
        start, goal = _end(request, robot, "start"), _end(request, robot, "goal")
    points = () if ends is not None and ends.via else request.via
    via = tuple(positions(point, robot, "via") for point in points)
    return Move(start, goal, request.mode, path=path, via=via, input=source, **duration)  # type: ignore[arg-type]


def _end(request: MoveRequest, robot: Robot, name: str) -> np.ndarray:
    """One end of a move, (n,) [rad, m]."""
    q = positions(getattr(request, name), robot, name, None if request.srdf is None else Path(request.srdf))
    refuse_degrees(robot, q, f"--{name}")
    return q


def settings_of(request: Any) -> Settings:
    """Solver settings of a request."""
    given = {f.name: getattr(request, f.name, None) for f in fields(Settings)}
    return Settings(**{name: value for name, value in given.items() if value is not None})


def resolved(
    request: Asked, robot: Robot, rivals: list[Rival], kind: Kind | None, move: Move, ends: Ends | None = None
) -> Asked:
    """The request with everything resolved, so that its document repeats the move on any machine.

    Args:
        request: as asked. robot: the arm. rivals: the models of the plan. kind: "mean" or "worst" of several models, or
            None. move: as asked. ends: poses of the tool.
    """
    payload, path = rivals[0].model.get("payload"), request.path
    known: dict[str, Any] = {
        "robot": named_robot(robot, request.robot),
        "start": None if ends is not None and ends.start is not None else move.start.tolist(),
        "goal": move.goal.tolist() if ends is None else _goals(ends),
        "path": str(path) if isinstance(path, (str, PathLike)) else _path(move.path),
        "via": tuple(q.tolist() for q in move.via),
        "model": documents(rivals),
        "robust": kind,
        "payload": None if payload is None else {name: value.tolist() for name, value in payload.values.items()},
    }
    if ends is not None:
        begin = None if ends.start is None else ends.start.document()
        known |= {"start_pose": begin, "goal_pose": None, "free": (), "pose_tolerance": None}
        known["via_pose"] = tuple(pose.document() for pose in ends.via)
    return replace(request, **known)


def documents(rivals: list[Rival]) -> tuple[dict[str, Any], ...]:
    """Models as documents with their names, without those that follow from the first one's covariance and rivals."""
    return tuple({"name": r.name, **r.model.to_document()} for r in rivals if not r.name.startswith(DERIVED))


def _goals(ends: Ends) -> dict[str, Any]:
    """A goal of several alternatives as a document."""
    return {"any_of": [goal.tolist() if isinstance(goal, np.ndarray) else goal.document() for goal in ends.goals]}


def _path(path: JointPath | None) -> Any:
    """Waypoints, or the trajectory that a path comes from."""
    if path is None:
        return None
    if path.source is None:
        return path(path.knots).tolist()
    return {name: getattr(path.source, name).tolist() for name in OF_TRAJECTORY}
