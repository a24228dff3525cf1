"""Polynomials on pieces of a motion by their Bernstein coefficients: a piece lies between its smallest and largest.

Coefficients are (d + 1, ...) arrays of polynomials of degree d on x in [0, 1]; the first and the last are the values at
the ends. Source: G. Farin, Curves and Surfaces for CAGD, chapters 4 and 5.
"""

from __future__ import annotations

from functools import lru_cache
from math import comb

import numpy as np

from energy_opt.motion.trajectory import Trajectory

ROUNDS = 60  # halvings of a piece: a double has 52 bits


def quintics(trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (6, N - 1, n) of the curve between samples, less each piece's first position; and the steps [s]."""
    h = np.diff(trajectory.time)[:, None]
    q, v, a = trajectory.position, h * trajectory.velocity[:-1] / 5, h**2 * trajectory.acceleration[:-1] / 20
    far, w, c = q[1:] - q[:-1], h * trajectory.velocity[1:] / 5, h**2 * trajectory.acceleration[1:] / 20
    return np.stack([np.zeros_like(v), v, 2 * v + a, far - 2 * w + c, far - w, far]), h


def slope(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Coefficients of the derivative by time of pieces that take h [s]."""
    return np.asarray((len(c) - 1) * np.diff(c, axis=0) / h)


@lru_cache(maxsize=4)
def _from_values(degree: int) -> np.ndarray:
    """From values at degree + 1 even places to coefficients."""
    x = np.linspace(0, 1, degree + 1)[:, None]
    k = np.arange(degree + 1)
    powers = np.array([comb(degree, i) for i in k]) * x**k * (1 - x) ** (degree - k)
    return np.asarray(np.linalg.inv(powers))


def through(values: np.ndarray) -> np.ndarray:
    """Coefficients of the polynomials through values (d + 1, ...) at even places."""
    return np.tensordot(_from_values(len(values) - 1), values, axes=1)


def split(c: np.ndarray, x: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of both parts of pieces that are cut at x, by de Casteljau's algorithm."""
    left, right = [c[0]], [c[-1]]
    while len(c) > 1:
        c = (1 - x) * c[:-1] + x * c[1:]
        left.append(c[0])
        right.append(c[-1])
    return np.stack(left), np.stack(right[::-1])


def peak(c: np.ndarray, known: float, tolerance: float) -> tuple[float, int, float]:
    """The largest value of polynomials (d + 1, M) to within `tolerance`; which of them, and x there.

    `known` is a value that is reached: what surely lies below it is not looked at. Returns (-inf, 0, 0) where that is
    all.
    """
    best = (-np.inf, 0, 0.0)
    number = np.flatnonzero(c.max(axis=0) > known + tolerance)
    c, low, width = c[:, number], np.zeros(len(number)), 1.0
    for _ in range(ROUNDS):
        for row, x in ((c[0], low), (c[-1], low + width)):
            if len(row) and row.max() > max(best[0], known):
                k = int(np.argmax(row))
                best = (float(row[k]), int(number[k]), float(x[k]))
        kept = c.max(axis=0) > max(best[0], known) + tolerance
        if not kept.any():
            break
        c, number, low, width = c[:, kept], number[kept], low[kept], width / 2
        c = np.concatenate(split(c, 0.5), axis=1)
        number, low = np.tile(number, 2), np.concatenate([low, low + width])
    return best
