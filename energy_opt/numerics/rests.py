"""Where a signal rests, by its own readings: within their noise, or within the step to which they are rounded."""

from __future__ import annotations

from math import comb

import numpy as np

LASTS = 0.1  # [s] least duration of a rest; a signal that turns round stays within its noise for less
FEWEST = 3  # least readings of a rest: two are the same by chance where a signal turns round
SIGMAS = 6.0  # times the noise's standard deviation: hardly any reading at rest is farther from the others
WHOLE = 0.02  # share of a step by which multiples of it may be off
LEAST_STEP = 1e-9  # smaller changes are errors of binary digits


def difference(x: np.ndarray, order: int) -> np.ndarray:
    """Standard deviation (n,) of differences of signals x (N, n), without the influence of single large ones."""
    return np.asarray(1.48 * np.median(np.abs(np.diff(x, order, axis=0)), axis=0))


def encoder_step(x: np.ndarray) -> np.ndarray:
    """Resolution (n,) of signals x (N, n): the smallest change, if all others are multiples of it; else 0."""
    change = np.abs(np.diff(x, axis=0))
    least = np.min(np.where(change > LEAST_STEP, change, np.inf), axis=0)
    off = np.abs(change / least - np.round(change / least)).max(axis=0)
    return np.where(np.isfinite(least) & (off < WHOLE), least, 0.0)


def at_rest(time: np.ndarray, x: np.ndarray, most: float) -> np.ndarray:
    """True (N, n) where a signal rests: within a span of `LASTS` or more, its readings differ by no more than noise.

    A smoothed speed rings, and so begins before the motion; readings that have not changed show that there is none yet.
    The noise is the least that differences of several orders show, as motion adds to each.

    Args:
        time: (N,) s, increasing. x: (N, n). most: readings that differ by more are no rest, however large the noise.
    """
    count, n = x.shape
    size = max(FEWEST, round(LASTS / float(np.median(np.diff(time)))) + 1) if count > FEWEST else count + 1
    if size > count:
        return np.zeros((count, n), dtype=bool)
    orders = range(1, min(5, count))
    noise = np.min([difference(x, k) / comb(2 * k, k) ** 0.5 for k in orders], axis=0)
    # a value midway between two steps is rounded to either of them
    near = np.minimum(SIGMAS * noise + (1 + WHOLE) * encoder_step(x), most)
    spans = np.lib.stride_tricks.sliding_window_view(x, size, axis=0)
    still = np.concatenate([np.zeros((1, n)), np.cumsum(np.ptp(spans, axis=2) <= near, axis=0)])
    first, last = np.arange(count) - size, np.arange(count)  # of the spans that hold a reading
    return still[np.clip(last + 1, 0, count - size + 1)] > still[np.clip(first + 1, 0, count - size + 1)]
