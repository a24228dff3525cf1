"""Motions and standstills of an arm in time, on which some laws depend."""

from __future__ import annotations

import numpy as np

from energy_opt.effects.parameter import MOVING_SPEED

BRIEF = 0.1  # [s] shorter motions and standstills are ignored


def moves(time: np.ndarray, v: np.ndarray) -> np.ndarray:
    """True (N,) where any joint moves.

    Motions and standstills shorter than `BRIEF` are ignored: speeds from positions have noise.

    Args:
        time: (N,) s, increasing. v: (N, n) rad/s.
    """
    moving = np.abs(v).max(axis=1) > MOVING_SPEED
    for state in (True, False):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], moving == state, [0]])))
        for first, last in edges.reshape(-1, 2):
            if time[min(last, len(time) - 1)] - time[first] < BRIEF:
                moving[first:last] = not state
    return moving


def idle_time(time: np.ndarray, v: np.ndarray, before: float = -1.0) -> np.ndarray:
    """Time (N,) [s] since the last motion ended; -1 while any joint moves and before it first does, see `moves`.

    Args:
        time: (N,) s, increasing. v: (N, n) rad/s. before: time [s] since an earlier motion ended, at the first instant;
            negative if there was none.
    """
    moving = moves(time, v)
    last = np.maximum.accumulate(np.where(moving, np.arange(len(time)), -1))
    first = np.full(len(time), -1.0) if before < 0 else before + time - time[0]
    return np.where(moving, -1.0, np.where(last < 0, first, time - time[np.maximum(last, 0)]))


def dwells(time: np.ndarray, v: np.ndarray) -> np.ndarray:
    """How many standstills between two motions of a run have passed their middle at each instant (N,), see `moves`.

    Args:
        time: (N,) s, increasing. v: (N, n) rad/s.
    """
    moving = moves(time, v)
    ends, begins = np.flatnonzero(moving[:-1] & ~moving[1:]), np.flatnonzero(~moving[:-1] & moving[1:])
    begins = begins[np.searchsorted(begins, ends[0]) :] if ends.size else begins[:0]
    count = min(len(ends), len(begins))
    middles = (time[ends[:count]] + time[begins[:count]]) / 2
    return np.searchsorted(middles, time, side="right").astype(float)
