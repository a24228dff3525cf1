"""Sampled signals: a smoother without phase shift, and spans in which nothing moves.

The smoother minimises sum (y - x)^2 + lambda sum (third difference of x)^2 (Whittaker's smoother). Its response at
frequency f is 1 / (1 + (sin(pi f dt) / sin(pi f_c dt))^6). It is one half at the cut-off f_c, has no phase, and has
natural ends. This follows from |1 - exp(-i w)|^6 = (2 sin(w / 2))^6 with w = 2 pi f dt, and lambda = 1 / (2
sin(pi f_c dt))^6.
"""

from __future__ import annotations

import numpy as np

STILL_SPEED = 0.01  # [rad/s] the arm is at rest if slower than this for `SHORTEST`
WINDOW = 0.1  # [s] over which speeds are taken: a standstill appears shorter by up to half of it at each end
SHORTEST = 0.25  # [s] a shorter halt does not separate two runs


def smooth(values: np.ndarray, step: float, cutoff: float) -> np.ndarray:
    """The smoother on evenly spaced samples: solves (1 + lambda D^T D) x = y, D the third differences.

    The condition number of this matrix grows with (step cutoff)^-6: at 1 kHz and 1 Hz no digit is left. So x is found
    together with u = sqrt(lambda) D x, by banded elimination of

        x + sqrt(lambda) D^T u = y,     sqrt(lambda) D x - u = 0,

    whose condition number is the square root of that one.

    Args:
        values: y (N, n). step: [s] between samples. cutoff: [Hz]; at 0.45 / step or above nothing is smoothed.
    """
    from scipy.linalg import solve_banded

    if cutoff >= 0.45 / step or len(values) < 8:
        return values
    third = np.array([-1.0, 3.0, -3.0, 1.0]) / (2 * np.sin(np.pi * cutoff * step)) ** 3
    n = len(values)
    # unknown 2 k is x of sample k, and 2 k + 3 is u of samples k ... k + 3; unknowns 1, 2 n - 3 and 2 n - 1 are 0
    band, right = np.zeros((7, 2 * n)), np.zeros((2 * n, *values.shape[1:]))
    band[3, ::2], band[3, 1::2], right[::2] = 1.0, -1.0, values
    for k in range(4):
        below = 3 - 2 * k  # places of u after x
        band[3 + below, 2 * k : 2 * (n - 3 + k) : 2] = third[k]
        band[3 - below, 3 : 2 * n - 3 : 2] = third[k]
    return np.asarray(solve_banded((3, 3), band, right, overwrite_ab=True, overwrite_b=True)[::2])


def smooth_each(values: np.ndarray, step: float, cutoffs: np.ndarray) -> np.ndarray:
    """Evenly spaced samples (N, n), each column smoothed with its own cut-off (n,) [Hz]; infinite: not at all."""
    out = values.copy()
    for cutoff in np.unique(cutoffs):
        columns = cutoffs == cutoff
        out[:, columns] = smooth(values[:, columns], step, float(cutoff))
    return out


def evenly(time: np.ndarray, values: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """As many even times as there are samples, and the samples at these by a cubic spline.

    Args:
        time: (N,) [s]. values: (N, n). tolerance: share of a step within which times count as even already.
    """
    from scipy.interpolate import CubicSpline

    grid = np.linspace(time[0], time[-1], len(time))
    if np.abs(time - grid).max() < tolerance * (time[-1] - time[0]) / (len(time) - 1):
        return grid, values
    return grid, CubicSpline(time, values)(grid)


def standstills(time: np.ndarray, position: np.ndarray, shortest: float = SHORTEST) -> list[tuple[int, int]]:
    """Index ranges [first, last] in which no joint moves for at least `shortest` seconds.

    Speed is the slope over a window of about `WINDOW`, so that encoder steps do not count as motion.

    Args:
        time: (N,) [s]. position: (N, n) [rad, m].
    """
    step = float(np.median(np.diff(time)))
    half = max(1, round(WINDOW / 2 / step))
    lo = np.clip(np.arange(len(time)) - half, 0, None)
    hi = np.clip(np.arange(len(time)) + half, None, len(time) - 1)
    speed = np.abs(position[hi] - position[lo]).max(axis=1) / (time[hi] - time[lo])
    still = np.concatenate([[False], speed < STILL_SPEED, [False]])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    pairs = zip(edges[::2], edges[1::2] - 1, strict=True)
    return [(int(a), int(b)) for a, b in pairs if time[b] - time[a] >= shortest]
