"""Rests of single joints in recorded positions: readings that stay within their noise, and do not drift."""

from __future__ import annotations

import numpy as np

from energy_opt.formats.noise import SAME, Noise
from energy_opt.numerics.signals import SHORTEST

FEWEST = 4  # least readings of a rest: fewer may agree by chance
SIGMAS = 6.0  # times the noise's standard deviation: readings within belong to a rest
STEP = 1.01  # and this many steps of the readings: they may toggle by one
HOLDS = 3.0  # times as long as a moving joint keeps a reading: a shorter pause is no rest
DRIFT = 4.0  # times its standard deviation: a larger change within a rest is a motion
MIDDLE = 0.2  # share of a rest at both of its ends that may belong to the motion


def rests_of(time: np.ndarray, q: np.ndarray, noise: Noise) -> list[list[tuple[float, float]]]:
    """For each joint, the times [s] between which its readings are those of a joint at rest.

    Args:
        time: (N,) [s]. q: (N, n) [rad, m]. noise: of the readings.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    step = float(np.median(np.diff(time)))
    count = max(FEWEST, int(np.ceil(SHORTEST / step - 1e-6)) + 1)
    out: list[list[tuple[float, float]]] = [[] for _ in q.T]
    if count > len(q):
        return out
    whole = np.s_[count // 2 : len(q) - (count - 1) // 2]  # windows within the recording
    near = SIGMAS * noise.white + STEP * noise.step + SAME
    for j, column in enumerate(q.T):
        width = maximum_filter1d(column, count)[whole] - minimum_filter1d(column, count)[whole]
        narrow = np.concatenate([[False], width <= 2 * near[j], [False]])
        edges = np.flatnonzero(np.diff(narrow.astype(int)))
        found: list[tuple[int, int]] = []
        for first, last in zip(edges[::2], edges[1::2] + count - 2, strict=True):
            begin, end = _still(column, (first, last), near[j])
            least = max(SHORTEST - step, HOLDS * noise.hold[j] * step)
            trim = int(MIDDLE * (end - begin))
            brief = end - begin + 1 < FEWEST or time[end] - time[begin] < least
            if brief or _drifts(column[begin + trim : end + 1 - trim], noise.total[j]):
                continue
            if found and time[begin] - time[found[-1][1]] < SHORTEST:  # of a slow motion, not of two rests
                found[-1] = max(found[-1], (begin, end), key=lambda span: span[1] - span[0])
            else:
                found.append((begin, end))
        out[j] = [(float(time[begin]), float(time[end])) for begin, end in found]
    return out


def _still(q: np.ndarray, span: tuple[int, int], near: float) -> tuple[int, int]:
    """First and last of the readings (N,) around the middle of a span that are `near` its median [rad, m]."""
    moves = np.abs(q - np.median(q[span[0] : span[1] + 1])) > near
    ends = np.concatenate([[-1], np.flatnonzero(moves), [len(q)]])
    k = int(np.searchsorted(ends, sum(span) // 2))
    return int(ends[k - 1]) + 1, int(ends[k]) - 1


def _drifts(q: np.ndarray, sigma: float) -> bool:
    """Whether readings (N,) change by more than noise of standard deviation `sigma` explains [rad, m]."""
    place = np.linspace(-0.5, 0.5, len(q))
    change = float(place @ q) / float(place @ place)
    return abs(change) > DRIFT * sigma / np.sqrt(float(place @ place)) + SAME
