"""The minimum of a positive definite quadratic function in a box, by block pivoting.

Fits with a few dozen bounded numbers solve this thousands of times; few bounds bind, so active sets are found in a few
rounds.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dposv

ROUNDS = 4  # most rounds of the search for the active bounds, per unknown
PATIENCE = 3  # rounds without progress before exchanging one unknown at a time


def bounded_step(hessian: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """min 1/2 x^T H x - g^T x with low <= x <= high, by block pivoting.

    Args:
        hessian: H (N, N), positive definite. gradient: g (N,).
        low, high: (N,) with low <= 0 <= high; infinite where there is no bound.

    In each round, all unknowns that break a bound are fixed there, and all fixed ones whose multiplier has the wrong
    sign are freed. If their number does not fall for some rounds, one unknown at a time is exchanged, which always ends
    (Murty's rule; Portugal, Judice and Vicente, Math. Comp. 63, 1994). Unknowns without bounds are eliminated first.
    """
    x = np.zeros(len(gradient))
    bound = np.flatnonzero(np.isfinite(low) | np.isfinite(high))
    loose = np.flatnonzero(~(np.isfinite(low) | np.isfinite(high)))
    if loose.size:
        across = hessian[np.ix_(loose, bound)]
        both = _solved(hessian[np.ix_(loose, loose)], np.column_stack([across, gradient[loose]]))
        h = hessian[np.ix_(bound, bound)] - across.T @ both[:, :-1]
        x[bound] = _pivoted(h, gradient[bound] - across.T @ both[:, -1], low[bound], high[bound])
        x[loose] = both[:, -1] - both[:, :-1] @ x[bound]
        return x
    return _pivoted(hessian, gradient, low, high)


def _pivoted(h: np.ndarray, g: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    held, x = np.zeros(len(g), dtype=bool), np.zeros(len(g))
    fewest, patience = len(g) + 1, PATIENCE
    for _ in range(ROUNDS * (1 + len(g))):
        free, fixed = np.flatnonzero(~held), np.flatnonzero(held)
        x[free] = _solved(h[np.ix_(free, free)], g[free] - h[np.ix_(free, fixed)] @ x[fixed])
        pull = g - h @ x
        wrong = np.where(held, ((x <= low) & (pull > 1e-9)) | ((x >= high) & (pull < -1e-9)),
                         (x < low - 1e-12) | (x > high + 1e-12))  # fmt: skip
        wrong &= ~held | (low < high)
        count = int(wrong.sum())
        if not count:
            break
        if count < fewest:
            fewest, patience = count, PATIENCE
        elif patience:
            patience -= 1
        else:
            wrong[: np.flatnonzero(wrong)[-1]] = False
        held ^= wrong
        x = np.where(held & wrong, np.where(x < low, low, high), x)
    return np.clip(x, low, high)


def _solved(h: np.ndarray, g: np.ndarray) -> np.ndarray:
    """h^-1 g of a positive definite matrix."""
    if not len(h):
        return np.zeros_like(g)
    _, x, info = dposv(h, g)
    return np.asarray(x if info == 0 else np.linalg.lstsq(h, g, rcond=None)[0])
