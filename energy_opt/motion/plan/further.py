"""Further starts of a move that keeps clear: paths that were found, paths of low cost, and more optima."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.errors import Infeasible
from energy_opt.motion.initial_paths.find import Looks
from energy_opt.motion.initial_paths.roadmap import cheap_paths
from energy_opt.motion.move import Move
from energy_opt.motion.path import JointPath
from energy_opt.motion.plan.candidates import Candidate, reshaped
from energy_opt.motion.plan.context import Context
from energy_opt.motion.plan.first_path import room_between
from energy_opt.motion.reshape.curve import Curve, Outcome
from energy_opt.motion.reshape.task import Level, Line, Task
from energy_opt.motion.retime.solve import RetimeSolution
from energy_opt.motion.timing.spline_timing import Timing

SAME, LOOKED = 0.15, 40  # [rad] curves that differ by less at all of 40 points count as the same
WIDER = 3  # most further seeds to look for optima without bodies, if initial paths are asked for
PASSED = 400  # points of a path that an initial curve is fitted to


def line_along(path: JointPath, duration: float) -> Line:
    """A path, passed smoothly from rest to rest in `duration` s."""
    u = np.linspace(0, 1, PASSED)
    return Line(u, path(u**3 * (10 - 15 * u + 6 * u**2)), duration)


def further_lines(context: Context, cell: Cell, task: Task, level: Level, known: Sequence[Curve]) -> Iterator[Line]:
    """Initial curves besides a move's own: the context's paths, and as many of low cost by the power of standing there.

    Args:
        task, level: the problem, whose cost of standing says where a path is cheap.
        known: curves around which cheap paths are looked for, free or not; the first has the move's duration.
    """
    duration, u = known[0].duration, np.linspace(0, 1, PASSED)
    yield from (line_along(path, duration) for path in context.initial_paths)
    if context.settings.tube is not None or task.vias:
        return

    def rate(q: np.ndarray) -> np.ndarray:
        cost = level.standing(q, duration, task.parameters, task.limits)
        return np.asarray(np.maximum(cost - task.offset, 0))

    room, ends, step = room_between(context.robot, cell, context.limits, task.ends.start, task.ends.goal)
    lines, settings = [curve.position(u) for curve in known], context.settings
    for poses in cheap_paths(Looks(room, step), ends, rate, lines, settings.seed, settings.initial_paths or 0):
        yield Line(np.linspace(0, 1, len(poses)), poses, duration)


def wider_optima(
    context: Context, move: Move, timing: Timing | None, retimed: Callable[[], RetimeSolution | None], free: Candidate
) -> Candidate:  # fmt: skip
    """The best candidate found without bodies from several seeds, with the different optima of all of them.

    Args:
        timing, retimed: see `candidates.reshaped`.
        free: the candidate of the usual seed; returned if none of them has an outcome.
    """
    found, settings = [free], context.settings
    for k in range(1, 1 + min(settings.initial_paths or 0, WIDER)):
        if context.stopped():
            break
        try:
            other = replace(context, settings=replace(settings, seed=settings.seed + k))
            found.append(reshaped(other, move, timing, retimed))
        except Infeasible:
            continue
    good = [candidate for candidate in found if candidate.outcome is not None]
    if not good:
        return free
    best = min(good, key=lambda candidate: candidate.outcome.cost if candidate.outcome is not None else np.inf)
    optima: list[Outcome] = []
    for optimum in sorted(
        (optimum for candidate in found for optimum in candidate.optima), key=lambda optimum: optimum.cost
    ):
        if not any(alike(optimum.curve, other.curve) for other in optima):
            optima.append(optimum)
    return replace(best, optima=tuple(optima), iterations=sum(candidate.iterations for candidate in found))


def alike(a: Curve, b: Curve) -> bool:
    """True if two curves differ only slightly (`SAME`)."""
    u = np.linspace(0, 1, LOOKED)
    return bool(np.abs(a.position(u) - b.position(u)).max() < SAME)
