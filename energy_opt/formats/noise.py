"""Noise of recorded positions: how large it is, and the cut-off at which it is smoothed, for each joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.numerics.signals import smooth

# [Hz] of which the best is taken: below, the start of a move of a second is lost; above, no arm's motion has energy
CUTOFFS = (10.0, 8.0, 6.5, 5.0, 4.0, 3.2, 2.5, 2.0, 1.6, 1.3, 1.0)
FEWEST = 20  # least samples of which noise besides rounding is known
WHITE = 1.5  # fourth differences are 1.9 times the third ones for white noise, and far less for smooth motion
# share of a joint's acceleration that noise may have: it adds the square of this, 1 %, to the energy
NOISY = 0.1
# [rad/s^2, m/s^2] and share of the largest joint's: slower accelerations take next to no torque, and may be noise
LEAST, SLIGHT = 0.01, 0.1
WHOLE = 0.03  # largest difference of a multiple from a whole number
MIDDLE = 1.44  # standard deviation of normal numbers by the mean size of their middle half
BESIDES = 0.25  # steps of the readings: less noise besides their rounding cannot be separated from it
BACK = 0.1  # share of rounded readings that change back from which there is noise besides
SAME = 1e-9  # [rad, m] smaller steps are rounding errors of the numbers themselves


@dataclass(frozen=True)
class Noise:
    """Noise of the readings of each joint.

    Attributes:
        white: (n,) standard deviation of noise that differs from reading to reading, besides rounding [rad, m]; 0 where
            there is none.
        step: (n,) resolution of the readings [rad, m]; 0 where none shows.
        hold: (n,) samples for which a moving joint keeps a reading: their errors are the same.
    """

    white: np.ndarray
    step: np.ndarray
    hold: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """Standard deviation (n,) of a reading [rad, m], rounding included."""
        return np.hypot(self.white, self.step / np.sqrt(12))

    def acceleration(self, step: float, cutoff: float = np.inf, less: float = 0.0) -> np.ndarray:
        """Standard deviation (n,) that noise causes in accelerations of a cubic spline [rad/s^2, m/s^2].

        Args:
            step: [s] between readings. cutoff: [Hz] at which they are smoothed. less: the cut-off of a second spline
                that is subtracted from the first.
        """
        angle = (np.arange(2000) + 0.5) / 2000 * np.pi * min(1.0, 16 * cutoff * step)  # beyond, nothing of it is left
        wave = 2 - 2 * np.cos(angle)
        passed = _response(angle, cutoff * step) - (_response(angle, less * step) if less > 0 else 0.0)
        share = angle[-1] / np.pi * float(np.mean((6 * wave / (4 + 2 * np.cos(angle)) * passed) ** 2))
        return np.asarray(self.total * np.sqrt(self.hold * share) / step**2)


def _response(angle: np.ndarray, cutoff: float) -> np.ndarray:
    """Response of the smoother at `angle` (2 pi for each reading) with a cut-off in cycles for each reading."""
    if cutoff >= 0.45:
        return np.ones_like(angle)
    return np.asarray(1 / (1 + (np.sin(angle / 2) / np.sin(np.pi * cutoff)) ** 6))


def spread(q: np.ndarray, order: int) -> np.ndarray:
    """Standard deviation (n,) of white noise that explains the differences of q (N, n), without single large ones.

    It is taken from the mean of the middle half of their sizes: a median of rounded ones would be rounded, too.
    """
    from scipy.special import comb

    sizes = np.sort(np.abs(np.diff(q, order, axis=0)), axis=0)
    middle = sizes[len(sizes) // 4 : len(sizes) - len(sizes) // 4].mean(axis=0)
    return np.asarray(MIDDLE * middle / np.sqrt(comb(2 * order, order)))


def noise_of(q: np.ndarray, even: np.ndarray) -> Noise:
    """The noise of readings q (N, n) [rad, m]; `even`: they at even times."""
    columns = [_lattice(column) for column in q.T]
    step, hold, back = (np.array(part) for part in zip(*columns, strict=True))
    if len(q) < FEWEST:
        return Noise(np.zeros(len(step)), step, hold)
    third, fourth = spread(even, 3), spread(even, 4)
    ratio = WHITE * np.sqrt(20 / 70)  # of the differences, as those of the standard deviations
    besides = np.sqrt(np.maximum(fourth**2 - step**2 / 12, 0.0))
    white = (fourth > ratio * third) & (besides > np.maximum(BESIDES * step, SAME)) & ((step == 0) | (back > BACK))
    return Noise(np.where(white, besides, 0.0), step, hold)


def _lattice(q: np.ndarray) -> tuple[float, float, float]:
    """Resolution of a joint's readings (N,), 0 if none shows; samples for which it keeps one; share of steps back."""
    steps = np.diff(q)
    changes = np.flatnonzero(np.abs(steps) > SAME)
    if len(changes) < 2:
        return 0.0, 1.0, 0.0
    hold = max(1.0, float(np.median(np.diff(changes))))
    back = float(np.mean(steps[changes][1:] * steps[changes][:-1] < 0))
    steps = np.sort(np.abs(steps[changes]))
    least, most = float(steps[0]), 1.5
    while most * least < 2 * steps[-1]:  # from small multiples to large ones, as degrees may be rounded radians, too
        near = steps[steps <= most * least]
        times = np.round(near / least)
        least, most = float(near @ times / (times @ times)), 4 * most
    if np.abs(steps / least - np.round(steps / least)).max() > WHOLE:
        return 0.0, 1.0, back
    return least, hold, back


def cutoffs_of(even: np.ndarray, step: float, noise: Noise) -> np.ndarray:
    """The cut-off (n,) [Hz] for each joint; infinite where its noise does not matter.

    The cut-off minimises the expected square of the error of accelerations: the noise that passes the smoother, and the
    motion that does not, which is the largest difference from the accelerations at higher cut-offs, as far as noise
    does not explain it. Source: A. Goldenshluger and O. Lepski, Bandwidth selection in kernel density estimation,
    Annals of Statistics 39 (2011).

    Args:
        even: readings (N, n) [rad, m]. step: [s] between them. noise: theirs.
    """
    tried = [cutoff for cutoff in CUTOFFS if cutoff < 0.4 / step]
    out = np.full(even.shape[1], np.inf)
    rough = noise.acceleration(step)
    if len(even) < FEWEST or not tried or not (rough > LEAST).any():
        return out
    found = [np.diff(smooth(even, step, cutoff), 2, axis=0) / step**2 for cutoff in tried]
    errors, sizes = [], []
    for k, cutoff in enumerate(tried):
        passed, lost = noise.acceleration(step, cutoff) ** 2, np.zeros(even.shape[1])
        for higher, other in zip(found[:k], tried[:k], strict=True):
            chance = 1 + 2 / np.sqrt(other * step * len(even))  # two standard deviations above the mean
            explained = chance * noise.acceleration(step, other, cutoff) ** 2
            lost = np.maximum(lost, np.mean((found[k] - higher) ** 2, axis=0) - explained)
        errors.append(passed + lost)
        sizes.append(np.mean(found[k] ** 2, axis=0) - passed)
    best = np.argmin(errors, axis=0), np.arange(even.shape[1])
    size = np.sqrt(np.maximum(np.array(sizes)[best], 0.0))
    matters = rough > np.maximum(NOISY * np.maximum(size, SLIGHT * size.max()), LEAST)
    return np.where(matters, np.array(tried)[best[0]], out)
