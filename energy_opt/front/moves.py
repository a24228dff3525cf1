"""The move that a request asks for: its path, its ends (also as poses), and the request with everything resolved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import fields, replace
from functools import partial
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.files import path_of as path_named
from energy_opt.formats import read
from energy_opt.formats.close_waypoints import past
from energy_opt.formats.recording import path_of
from energy_opt.formats.waypoints import Samples
from energy_opt.front.given import as_loaded, payload_document, positions
from energy_opt.front.motion_files import trajectory_of
from energy_opt.motion import Move, Settings, Trajectory
from energy_opt.motion.path import JointPath, of_trajectory
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.motion.plan.robust_weights import Kind
from energy_opt.motion.standstills import check_moves_on
from energy_opt.names import in_order
from energy_opt.poses.given import Ends, Given, poses_of_request
from energy_opt.poses.pose import EXACT, AnyOf, Freedom, Pose
from energy_opt.requests.moves import MoveRequest
from energy_opt.robot import Robot
from energy_opt.robot.degrees import doubted_units, onto_limits, refuse_degrees

SAMPLED = 401  # points at which a path given as a function is sampled
DERIVED = ("draw ", "rival ")  # prefixes of models that follow from another one's covariance and rivals
OF_TRAJECTORY = ("time", "position", "velocity", "acceleration")
Asked = TypeVar("Asked", bound=MoveRequest)
Say = Callable[[str], None]


def path_from(given: Any, robot: Robot, prefix: str = "", say: Say = lambda _: None) -> JointPath:
    """A path from waypoints (K, n) [rad], a trajectory or a result, a file, or any function q(s) on [0, 1].

    Args:
        prefix: of the joints' names in a file. say: receives the notes of its reader.

    Raises:
        BadInput: of another number of joints, or not finite.
    """
    given = trajectory_of(given)
    if isinstance(given, (str, PathLike)):
        table = read(path_named(given, "--path")).of(robot.joints, prefix, robot.followers)
        warnings = doubted_units(robot, table.doubtful, table.position, table.where)
        inside, moved = onto_limits(robot, table.position, table.where)
        given, more = path_of(replace(table, position=inside))
        for note in (*table.notes, *warnings, *moved, *more):
            say(note)
    if isinstance(given, Mapping):
        try:
            given = Trajectory(robot.joints, *(np.asarray(given[name], dtype=float) for name in OF_TRAJECTORY))
        except (KeyError, ValueError, TypeError) as fault:
            raise BadInput(f"--path: {fault}; a trajectory has {', '.join(OF_TRAJECTORY)}") from None
    if isinstance(given, Trajectory):
        given = _in_order(given, robot)
        check_moves_on(given, "--path")
        given = of_trajectory(given)
    if isinstance(given, JointPath):
        path = given
    else:
        try:
            points = _waypoints(given, robot)
        except (ValueError, TypeError):
            raise BadInput(
                f"--path: expected waypoints (K, {robot.n}) [rad], or a function of s in [0, 1] that gives positions "
                f"({robot.n},)"
            ) from None
        if points.ndim != 2 or len(points) < 2 or points.shape[1] != robot.n or not np.isfinite(points).all():
            raise BadInput(f"--path: shape {points.shape}; expected waypoints (K, {robot.n}), K at least 2, all finite")
        points, moved = onto_limits(robot, points, "--path")
        path, notes = past(points, "--path")
        for note in (*moved, *notes):
            say(note)
    if path.n != robot.n:
        raise BadInput(f"--path: {path.n} joints; {robot.name} has {robot.n}")
    return path


def _in_order(given: Trajectory, robot: Robot) -> Trajectory:
    """The trajectory with its columns in the robot's order, matched by name.

    Raises:
        BadInput: times that do not rise, a number that is not finite, or a missing joint.
    """
    q, v, a = given.position, given.velocity, given.acceleration
    found = Samples("--path", given.joints, q, given.time, v, a).of(robot.joints, following=robot.followers)
    columns = [np.asarray(block) for block in (found.position, found.velocity, found.acceleration)]
    return Trajectory(robot.joints, given.time, *columns)


def _waypoints(given: Any, robot: Robot) -> np.ndarray:
    """Positions (K, n) of an array, a table, a sequence of positions, or a function of s in [0, 1].

    The function takes arrays (M,), or single numbers only.
    """
    ordered = partial(in_order, joints=robot.joints, what="--path")
    if not callable(given):
        points = [ordered(point) for point in given] if isinstance(given, (list, tuple)) else ordered(given)
        return np.asarray(points, dtype=float)
    s = np.linspace(0.0, 1.0, SAMPLED)
    with suppress(ValueError, TypeError, IndexError):
        points = np.asarray(ordered(given(s)), dtype=float)
        if points.shape == (SAMPLED, robot.n):
            return points
    return np.asarray([ordered(given(each)) for each in s.tolist()], dtype=float)


def move_of(
    request: MoveRequest,
    robot: Robot,
    ends: Ends | None = None,
    say: Say = lambda _: None,
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
        start = robot.limits.near_zero if ends.start else _end(request, request.start, robot, "start", say)
        goal = start
    else:
        for option in ("start", "goal"):
            if getattr(request, option) is None:
                raise BadInput(f"--{option} is missing; give --start and --goal, or --path")
        start, goal = (_end(request, getattr(request, option), robot, option, say) for option in ("start", "goal"))
    points = () if ends is not None and ends.via else request.via
    via = tuple(_end(request, point, robot, "via", say) for point in points)
    return Move(start, goal, request.mode, path=path, via=via, input=source, **duration)  # type: ignore[arg-type]


def _end(request: MoveRequest, given: Any, robot: Robot, name: str, say: Say = lambda _: None) -> np.ndarray:
    """One end of a move or a via point, (n,) [rad, m]; `name` is that of its option. `say` takes warnings."""
    q = positions(given, robot, name, None if request.srdf is None else Path(request.srdf))
    inside, moved = onto_limits(robot, q, f"--{name}")
    for warning in (*refuse_degrees(robot, q, f"--{name}"), *moved):
        say(warning)
    return inside


def settings_of(request: Any) -> Settings:
    """Solver settings of a request."""
    given = {f.name: getattr(request, f.name, None) for f in fields(Settings)}
    return Settings(**{name: value for name, value in given.items() if value is not None})


def unused(request: Any) -> list[str]:
    """Warnings on options of the search that a retimed move does not use."""
    given = [flag for flag in ("starts", "controls", "initial_paths") if getattr(request, flag) is not None]
    flags = ", ".join(f"--{flag.replace('_', '-')}" for flag in given)
    return [f"{flags}: not used with --mode retime, which keeps the path"] if given and request.mode == "retime" else []


def resolved(
    request: Asked, robot: Robot, rivals: list[Rival], kind: Kind | None, move: Move, ends: Ends | None = None
) -> Asked:
    """The request with everything resolved, so that its document repeats the move on any machine.

    Args:
        request: as asked. robot: the arm. rivals: the models of the plan. kind: "mean" or "worst" of several models, or
            None. move: as asked. ends: poses of the tool.
    """
    path = request.path
    known: dict[str, Any] = {
        **as_loaded(robot, request.robot),
        "start": None if ends is not None and ends.start is not None else move.start.tolist(),
        "goal": move.goal.tolist(),
        "path": str(path) if isinstance(path, (str, PathLike)) else _path(move.path),
        "via": tuple(q.tolist() for q in move.via),
        "model": documents(rivals),
        "robust": kind,
        "payload": payload_document(request.payload),  # a payload of a model belongs to that model
    }
    if ends is not None:
        begin = None if ends.start is None else ends.start.document()
        goals = [goal.tolist() if isinstance(goal, np.ndarray) else goal.document() for goal in ends.goals]
        known |= {"goal": {"any_of": goals}, "start_pose": begin, "goal_pose": None, "free": (), "pose_tolerance": None}
        known["via_pose"] = tuple(pose.document() for pose in ends.via)
    return replace(request, **known)


def documents(rivals: list[Rival]) -> tuple[dict[str, Any], ...]:
    """Models as documents with their names, without those that follow from the first one's covariance and rivals."""
    return tuple({"name": r.name, **r.model.to_document()} for r in rivals if not r.name.startswith(DERIVED))


