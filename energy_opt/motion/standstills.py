"""Standstills within a motion: a single move cannot keep one on its way, so given motions are checked for them."""

from __future__ import annotations

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.motion.trajectory import Trajectory

STILL = 1e-3  # share of the top speed below which a joint counts as still
BRIEF = 0.03  # [s] a shorter standstill counts as a turning point
DENSER = 4  # checked places for each sample


def standstills(trajectory: Trajectory) -> np.ndarray:
    """Start and end (W, 2) [s] of the intervals in which no joint moves, including those at both ends."""
    time = trajectory.denser(DENSER)
    speed = np.abs(trajectory.sample(time)[1]).max(axis=1)
    still = np.concatenate([[False], speed <= STILL * max(float(speed.max()), 1e-12), [False]])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    spans = np.stack([time[edges[::2]], time[edges[1::2] - 1]], axis=1)
    rest = trajectory.time[np.abs(trajectory.velocity).max(axis=1) <= 1e-9]
    for span in spans:  # from rest to rest, if it contains samples at rest; a single one is a gentle start or stop
        inside = rest[(rest >= span[0]) & (rest <= span[1])]
        if len(inside):
            span[:] = inside[[0, -1]]
    spans -= trajectory.time[0]
    return np.asarray(spans[spans[:, 1] - spans[:, 0] >= BRIEF])


def check_moves_on(trajectory: Trajectory, where: str) -> None:
    """Raise BadInput if a trajectory rests on its way, which one move cannot keep."""
    for begin, end in standstills(trajectory).tolist():
        if begin > BRIEF and end < trajectory.duration - BRIEF:
            raise BadInput(
                f"{where}: stands still from {begin:.4g} to {end:.4g} s, but one move has no wait; give its parts as "
                "steps of a job (`energy-opt job`), or compute its energy as it is (`energy-opt evaluate`)"
            )
