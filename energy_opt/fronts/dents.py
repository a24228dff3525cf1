"""Dents of a front: points that lie above the line between others, where a better optimum is to be looked for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.plan.neighbour import Optimum
from energy_opt.motion.trajectory import Trajectory

ABOVE = 1e-4  # of the loss: less is the solver's tolerance
SAMPLES = 201  # of a mean curve


def dents(duration: np.ndarray, loss: np.ndarray) -> list[tuple[int, int, int]]:
    """Points above the lower convex hull of a front: (point, hull's point before it, hull's point after it).

    Args:
        duration: (P,) [s], ascending. loss: (P,) [J].

    >>> dents(np.array([1.0, 2.0, 3.0]), np.array([2.8, 3.0, 2.8]))
    [(1, 0, 2)]
    """
    hull: list[int] = []
    for k in range(len(duration)):
        while len(hull) > 1 and _above(duration, loss, hull[-2], hull[-1], k) >= 0:
            hull.pop()
        hull.append(k)
    return [
        (k, a, b)
        for a, b in zip(hull[:-1], hull[1:], strict=True)
        for k in range(a + 1, b)
        if _above(duration, loss, a, k, b) > ABOVE * abs(loss[k])
    ]


def _above(duration: np.ndarray, loss: np.ndarray, a: int, k: int, b: int) -> float:
    """How far point k lies above the line from a to b, J."""
    share = (duration[k] - duration[a]) / (duration[b] - duration[a])
    return float(loss[k] - (1 - share) * loss[a] - share * loss[b])


def mean_of(before: Optimum, after: Optimum, duration: float, score: Callable[[Trajectory], Energy]) -> Optimum:
    """The mean of two motions of other durations, at a duration between them [s]: a place to start from."""
    a, b = before.trajectory, after.trajectory
    share = (duration - a.duration) / (b.duration - a.duration)
    at = np.linspace(0.0, 1.0, SAMPLES)
    position = velocity = acceleration = np.zeros((SAMPLES, len(a.joints)))
    for motion, weight in ((a, 1 - share), (b, share)):
        q, v, w, _ = motion.sample(motion.time[0] + at * motion.duration)
        stretch = motion.duration / duration
        position = position + weight * q
        velocity = velocity + weight * stretch * v
        acceleration = acceleration + weight * stretch**2 * w
    mean = Trajectory(a.joints, at * duration, position, velocity, acceleration)
    return Optimum(mean, score(mean), True)
