"""Torque limits under all models of a plan.

A program holds the torque limits under the first of its models. A motor's torque may exceed its limit under another one
(one with friction, or a heavier payload): then the move is solved again with smaller limits of the joints in question.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.motion.judge.energy import DENSER, Scorer, blocks
from energy_opt.motion.trajectory import Trajectory

EFFORT_ROUNDS = 4  # most solves with smaller limits; one or two suffice for friction
HELD = 1 - 1e-4  # share of a limit, at the places of the dense grid, below which it holds between them, too
BELOW = 2e-3  # share by which a smaller limit is below what the last answer needs


def used(trajectory: Trajectory, scorers: Sequence[Scorer], bound: np.ndarray) -> np.ndarray:
    """The largest share (n,) of the torque limits `bound` (n,) [N m] that a motion uses under any of the models."""
    peaks = [
        np.abs(scorer.dense(trajectory, DENSER, part).effort).max(axis=0)
        for part in blocks(trajectory, DENSER)
        for scorer in scorers
    ]
    return np.max([np.zeros_like(bound), *peaks], axis=0) / bound


def smaller(share: np.ndarray, use: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Shares (n,) of the torque limits for the next solve, smaller where `use` is beyond the limit.

    Args:
        share: (n,) of the last solve.
        use, own: shares (n,) that its motion uses under the other models, and under the one whose limits are held.
    """
    return np.divide(np.minimum(share, own), use * (1 + BELOW), out=np.array(share), where=use > HELD)