def _path(path: JointPath | None) -> Any:
    """Waypoints, or the trajectory that a path comes from."""
    if path is None:
        return None
    if path.source is None:
        return path(path.knots).tolist()
    return {name: getattr(path.source, name).tolist() for name in OF_TRAJECTORY}


def ends_of(request: MoveRequest, robot: Robot, around: CellRequest, say: Say = lambda _: None) -> Ends | None:
    """The ends that a request describes; None where start and goal are one position each.

    Args:
        around: poses may be given in frames of its scene. say: takes warnings.

    Raises:
        BadInput: ends that are missing, given twice, or given beside a path.
    """
    start, goals = request.start, _goals(request.goal)
    posed = request.start_pose if request.start_pose is not None else start if _is_pose(start) else None
    posed_vias = _poses(request.via_pose)
    passed = [*posed_vias, *(each for each in request.via if _is_pose(each))]
    if posed is None and request.goal_pose is None and not passed and len(goals) < 2 and not any(map(_is_pose, goals)):
        for option, given in (("free", bool(request.free)), ("pose-tolerance", request.pose_tolerance is not None)):
            if given:
                raise BadInput(f"--{option} belongs to --goal-pose")
        return None
    if request.path is not None:
        raise BadInput("--path fixes start and goal; give either --path or poses")
    if request.start_pose is not None and start is not None:
        raise BadInput("--start and --start-pose are both given; give one")
    if request.free and request.goal_pose is None and not posed_vias:
        raise BadInput("--free belongs to --goal-pose")
    if passed and len(passed) < len(request.via) + len(posed_vias):
        raise BadInput("--via and --via-pose are both given; give one")
    if passed and request.mode == "retime":
        raise BadInput("--via-pose belongs to --mode reshape; for retime give the points as a --path file")
    reader = Given(None, poses_of_request(around))
    allowed: Any = request.pose_tolerance
    allowed = tuple(allowed) if hasattr(allowed, "__iter__") and not isinstance(allowed, str) else allowed

    def pose(given: Any, name: str, free: Any = ()) -> Pose:
        if isinstance(given, Pose):
            return given
        return written(given, name) if _is_pose(given) else reader.pose(given, name, free, allowed)

    ends: list[Any] = [
        pose(goal, "--goal-pose") if _is_pose(goal) else _end(request, goal, robot, "goal", say) for goal in goals
    ]
    ends += [pose(each, "--goal-pose", request.free) for each in _poses(request.goal_pose)]
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
        given = AnyOf(given["any_of"])
    many = isinstance(given, AnyOf) or (isinstance(given, (list, tuple)) and given and isinstance(given[0], str))
    goals = [each for each in given if each is not None] if many else [given]
    if not goals:
        raise BadInput("--goal: AnyOf without a goal; expected one or more")
    return goals


def _poses(given: Any) -> list[Any]:
    """The given poses as a list; four times four numbers are one matrix."""
    if given is None or (isinstance(given, (list, tuple)) and not given):
        return []
    many = isinstance(given, (list, tuple, np.ndarray)) and len(given) and not isinstance(given[0], Real)
    matrix = many and len(given) == 4 and all(np.shape(line) == (4,) for line in given)
    return list(given) if many and not matrix else [given]


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
