"""Joint positions for a libfranka callback: one row for each of its 1 kHz steps, within its discontinuity limits.

libfranka differentiates the commanded positions once, twice and three times from step to step, from rest before the
first to rest after the last, and aborts a motion whose velocity, acceleration or jerk is beyond the arm's limits.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import write_table
from energy_opt.motion.judge.certificate import ALLOWED
from energy_opt.motion.trajectory import Trajectory
from energy_opt.robot import Limits

RATE = 1000.0  # [Hz]
JOINTS = 7
REST = 3  # steps of rest that the differences see before and after


def prepared(trajectory: Trajectory, limits: Limits) -> Trajectory:
    """The trajectory at 1 kHz, slowed by less than a step so that it ends on one; checked as libfranka does.

    Raises:
        BadInput: the arm does not have seven joints, or a difference is beyond its limit; says which, where and why.
    """
    if len(trajectory.joints) != JOINTS:
        raise BadInput(f"--write franka: for arms of seven joints; this one has {len(trajectory.joints)}")
    steps = max(1, math.ceil(trajectory.duration * RATE - 1e-6))
    slowed = trajectory.slowed(steps / RATE)
    time = np.arange(steps + 1) / RATE
    q, v, a, _ = slowed.sample(slowed.time[0] + time)
    q[-1] = trajectory.position[-1]
    out = Trajectory(trajectory.joints, time, q, v, a)
    padded = np.concatenate([np.repeat(q[:1], REST, axis=0), q, np.repeat(q[-1:], REST, axis=0)])
    for order, kind in enumerate(("velocity", "acceleration", "jerk"), start=1):
        values = np.abs(np.diff(padded, order, axis=0)) * RATE**order
        excess = values / getattr(limits, kind) - 1
        k, j = np.unravel_index(int(np.argmax(excess)), excess.shape)
        if excess[k, j] > ALLOWED:
            at = min(max((k - REST) / RATE, 0.0), float(time[-1]))
            ends = k < REST + 1 or k > len(values) - REST - 2
            hint = "; the motion does not begin and end at rest with zero acceleration: reshape it" if ends else ""
            raise BadInput(
                f"--write franka: {kind} of {out.joints[j]} from step to step is {values[k, j]:.6g} at {at:.3f} s, "
                f"beyond {getattr(limits, kind)[j]:.6g}: libfranka would abort it{hint}"
            )
    return out


def write(trajectory: Trajectory, path: Path) -> None:
    """Write `time` and a column of positions for each joint; every digit."""
    write_table(path, ["time", *trajectory.joints], [trajectory.time, *trajectory.position.T])
