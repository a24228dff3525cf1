"""Postures of an arm, seeded: where a question about all of them is answered by many."""

from __future__ import annotations

import numpy as np

from energy_opt.robot.limits import Limits

TURN = np.pi  # [rad or m]


def postures(limits: Limits, count: int = 100, seed: int = 0) -> np.ndarray:
    """(count, n) [rad or m]: the middle of all ranges, then random ones; at most half a turn from what is nearest 0."""
    nearest = np.clip(0.0, limits.lower, limits.upper)
    low, high = np.maximum(limits.lower, nearest - TURN), np.minimum(limits.upper, nearest + TURN)
    q = np.random.default_rng(seed).uniform(low, high, (count, len(low)))
    q[0] = (low + high) / 2
    return q
