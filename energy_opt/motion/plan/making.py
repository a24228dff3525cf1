"""A move's candidates: the first path in its best timing, a curve that is free of that path, one that keeps clear."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial

from energy_opt.errors import Infeasible
from energy_opt.motion.move import Move
from energy_opt.motion.plan.candidates import (
    Made,
    in_tube,
    is_at_rest,
    least_energy_timing,
    mended_timing,
    reshaped,
    small_enough,
    unsearched,
    unseen,
)
from energy_opt.motion.plan.choice import Work
from energy_opt.motion.plan.clear import kept_clear, nearly_clear
from energy_opt.motion.plan.context import Context, path_of
from energy_opt.motion.reshape.search import Kept
from energy_opt.motion.retime.solve import RetimeSolution
from energy_opt.motion.timing.law import Timing
from energy_opt.motion.trajectory import Trajectory

log = logging.getLogger(__name__)
HURRIED = 1.2  # times the least time on the first path: in more, zero acceleration at the ends costs next to nothing


def made(
    context: Context,
    move: Move,
    timing: Timing | None,
    warm: Sequence[Trajectory] = (),
    kept: Kept | None = None,
) -> Work:
    """Candidates for a move's answer.

    Args:
        timing: the fastest one of the first path.
        warm: trajectories to start from besides.
        kept: what starts led to at other durations of the same move.

    Raises:
        Infeasible: no timing or no path holds the limits.
    """
    if timing is not None and timing.path.moves and unseen(move):
        made = unsearched(context, move, timing)
        return Work(
            timing, None, made if move.mode == "reshape" else None, made if move.mode == "retime" else None, warm
        )
    if move.mode == "retime":
        assert timing is not None
        if context.settings.objective == "time":
            asked = timing if move.duration is None else timing.slowed(move.duration)
            return Work(timing, None, None, Made(asked.trajectory(context.robot.joints)), warm)
        solution = least_energy_timing(context, move, timing)
        assert solution is not None
        return Work(timing, solution, None, mended_timing(context, move, solution), warm)
    wanted = move.duration if move.duration is not None else move.max_duration
    if context.stopped() and timing is not None:
        return Work(timing, None, None, None, warm)

    @cache
    def retimed() -> RetimeSolution | None:
        possible = wanted is None or timing is None or wanted >= timing.duration * (1 - 1e-9) or not timing.path.moves
        return least_energy_timing(context, move, timing) if timing is not None and possible else None

    if is_at_rest(move) or (context.stopped() and timing is not None):
        return Work(timing, None, None, None, warm, retimed)
    curve = _curve(context, move, timing, retimed, warm, kept)
    hurried = wanted is None or timing is None or wanted < HURRIED * timing.duration or curve.trajectory is None
    zero = context.settings.end_acceleration == "zero" and hurried and not context.stopped()
    if zero and _costs_more(context, curve, retimed()):
        freed = replace(context, settings=replace(context.settings, end_acceleration="free"))
        other = _curve(freed, move, timing, retimed, warm, kept)
        if other.trajectory is not None and not _costs_more(context, other, retimed()):
            curve = replace(other, iterations=curve.iterations + other.iterations)
    return Work(timing, None, curve, None, warm, retimed)


def _curve(
    context: Context, move: Move, timing: Timing | None, retimed: Callable[[], RetimeSolution | None],
    warm: Sequence[Trajectory], kept: Kept | None,
) -> Made:  # fmt: skip
    """The curve of least objective that keeps clear."""
    worth = None if context.cell is None else partial(nearly_clear, context, move)
    curve = reshaped(context, move, timing, retimed, warm, kept, worth)
    log.info("keeping clear", extra={"share": 0.6})
    curve = kept_clear(context, move, timing, retimed, curve, warm)
    if not curve.converged and not context.stopped():
        curve = in_tube(context, move, retimed(), small_enough(move, retimed(), curve))
    return curve


def _costs_more(context: Context, curve: Made, solution: RetimeSolution | None) -> bool:
    """Is a curve, from zero acceleration to zero, beaten by the best timing of the first path?

    Timings begin and end with any acceleration. Near the least time that counts: building it up takes about 1 % longer.
    """
    if solution is None or context.settings.objective != "energy":
        return False
    return curve.trajectory is None or context.judge(curve.trajectory).energy.total > solution.energy


def first_timing(context: Context, move: Move) -> Timing | None:
    """TOPP-RA's timing of the first path; a reshaped move may do without one."""
    log.info("timing of the first path", extra={"share": 0.05})
    try:
        return context.fastest(path_of(move))
    except Infeasible:
        if move.mode == "retime":
            raise
        return None
