"""The even clock of a controller, from irregular stamps of a recorder, also if samples are missing.

The samples k have stamps t_k = begin + step (k + s_k) + e_k, with s_k samples missing before them and errors e_k of the
recorder. The step is first the strongest period of the stamps. The numbers s_k are integers that do not decrease:
isotonic regression, rounded, has the least squares e_k. Then step and begin follow from a straight line, and so on.
"""

from __future__ import annotations

import numpy as np

JITTER, FEW = 0.05, 20  # median distance of the steps from their mean, over it, of irregular stamps; least samples
WITHIN, FARTHEST = 0.99, 1.5  # share of the stamps that must be near the even clock: by at most so many of its steps
SMOOTHER = 0.5  # factor on the squares of changes of speed by which values run more smoothly with other stamps
FIRST, NEAR = 1000, 0.15  # samples from which the period is found; its largest distance from the median step, over it
TURNS = 6  # straight lines fitted to a number of samples
ASIDE = 3  # most samples by which the place of a missing one is corrected
CLEARER = 0.2  # factor on the squares of changes of speed around it by which the values must run more smoothly then


def on_even_clock(time: np.ndarray, values: np.ndarray, kept: np.ndarray, stamps: np.ndarray) -> np.ndarray | None:
    """An even clock (N,) for samples with irregular stamps `time` (N,), if it is the better one; else None.

    A recorder writes samples of a controller's clock with stamps of its own. The clock must stay near them, and the
    values (N, m) run more smoothly on it than those of the samples `kept` with their `stamps` (K,): samples
    that were really taken at irregular times, or twice, do not.
    """
    if len(time) < FEW:
        return None
    usual = float(np.median(np.diff(time)))
    step, whole = _line(np.arange(len(time)), time)
    if np.median(np.abs(np.diff(time) - step)) < JITTER * step:
        return None
    clocks = [whole] if np.abs(time - whole).max() <= step else []
    if usual > 0:
        places = _places(time - time[0])
        step, even = _line(places, time)
        if np.quantile(np.abs(time - even), WITHIN) <= FARTHEST * step:
            clocks.append(_line(_settled(places, values), time)[1])

    def rough(at: np.ndarray, x: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore", invalid="ignore"):  # stamps may be the same
            return np.asarray(np.nanmean(np.diff(np.diff(x, axis=0) / np.diff(at)[:, None], axis=0) ** 2, axis=0))

    def smoother(one: np.ndarray, other: np.ndarray) -> bool:
        """True if more of the values run clearly more smoothly in one case than in the other."""
        return bool(np.count_nonzero(one < SMOOTHER * other) > np.count_nonzero(other < SMOOTHER * one))

    best: np.ndarray | None = None
    least = rough(stamps, values[kept])
    for even in clocks:
        own = rough(even, values)
        if smoother(own, least):
            best, least = even, own
    return best


def _line(places: np.ndarray, time: np.ndarray) -> tuple[float, np.ndarray]:
    """Step [s] of the even clock on which samples have these places (N,), and its stamps (N,)."""
    step, begin = (float(x) for x in np.polyfit(places, time - time[0], 1))
    return step, time[0] + begin + step * places


def _places(time: np.ndarray) -> np.ndarray:
    """Places (N,) of samples on an even clock, of which some are missing; `time` (N,) [s] begins at 0."""
    from scipy.optimize import isotonic_regression

    step, begin = _period(time[:FIRST])
    size = min(FIRST, len(time))
    while True:
        count = np.arange(size)
        for _ in range(TURNS):
            missing = isotonic_regression((time[:size] - begin) / step - count).x
            places = count + np.rint(missing).astype(int)
            step, begin = (float(x) for x in np.polyfit(places, time[:size], 1))
        if size == len(time):
            return places
        size = min(2 * size, len(time))


def _settled(places: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Move each missing sample by at most `ASIDE` samples, to where the values (N, m) clearly run more smoothly."""
    places, size = places.copy(), np.maximum(np.nanmean(np.abs(np.diff(values, axis=0)), axis=0), 1e-12)

    def rough(at: np.ndarray, x: np.ndarray) -> float:
        slope = np.diff(x, axis=0) / np.diff(at)[:, None]
        return float(np.nansum((np.diff(slope, axis=0) / size) ** 2))

    for k in (1 + np.flatnonzero(np.diff(places) > 1)).tolist():
        near = slice(max(k - 3 * ASIDE, 0), k + 3 * ASIDE)
        first, tried = k - near.start, [places[near]]
        for aside in range(1, ASIDE + 1):
            for part, by in ((slice(first, first + aside), -1), (slice(max(first - aside, 0), first), 1)):
                other = places[near].copy()
                other[part] += by
                if (np.diff(other) > 0).all():
                    tried.append(other)
        worth = [rough(at, values[near]) for at in tried]
        best = int(np.argmin(worth))
        places[near] = tried[best if worth[best] < CLEARER * worth[0] else 0]
    return places


def _period(time: np.ndarray) -> tuple[float, float]:
    """Period [s] of stamps (N,) near their median step at which most of them are in phase, and this phase [s]."""
    usual = float(np.median(np.diff(time)))
    rates = np.arange((1 - NEAR) / usual, (1 + NEAR) / usual, 1 / (8 * max(float(np.ptp(time)), usual)))
    sums = np.array([np.exp(2j * np.pi * rate * time).sum() for rate in rates])
    best = int(np.argmax(np.abs(sums)))
    return 1 / float(rates[best]), float(np.angle(sums[best])) / (2 * np.pi * float(rates[best]))
