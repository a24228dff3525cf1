"""The DC link of drives: it stores what they return, up to its capacity C, and gives it back first.

With b the power at the drives of all that share a link, S the energy stored there:

    drawn = max(b dt - S, 0) / dt,    lost = max(S - b dt - C, 0),    S <- min(max(S - b dt, 0), C).
"""

from __future__ import annotations

import numpy as np

NOTHING = 1e-6  # share of the energy that moves in a cycle; a link that gains less than this gains nothing


def through_link(taken: np.ndarray, capacity: float, stored: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Energies [J] that a link draws, and that it loses in its resistor, (N,) each.

    Args:
        taken: (N,) [J] by the drives in each instant, negative while they brake. capacity: [J].
        stored: [J] at the beginning.
    """
    if capacity <= 0:
        return taken.clip(0), -taken.clip(max=0)
    left = stored - np.cumsum(taken)
    drawn = np.maximum.accumulate(np.maximum(-left, 0.0))
    if (left + drawn).max() <= capacity:  # it is never full
        return np.diff(drawn, prepend=0.0), np.zeros_like(taken)
    out = np.zeros((2, len(taken)))
    for k, energy in enumerate(taken.tolist()):
        out[0, k] = max(energy - stored, 0.0)
        stored = max(stored - energy, 0.0)
        out[1, k] = max(stored - capacity, 0.0)
        stored = min(stored, capacity)
    return out[0], out[1]


def in_every_cycle(taken: np.ndarray, capacity: float) -> tuple[np.ndarray, np.ndarray]:
    """`through_link` in a cycle that begins with the energy with which it ends; `taken` is (N,) [J] of one cycle."""
    # from full, or from empty, one cycle leads to the state that repeats
    stored = capacity if taken.sum() < -NOTHING * np.abs(taken).sum() else 0.0
    drawn, lost = through_link(taken, capacity, stored)
    stored += float((drawn - taken - lost).sum())
    return through_link(taken, capacity, min(max(stored, 0.0), capacity))
