"""Motions to compare goals: a quick estimate of a move's answer, and the optimum of curve and goal together."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.move import Move
from energy_opt.motion.plan.candidates import least_energy_timing, reference_time, task_of
from energy_opt.motion.plan.context import Context, path_of
from energy_opt.motion.plan.single import first_timing, is_hurried
from energy_opt.motion.reshape.clear import ClearSearch
from energy_opt.motion.reshape.curve import Curve
from energy_opt.motion.reshape.open import Open
from energy_opt.motion.reshape.search import ITERATIONS, trajectory_of
from energy_opt.motion.reshape.task import FEASIBLE, Line, Task
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.threads import one_thread

Settled = tuple[Trajectory, tuple[np.ndarray, ...]]  # a motion, and its positions at the via points
SETTLED, FIRST = 1e-6, 0.05  # relative tolerance and first step [rad, m] of the search beside bodies
# share of a bound that a sketch may exceed: a full search, or another end of the move, may still repair it
BEYOND = 0.5
# starts of a sketch: the first path, and bent to either side. With the path alone, a tenth of the sketches of a ur5e
# are a quarter of the loss or more above their answers; with three, 4 %; with five, no less.
STARTS = 3


@one_thread
def sketched(context: Context, move: Move, rough: bool = False) -> Trajectory:
    """A reshaped motion near an optimum, without bodies; it may exceed a limit by up to `BEYOND` of its bound.

    Args:
        rough: only the coarse optimum, in half the time.

    Raises:
        Infeasible: the search ends beyond a limit by more.
    """
    objective = context.settings.objective
    fixed = objective != "time" and move.duration is not None
    timing = None if fixed else first_timing(move, partial(context.fastest, path_of(move)))
    reference = reference_time(context, move, timing)
    task = task_of(context, move, reference, move.duration if fixed else None)
    free = timing is not None and move.duration is None and not rough
    best_timing = least_energy_timing(context, move, timing) if free and timing is not None else None
    guess = 2 * reference if best_timing is None else best_timing.trajectory.duration
    line = Line.along(path_of(move), guess)
    reshaper = context.reshaper(objective)
    if rough:
        found = reshaper.outline(task, line, STARTS, context.settings.seed, context.stopped)
    else:
        found = reshaper.optima(task, [line], STARTS, context.settings.seed, context.stopped)[0][0]
    if found.broken > BEYOND:
        raise Infeasible(f"no motion within the limits was found in {task.durations[1]:.4g} s", limit="duration")
    return trajectory_of(found.curve, context.robot.joints)


@one_thread
def settled(context: Context, move: Move, motion: Trajectory, open_: Open) -> Settled:
    """The optimum near a motion, which is bent first if its ends differ from the move's; with its via positions.

    Beside bodies it keeps the usual distances; nothing is proven. Returns the motion itself if the search fails. If a
    hurried motion breaks limits, and costs more within them, it is also settled with free accelerations at its ends.

    Args:
        open_: the free coordinates of the ends and via points, optimized together with the curve.
    """
    found = _optimum(context, move, motion, open_)
    cost = lambda at: context.judge(at).energy.total  # noqa: E731
    zero = context.settings.end_acceleration == "zero"
    if not zero or cost(found[0]) <= cost(motion) or context.judge(motion).within.valid:
        return found
    other = _optimum(context.freed, move, motion, open_)
    there = replace(move, start=other[0].position[0], via=other[1], goal=other[0].position[-1])
    if cost(other[0]) >= cost(found[0]):
        return found
    timing = first_timing(there, partial(context.fastest, path_of(there)))
    hurried = timing is not None and is_hurried(there, timing, other[0].duration)
    return other if hurried else found


def _optimum(context: Context, move: Move, motion: Trajectory, open_: Open) -> Settled:
    task = task_of(context, move, motion.duration, move.duration)
    if any(open_.via):  # points that coincide now may part
        task = replace(task, ends=replace(task.ends, via=np.array(move.via)))
    task = replace(task, open=open_)
    reshaper = context.reshaper("energy")
    level = reshaper.fine(task.vias)
    line = Line.of(motion)
    share = (line.u**3 * (10 - 15 * line.u + 6 * line.u**2))[:, None]
    bent = line.q + (1 - share) * (move.start - line.q[0]) + share * (move.goal - line.q[-1])
    curve = task.curve(level.shape, replace(line, q=bent))
    if context.cell is None:
        best = reshaper.solved(curve, task, context.stopped, near=not open_.any)
        return (motion, move.via) if best.broken > FEASIBLE else _settled(context, move, best.curve, task)
    search = ClearSearch.scaled_by(curve, context.cell, context.robot.joints, level, task, context.stopped)
    found = search.descent(curve, ITERATIONS, FIRST, SETTLED)
    return _settled(context, move, search.curve_of(found), task)


def _settled(context: Context, move: Move, curve: Curve, task: Task) -> Settled:
    via = list(move.via)
    for k, (surface, q) in enumerate(zip(task.open.via, curve.position(curve.via_u), strict=False)):
        via[k] = via[k] if surface is None else surface.reached(q, np.zeros(len(q)))
    return trajectory_of(curve, context.robot.joints), tuple(via)
