"""Moves in hardly more than their least time: joints that need all of it keep the first path's timing.

In the least time, some joint is at a limit all the time. Its acceleration jumps from bound to bound, which no spline of
a few control points can do. But that joint has no choice: its motion is that of the first path's timing. The other
joints have time to spare and are reshaped.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.motion.limits.joint import JointLimit
from energy_opt.motion.plan.blend import blended
from energy_opt.motion.plan.context import Context
from energy_opt.motion.reshape.curve import Curve
from energy_opt.motion.reshape.search import Reshaper, trajectory_of
from energy_opt.motion.reshape.task import Task
from energy_opt.motion.trajectory import Trajectory

AT_LIMIT, OFTEN = 1e-3, 0.05  # share of a bound within which a joint is at its limit; share of the time, to be busy
LOOSE = 1.02  # factor of busy joints' bounds in the search of the others' motion: a spline then follows about theirs


def with_busy_joints(
    context: Context, reshaper: Reshaper, task: Task, curve: Curve, timing: Trajectory
) -> tuple[Trajectory | None, int]:
    """The optimum near a curve with the motion of busy joints replaced by that of a timing; None if that breaks limits.

    Busy are joints that the timing has at a limit, and those of which the optimum breaks a limit.

    Args:
        curve: nearly an optimum of the task. timing: of the first path, as long as the curve.

    Returns:
        The motion, and the iterations spent.
    """
    busy, spent = _at_limits(context, timing), 0
    while not context.stopped():
        share = np.where(busy, LOOSE, 1.0)
        limits = tuple(x.scaled(share) if isinstance(x, JointLimit) else x for x in task.limits)
        found = reshaper.solved(curve, replace(task, limits=limits), context.stopped)
        spent += found.iterations
        motion = trajectory_of(found.curve, context.robot.joints)
        mixed = blended([timing, motion], np.stack([busy, ~busy]).astype(float)).on_nanoseconds()
        certificate = context.judge(mixed).within
        if certificate.valid:
            return mixed, spent
        more = busy | (np.array(context.robot.joints) == certificate.worst["joint"])
        if more.all() or (more == busy).all():
            break
        busy, curve = more, found.curve
    return None, spent


def _at_limits(context: Context, timing: Trajectory) -> np.ndarray:
    """Which joints are at a limit of their own for a twentieth of a timing's samples or more, (n,) of bool."""
    filled = context.judge(timing).filled
    assert filled.effort is not None
    values = {"v": filled.velocity, "a": filled.acceleration, "jerk": filled(filled.time, 3), "effort": filled.effort}
    limits = [limit for limit in context.limits if isinstance(limit, JointLimit)]
    use = np.max([np.abs(values[limit.reads]) / limit.bound for limit in limits], axis=0)
    return np.asarray((use > 1 - AT_LIMIT).mean(axis=0) > OFTEN)
