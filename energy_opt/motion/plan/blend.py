"""Weighted means of motions of one move that have the same duration.

Bounds of positions, velocities, accelerations and jerks that hold for each of the motions also hold for their mean.
Losses are nearly convex in the motion, so the mean of motions usually costs no more than the mean of their energies.
The result is judged like any other motion.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linprog

from energy_opt.motion.trajectory import CLOSEST, Trajectory, whole


def least_weights(costs: np.ndarray, excess: np.ndarray) -> np.ndarray | None:
    """Weights of the motions whose mean costs least while no model exceeds its limit, both interpolated linearly.

    Args:
        costs: (N,) J, what is minimised.
        excess: (N, K) J by which the motions cost more than allowed under each of K models.

    Returns:
        (N,) weights that sum to 1; None if no mean keeps within all limits.
    """
    found = linprog(costs, excess.T, np.zeros(excess.shape[1]), np.ones((1, len(costs))), [1.0], method="highs")
    return np.asarray(found.x) if found.success else None


def blended(trajectories: Sequence[Trajectory], shares: np.ndarray) -> Trajectory:
    """The mean of motions of the same ends and duration, weighted by `shares` (N,) or, by joint, (N, n)."""
    time = np.unique(whole(np.concatenate([t.time - t.time[0] for t in trajectories])))
    last = time[-1]
    keep = np.concatenate([[True], np.diff(time) > CLOSEST]) & (time < last - CLOSEST)
    time = np.append(time[keep], last)
    curves = [t.sample(np.minimum(t.time[0] + time, t.time[-1])) for t in trajectories]
    q, v, a = (sum(w * curve[order] for w, curve in zip(shares, curves, strict=True)) for order in range(3))
    q[[0, -1]], v[[0, -1]] = trajectories[0].position[[0, -1]], trajectories[0].velocity[[0, -1]]
    return Trajectory(trajectories[0].joints, time, q, v, a)
