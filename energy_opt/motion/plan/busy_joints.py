"""Moves in hardly more than their least time: joints that need all of it keep the first path's timing.

In the least time, some joint is at a limit all the time. Its acceleration jumps from bound to bound, which no spline of
a few control points can do. But that joint has no choice: its motion is that of the first path's timing. The other
joints have time to spare and are reshaped.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.motion.limits.joint import JointLimit
from energy_opt.motion.move import Move
from energy_opt.motion.plan.blend import blended
from energy_opt.motion.plan.candidates import NONE, REPAIRS, Candidate, task_of
from energy_opt.motion.plan.context import Context, path_of
from energy_opt.motion.reshape.curve import Curve, refined
from energy_opt.motion.reshape.search import trajectory_of
from energy_opt.motion.reshape.task import Line, Task
from energy_opt.motion.trajectory import Trajectory

AT_LIMIT, OFTEN = 1e-3, 0.05  # share of a bound within which a joint is at its limit; share of the time, to be busy
SLIGHT = 1e-3  # share of a bound
LOOSE = 1.02  # factor of busy joints' bounds in the search of the others' motion


def with_busy_joints(context: Context, move: Move, timing: Trajectory, optimum: Curve | None = None) -> Candidate:
    """A move as long as a timing of its first path: busy joints keep that timing, the others take that of an optimum.

    Busy are joints that the timing has at a limit, and those of which the optimum breaks a limit by more than `SLIGHT`.
    Smaller excesses are removed by tighter limits.

    Args:
        timing: of hardly more than the least time.
        optimum: a curve of the move in about that time; by default it is searched.

    Returns:
        A candidate, without a trajectory if no such motion is within limits and clear of bodies.
    """
    reshaper, settings = context.freed.reshaper("energy"), context.settings
    task = task_of(context, move, timing.duration, timing.duration)
    busy, spent, starts = _at_limits(context, timing), 0, 0
    if optimum is None:
        lines = [Line.along(path_of(move), timing.duration), Line.of(timing)]
        answer = reshaper.search(_loosened(task, busy), lines, settings.starts, settings.seed, context.stopped)
        optimum, spent, starts = (answer.best or answer.optima[0]).curve, answer.iterations, answer.starts
    curve = refined(task.within(optimum), reshaper.fine(task.vias).shape, task.ends)
    for _ in range(REPAIRS):
        if context.stopped():
            break
        found = reshaper.solved(curve, _loosened(task, busy), context.stopped)
        spent += found.iterations
        motion = trajectory_of(found.curve, context.robot.joints)
        mixed = blended([timing, motion], np.stack([busy, ~busy]).astype(float)).on_nanoseconds()
        certificate = context.judge(mixed).certificate
        if certificate.valid:
            return Candidate(mixed, spent, starts=starts)
        broken = {found.where for found in certificate.found if found.excess is None or found.excess > SLIGHT}
        busy = busy | np.isin(context.robot.joints, list(broken))
        if certificate.within_limits or busy.all():
            break
        task, curve = replace(task, limits=certificate.tightened(task.limits)), found.curve
    return Candidate(None, spent, False, NONE, starts)


def _loosened(task: Task, busy: np.ndarray) -> Task:
    """The task with slightly larger bounds for busy joints (n,), so that a spline can follow about their motion."""
    share = np.where(busy, LOOSE, 1.0)
    return replace(task, limits=tuple(x.scaled(share) if isinstance(x, JointLimit) else x for x in task.limits))


def _at_limits(context: Context, timing: Trajectory) -> np.ndarray:
    """Which joints are at a limit of their own for a twentieth of a timing's samples or more, (n,) of bool."""
    filled = context.judge(timing).filled
    values = {"v": filled.velocity, "a": filled.acceleration, "jerk": filled(filled.time, 3), "effort": filled.effort}
    limits = [limit for limit in context.limits if isinstance(limit, JointLimit)]
    use = np.max([np.abs(values[limit.reads]) / limit.bound for limit in limits], axis=0)
    return np.asarray((use > 1 - AT_LIMIT).mean(axis=0) > OFTEN)
