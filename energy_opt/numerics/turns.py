"""Angles of a recorder that counts within one turn: where it wraps, they jump by a whole turn."""

from __future__ import annotations

import numpy as np

from energy_opt.numerics.signals import SHORTEST

TURN = 2 * np.pi  # [rad] the jump of an angle that wraps
# [rad] most that is left of a wrap without its turn, and times its neighbours' steps: other jumps are no wraps
LEFT, UNLIKE = 0.1, 3.0


def wraps(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Whole turns (N - 1, n) by which angles jump from one sample to the next; 0 where there is time for a real turn.

    Args:
        time: (N,) [s]. position: (N, n) [rad].
    """
    step = np.diff(position, axis=0)
    turns = np.rint(step / TURN)
    rest = np.abs(step - TURN * turns)
    near = np.pad(np.where(turns == 0, np.abs(step), 0.0), ((1, 1), (0, 0)))
    turns[rest > np.maximum(LEFT, UNLIKE * np.maximum(near[:-2], near[2:]))] = 0.0
    turns[np.diff(time) > SHORTEST] = 0.0
    return turns


def without(turns: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Positions (N, n) that pass on where they jumped by `turns` (N - 1, n)."""
    out = position.copy()
    out[1:] -= TURN * np.cumsum(turns, axis=0)
    return out
