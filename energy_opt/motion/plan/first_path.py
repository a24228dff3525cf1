"""Free ends and a free first path: the given one, the straight line, or a path around obstacles.

If the tool keeps its pose, the usual first path is moved there point by point by inverse kinematics.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.cell.words import clearance_words
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion.carried import Carried
from energy_opt.motion.initial_paths import InitialPath, find_paths, ompl
from energy_opt.motion.initial_paths.find import Ends, Source
from energy_opt.motion.initial_paths.polyline import length
from energy_opt.motion.initial_paths.room import Room, steps
from energy_opt.motion.judge.clearance import clearance_along
from energy_opt.motion.limits.base import Limit, box_of
from energy_opt.motion.limits.keep import Keep
from energy_opt.motion.limits.via import distinct
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path import JointPath, inside, straight, through
from energy_opt.motion.path_dynamics import PathDynamics, points_of
from energy_opt.motion.plan.context import path_of
from energy_opt.motion.result import FirstPath
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

PATHS = 1  # initial paths to look for if the user gives none; the planner asks for more if the result saves little
# [rad, m] along paths: spacing of a spline's controls, tried in turn; it may leave them by a share of it
STEPS = (0.5, 0.2, 0.1, 0.05, 0.025)


def check_free(cell: Cell, q: np.ndarray, what: str) -> None:
    """Raise Infeasible if the arm touches something at q (n,); `what` names the pose."""
    contact = cell.touching(q)
    if contact is not None:
        hints = [f"object {name} " for name in contact.pair] + [f"{name!r}?" for name in contact.pair]
        said = [warning for warning in cell.warnings if any(hint in warning for hint in hints)]
        raise Infeasible(
            "; ".join([f"{what}: {contact}", *said, contact.remedy]), limit="clearance",
            position={"start": 0.0, "goal": 1.0}.get(what), excess=contact.depth,
        )  # fmt: skip


def first_path(
    robot: Robot, model: PowerModel, cell: Cell | None, settings: Settings, limits: Sequence[Limit], move: Move,
    stopped: Callable[[], bool],
) -> tuple[Move, FirstPath, tuple[JointPath, ...]]:  # fmt: skip
    """The move with a free first path, the source of that path, and further free paths.

    The path is the given or straight one if that is free. A straight line that breaks a condition on the tool's pose is
    moved onto it; a path that is not free is replaced by one around the bodies.

    A reshaped move may keep a path that is not free, if it was given or no other was found: `blocked` then says so.

    Args:
        stopped: True ends the search for paths around the bodies.

    Raises:
        Infeasible: a move that keeps its path would touch something, or no way around was found.
    """
    begin = time.perf_counter()
    reshape, is_straight = move.mode == "reshape", move.path is None and not move.via
    source: Source = "straight" if is_straight else "given"
    what = "straight line" if is_straight else "given path" if move.path is not None else "path through the via points"
    if settings.tube is not None:  # the tube is about the given path, so other initial paths are useless
        move = replace(move, path=path_of(move))
    elif is_straight and not holds(robot, model, limits, path_of(move)):
        path = posed(robot, model, limits, path_of(move))
        if path is not None and (cell is None or clearance_along(cell, path).proven):
            return replace(move, path=path), FirstPath("own", time.perf_counter() - begin), ()
    elif move.via and move.path is None and not _is_inside(limits, path_of(move)):
        bent = _path_through(cell, limits, _straight_legs(robot, move))
        if bent is not None:
            return replace(move, path=bent.path), FirstPath(bent.source, time.perf_counter() - begin), ()
    if cell is None:
        return move, FirstPath(source), ()
    found = clearance_along(cell, path_of(move))
    words = clearance_words(found.document(), "of it")
    if cell.request.planner == "ompl" and not found.proven and not ompl.installed():
        raise BadInput("--planner ompl: OMPL is not installed; pip install 'energy-opt[plan]'")
    if not found.proven and move.path is not None and not reshape:
        raise Infeasible(
            f"the {what} is not free: {words}; --mode reshape can start from it",
            limit="clearance", position=found.time, excess=found.depth,
        )  # fmt: skip
    paths = _further_paths(robot, cell, settings, limits, move, found.proven, stopped)
    seconds = time.perf_counter() - begin
    if found.proven or (move.path is not None and paths):
        return move, FirstPath(source, seconds), tuple(found.path for found in paths)
    if paths:
        return replace(move, path=paths[0].path), FirstPath(paths[0].source, seconds), tuple(w.path for w in paths[1:])
    for end, q in (("start", move.start), ("goal", move.goal)):  # which no path can avoid
        check_free(cell, q, end)
    if stopped():
        extra = " in time; a longer --deadline may help"
    else:
        extra = (
            "" if ompl.installed() else "; pip install 'energy-opt[plan]' installs a planner that can find more paths"
        )
    if move.path is not None:
        blocked = f"the {what} is not free: {words}"
    else:
        blocked = f"the {what} is not free ({words}), and no way around was found{extra}"
    if reshape:
        return move, FirstPath(source, seconds, blocked), ()
    raise Infeasible(blocked, limit="clearance")


def _further_paths(
    robot: Robot, cell: Cell, settings: Settings, limits: Sequence[Limit], move: Move, free: bool,
    stopped: Callable[[], bool],
) -> list[InitialPath]:  # fmt: skip
    """Initial paths besides one that is given or `free`, or in place of one that is not free."""
    if settings.tube is not None or (
        free and (move.path is None or not settings.initial_paths or move.mode == "retime")
    ):
        return []

    def between(start: np.ndarray, goal: np.ndarray, count: int) -> list[InitialPath]:
        room = Room(cell, np.stack([start, goal]))
        ends = Ends.of(start, goal, *box_of(limits, robot.n), robot.limits.velocity)
        step = steps(robot.body.tree())
        asked = cell.request.planner
        return find_paths(room, ends, step, planner=asked, seed=settings.seed, count=count, stopped=stopped)

    if move.via and move.path is None:
        legs: list[InitialPath] = []
        for start, goal in itertools.pairwise([move.start, *distinct(move), move.goal]):
            leg = between(start, goal, 1)
            if not leg:
                return []
            legs += leg
        joined = _path_through(cell, limits, legs)
        return [] if joined is None else [joined]
    count = max(1, PATHS if settings.initial_paths is None else settings.initial_paths)
    return between(move.start, move.goal, count if move.mode == "reshape" else 1)


def _straight_legs(robot: Robot, move: Move) -> list[InitialPath]:
    """The straight lines between the start, the via points and the goal of a move."""
    ends = [np.stack(pair) for pair in itertools.pairwise([move.start, *distinct(move), move.goal])]
    return [InitialPath(straight(*pair), "straight", 0.0, length(pair, robot.limits.velocity)) for pair in ends]


def _path_through(cell: Cell | None, limits: Sequence[Limit], legs: Sequence[InitialPath]) -> InitialPath | None:
    """One path along others in order: a spline that passes their ends, within position limits and free; or None."""
    source = max((leg.source for leg in legs), key=("straight", "own", "ompl").index)
    legs = [leg for leg in legs if leg.path.moves]
    if not legs:
        return None
    chords = [np.linalg.norm(np.diff(leg.path(np.linspace(0, 1, CHECKS)), axis=0), axis=1).sum() for leg in legs]
    bounds = box_of(limits, legs[0].path.n)
    for step in STEPS:
        counts = [4 + int(chord / step) for chord in chords]
        places = [leg.path(np.linspace(0, 1, count))[:-1] for leg, count in zip(legs, counts, strict=True)]
        path = inside(
            np.vstack([*places, legs[-1].path.goal]), np.cumsum(counts[:-1]) - np.arange(1, len(legs)), *bounds
        )
        if _is_inside(limits, path) and (cell is None or clearance_along(cell, path).proven):
            return InitialPath(path, source, legs[-1].seconds, sum(leg.length for leg in legs))
    return None


def _is_inside(limits: Sequence[Limit], path: JointPath) -> bool:
    """Does a path keep the position limits?"""
    q = path(np.linspace(0, 1, CHECKS))
    lower, upper = box_of(limits, path.n)
    return bool(np.all((q >= lower - ROUNDING) & (q <= upper + ROUNDING)))


POINTS = 61  # points of the path that are moved, both ends included; a cubic spline joins them
NEWTON = 40  # most iterations of the inverse kinematics
FARTHEST = 0.2  # [rad] largest step of a joint in one iteration
DAMPING = 1e-4  # damping of the least squares; squared Jacobians [m, rad] are of order one
CHECKS = 401  # points at which the path is checked
ROUNDING = 1e-9  # [rad, m] excess of a position limit that is ignored


def holds(robot: Robot, model: PowerModel, limits: Sequence[Limit], path: JointPath) -> bool:
    """Does the tool keep its required pose along a path, by those of the `limits` that require one (`Keep`)?"""
    d = PathDynamics(robot, model, path, points_of(path, CHECKS))
    found = [limit.fixed(d) for limit in limits if isinstance(limit, Keep)]
    return all(fixed.excess.max() <= 0 for fixed in found)


def posed(robot: Robot, model: PowerModel, limits: Sequence[Limit], path: JointPath) -> JointPath | None:
    """The path between the same ends, its inner points moved as little as possible so that the tool keeps its pose.

    Damped least squares on the error of the pose: dq = (J'J + d I)^-1 J' e at each point, J and e along the constrained
    directions only. None if the resulting path does not keep it.

    Args:
        limits: at least one condition on the tool's pose (`Keep`) is among them; their bounds on positions hold.
    """
    kept = [limit for limit in limits if isinstance(limit, Keep)]
    lower, upper = box_of(limits, robot.n)
    tool, share = Carried(robot.body, kept[0].tool), np.linspace(0, 1, POINTS)
    q = path(share)
    inner = slice(1, -1)
    for _ in range(NEWTON):
        poses, jacobian = tool.poses(q[inner]), tool.jacobian(q[inner])
        parts = [limit.correction(poses, share[inner]) for limit in kept]
        off = np.concatenate([x for x, _ in parts], axis=1)[:, :, None]
        slope = np.concatenate([of @ jacobian for _, of in parts], axis=1)
        square = slope.transpose(0, 2, 1) @ slope + DAMPING * np.eye(robot.n)
        step = np.linalg.solve(square, slope.transpose(0, 2, 1) @ off)[:, :, 0]
        step *= np.minimum(1, FARTHEST / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
        q[inner] = np.clip(q[inner] + step, lower, upper)
    found = through(q)
    return found if holds(robot, model, limits, found) else None
