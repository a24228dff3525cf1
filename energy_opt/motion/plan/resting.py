"""Rest beside a faster move: an arm at rest may take less power than one that moves slowly, mostly by dry friction.

At rest, dry friction bears a part of the load; while a joint creeps, the motor bears the load and the friction. A curve
of few parameters has no rest. So a slow move is also tried faster, with the arm at rest before or after it:

    min over T' <= T, and over both ends, of E(T') + P (T - T'), with P [W] the power of holding that end
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.move import Move
from energy_opt.motion.plan.choice import with_trajectory
from energy_opt.motion.plan.context import Context
from energy_opt.motion.result import Result
from energy_opt.motion.retime.fastest import FLOOR
from energy_opt.motion.retime.program import Retiming
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Trajectory, joined, row_step, standing

AT_REST = 1e-6  # [rad/s^2, m/s^2] a motion that ends with more is not at rest there
SLOW = 2.0  # times the least time of the first path: faster moves are not tried with rest
USED = 0.9  # share of the duration: the rest beside a longer move gains little
HARDLY = 3e-3  # share of the loss: a faster move that takes no more than this beyond is solved, which makes it cheaper
COARSE = 200  # steps of a motion by which it is estimated whether rest pays


def with_rest(motion: Trajectory, duration: float, after: bool) -> Trajectory | None:
    """The motion, with rest after or before it that fills `duration` [s]; None if it is not at rest there."""
    end, wait = -1 if after else 0, duration - motion.duration
    if max(np.abs(motion.velocity[end]).max(), np.abs(motion.acceleration[end]).max()) > AT_REST or wait <= 0:
        return None
    rest = standing(motion.joints, motion.position[end], wait, int(np.ceil(wait / row_step(duration))) + 1)
    return joined([motion, rest] if after else [rest, motion])


def cheaper_end(scorer: Scorer, move: Move) -> tuple[float, bool]:
    """The power [W] of holding the start or the goal, whichever is less, and whether it is the goal."""
    start, goal = scorer.holding(np.stack([move.start, move.goal])).tolist()
    return min(start, goal), goal <= start


def pays(scorer: Scorer, motion: Trajectory, power: float) -> bool:
    """Does a motion take more, or hardly less, than itself in `USED` of its duration and rest with that power [W]?"""
    time = np.linspace(motion.time[0], motion.time[-1], COARSE + 1)
    coarse = Trajectory(motion.joints, time, *motion.sample(time)[:3])
    usual, faster = scorer.energy(coarse), scorer.energy(coarse.slowed(USED * motion.duration)).total
    return faster + power * (1 - USED) * motion.duration < usual.total + HARDLY * usual.loss


def rested(
    context: Context, move: Move, timing: Timing | None, result: Result, solve: Callable[[float], Result]
) -> Result:
    """The result of a reshaped move, or a faster move with rest if this takes less energy in the same duration.

    It is looked for if the result itself, made faster, takes less energy with rest. The best duration of the faster
    move is that of the first path, by a credit of P for each second.

    Args:
        timing: the fastest timing of the first path. solve: solves the move in a duration [s].
    """
    duration = move.duration
    if duration is None or timing is None or not timing.path.moves or duration < SLOW * timing.duration:
        return result
    if context.settings.objective != "energy" or move.mode == "retime" or any(np.any(v) for v in move.end_velocities):
        return result
    power, after = cheaper_end(context.scorer, move)
    if not pays(context.scorer, result.trajectory, power):
        return result
    work = Retiming(context.robot, context.model, timing, context.limits)
    found = work.optimise(timing, price=power, longest=duration, floor=FLOOR, bounded=True)
    if not found.solved or found.timing.duration > USED * duration or context.stopped():
        return result
    try:
        faster = solve(found.timing.duration)
    except Infeasible:
        return result
    if faster.interrupted:
        return replace(result, status=faster.status, message=faster.message, interrupted=True)
    whole = with_rest(faster.trajectory, duration, after)
    other = None if whole is None else with_trajectory(context, move, timing, faster, whole)
    if other is None or not other.certificate.valid or other.energy.total >= result.energy.total:
        return result
    rest, where = duration - faster.duration, "goal" if after else "start"
    message = f"the arm moves for {faster.duration:.4g} s and rests for the other {rest:.4g} s at the {where}"
    return replace(other, chosen=move.mode, message=message, progress=result.progress)
