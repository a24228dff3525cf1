"""Weighted means of motions of one move that have the same duration.

Bounds of positions, velocities, accelerations and jerks that hold for each of the motions also hold for their mean.
Losses are nearly convex in the motion, so the mean of motions usually costs no more than the mean of their energies.
The result is judged like any other motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import linprog

from energy_opt.motion.plan.robust_models import SAME
from energy_opt.motion.trajectory import CLOSEST, Trajectory, whole

BETWEEN = 0.5, 0.25, 0.1  # shares of another motion in its means with the first one, whose energies are computed


def best_mean(
    motions: Sequence[Trajectory], totals: np.ndarray, planned: int,
    estimate: Callable[[Trajectory], np.ndarray] | None = None,
) -> Trajectory | None:  # fmt: skip
    """The cheapest weighted mean of motions that costs no more than the first one under any model; None: only that one.

    Args:
        motions: N of the same ends and duration.
        totals: (N, K) J under each model; the mean of those of the first `planned` models is minimised.
        estimate: gives the energies (K,) [J] of a motion, for means of the first motion and another one. Without it,
            energies of means are interpolated linearly. They are often lower: then a mean can cost less than the first
            motion under a model under which the other one costs more.
    """
    shares = np.eye(len(motions))
    if estimate is not None:
        shares = np.vstack([shares, *((1 - part) * shares[:1] + part * shares[1:] for part in BETWEEN)])
        means = [estimate(blended(motions, row)) for row in shares[len(motions) :]]
        totals = np.vstack([totals, *means])
    weights = least_weights(totals[:, :planned].mean(axis=1), totals - totals[0])
    if weights is None or weights[0] > 1 - SAME:
        return None
    shares = weights @ shares
    shares[shares < SAME] = 0.0
    return blended(motions, shares / shares.sum()).on_nanoseconds()


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
    used = [k for k, share in enumerate(shares) if np.any(share)]
    trajectories, shares = [trajectories[k] for k in used], np.asarray(shares)[used]
    time = np.unique(whole(np.concatenate([t.time - t.time[0] for t in trajectories])))
    last = time[-1]
    keep = np.concatenate([[True], np.diff(time) > CLOSEST]) & (time < last - CLOSEST)
    time = np.append(time[keep], last)
    curves = [t.sample(np.minimum(t.time[0] + time, t.time[-1])) for t in trajectories]
    q, v, a = (sum(w * curve[order] for w, curve in zip(shares, curves, strict=True)) for order in range(3))
    q[[0, -1]], v[[0, -1]] = trajectories[0].position[[0, -1]], trajectories[0].velocity[[0, -1]]
    return Trajectory(trajectories[0].joints, time, q, v, a)
