"""Torque limits under all models of a plan.

A program holds the torque limits under the first of its models. A motor's torque may exceed its limit under another one
(one with friction, or a heavier payload): then the move is solved again with smaller limits of the joints in question.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.motion.judge.certificate import ALLOWED, certify
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.joint import Effort
from energy_opt.motion.trajectory import Trajectory

ROUNDS = 4  # most solves with smaller limits; the torque of friction needs two
BELOW = 2e-3  # share by which a smaller limit is below what the last answer needs


def used(trajectory: Trajectory, scorers: Sequence[Scorer], limits: Sequence[Limit]) -> np.ndarray:
    """The largest share (n,) of each joint's torque limit that a motion uses under any of the models; 0: no limit."""
    n = len(trajectory.joints)
    out = np.zeros(n)
    for limit in limits:
        if isinstance(limit, Effort):
            alone = [Effort(np.where(np.arange(n) == joint, limit.bound, np.inf)) for joint in range(n)]
            for scorer in scorers:
                excess = [found.excess for found in certify(trajectory, scorer, alone).found]
                out = np.maximum(out, [np.inf if e is None else 1 + e for e in excess])
    return out


def smaller(share: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Shares (n,) of the limits for the next solve; the last one had `share` (n,) of them and used `use` (n,)."""
    return np.where(use > 1 + ALLOWED, share / (use * (1 + BELOW)), share)
