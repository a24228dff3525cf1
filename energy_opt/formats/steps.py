"""Positions alone, one for each step of a controller, which differentiates them from step to step itself."""

from __future__ import annotations

import math

import numpy as np

from energy_opt.motion.limits.base import Violation
from energy_opt.motion.trajectory import Trajectory, whole
from energy_opt.robot import Limits

REST = 3  # steps of rest that the differences see before and after
KINDS = ("velocity", "acceleration", "jerk")


def on_steps(trajectory: Trajectory, rate: float, limits: Limits | None = None) -> Trajectory:
    """The trajectory at a controller's steps, slowed by less than a step so that it ends on one.

    Args:
        rate: Hz.
        limits: with them, an acceleration at an end is spread over as many steps as the jerk limit asks for, by the
            mean of so many positions: no velocity, acceleration or jerk grows by that, and the motion takes these steps
            longer.
    """
    steps = max(1, math.ceil(trajectory.duration * rate - 1e-6))
    slowed = trajectory.slowed(steps / rate)
    q = slowed.sample(np.minimum(slowed.time[0] + np.arange(steps + 1) / rate, slowed.time[-1]))[0]
    q[[0, -1]] = trajectory.position[[0, -1]]
    if limits is not None:
        ends = np.abs(trajectory.acceleration[[0, -1]]).max(axis=0)
        if (ends * rate > limits.jerk).any():
            shares = limits.acceleration * rate / limits.jerk
            width = math.ceil(float(shares[np.isfinite(shares)].max()) - 1e-9)
            q = _mean(q, width)
    return of_steps(trajectory.joints, q, rate)


def _mean(q: np.ndarray, width: int) -> np.ndarray:
    """The mean of `width` positions, at rest before and after, (N + width - 1, n)."""
    padded = np.concatenate([np.repeat(q[:1], width - 1, axis=0), q, np.repeat(q[-1:], width - 1, axis=0)])
    base = padded[width - 1 :]
    count = len(base)
    return np.asarray(base + sum(padded[k : k + count] - base for k in range(width)) / width)


def of_steps(joints: tuple[str, ...], q: np.ndarray, rate: float) -> Trajectory:
    """Positions (N, n) at steps as a trajectory; velocity and acceleration by differences over two steps, at rest
    before and after.
    """
    padded = np.concatenate([q[:1], q, q[-1:]])
    v = (padded[2:] - padded[:-2]) * rate / 2
    a = (padded[2:] - 2 * q + padded[:-2]) * rate**2
    return Trajectory(joints, whole(np.arange(len(q)) / rate), q, v, a)


def worst_step(trajectory: Trajectory, rate: float, limits: Limits) -> Violation:
    """The difference from step to step that uses its limit most, as a controller looks at them."""
    q = trajectory.position
    padded = np.concatenate([np.repeat(q[:1], REST, axis=0), q, np.repeat(q[-1:], REST, axis=0)])
    found = []
    for order, kind in enumerate(KINDS, start=1):
        values, bound = np.diff(padded, order, axis=0) * rate**order, getattr(limits, kind)
        excess = np.abs(values) / bound - 1
        k, j = (int(i) for i in np.unravel_index(int(np.argmax(excess)), excess.shape))
        at = min(max((k - REST) / rate, 0.0), trajectory.duration)
        found.append(
            Violation(kind, float(excess[k, j]), trajectory.joints[j], at, float(values[k, j]), float(bound[j]))
        )
    return max(found, key=lambda violation: violation.excess or -1.0)
