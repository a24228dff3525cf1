"""Further first curves of a move that keeps clear: ways that were looked for, and ways that are cheap."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.motion.path import JointPath
from energy_opt.motion.plan.context import Context
from energy_opt.motion.plan.ways import room_between
from energy_opt.motion.reshape.level import Curve, Level
from energy_opt.motion.reshape.task import Line, Task
from energy_opt.motion.ways.find import Looks
from energy_opt.motion.ways.roadmap import cheap_ways

PASSED = 400  # points of a path that a first curve is fitted to


def passed(path: JointPath, duration: float) -> Line:
    """A path passed smoothly from rest to rest."""
    u = np.linspace(0, 1, PASSED)
    return Line(u, path(u**3 * (10 - 15 * u + 6 * u**2)), duration)


def further_lines(context: Context, cell: Cell, task: Task, level: Level, known: Sequence[Curve]) -> Iterator[Line]:
    """First guesses besides a move's own: the context's ways, and as many that are cheap by what it costs to be there.

    Args:
        known: curves about which cheap ways are looked for, free or not; the first has the move's duration.
    """
    duration, u = known[0].duration, np.linspace(0, 1, PASSED)
    yield from (passed(way, duration) for way in context.ways)
    if context.settings.tube is not None or task.vias:
        return

    def rate(q: np.ndarray) -> np.ndarray:
        cost = level.standing(q, duration, task.parameters, task.limits)
        return np.asarray(np.maximum(cost - task.offset, 0))

    room, ends, step = room_between(context.robot, cell, context.limits, task.ends.start, task.ends.goal)
    lines, settings = [curve.position(u) for curve in known], context.settings
    for rows in cheap_ways(Looks(room, step), ends, rate, lines, settings.seed, settings.ways or 0):
        yield Line(np.linspace(0, 1, len(rows)), rows, duration)
