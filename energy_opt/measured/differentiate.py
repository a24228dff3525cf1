"""Positions to velocities and accelerations without phase shift, with a cut-off that the data choose.

The smoother minimises sum (y - x)^2 + lambda * sum (third difference of x)^2. Its response at frequency f is
1 / (1 + (sin(pi f dt) / sin(pi f_c dt))^6), one half at the cut-off f_c, with no phase and natural ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.measured.sets import Run

CUTOFFS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0)  # [Hz]
EXCESS = 1.15  # residual variance over that of noise alone, above which a cut-off takes away signal
MARGIN = 1.3  # the cut-off used, over the smallest that leaves the signal whole


@dataclass(frozen=True)
class Smoothing:
    """The chosen cut-off [Hz] and the noise of the position readings that it was judged against [rad]."""

    cutoff: float
    position_noise: float


@dataclass(frozen=True)
class Kinematics:
    """Position, velocity and acceleration (N, n) at the times asked for."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def _uniform(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same signal on an even grid of the same number of samples."""
    from scipy.interpolate import CubicSpline

    grid = np.linspace(time[0], time[-1], len(time))
    step = (time[-1] - time[0]) / (len(time) - 1)
    if np.abs(time - grid).max() < 1e-3 * step:
        return grid, values
    return grid, CubicSpline(time, values)(grid)


def smooth(values: np.ndarray, step: float, cutoff: float) -> np.ndarray:
    """The smoother on evenly spaced rows; values (N, n), step [s], cutoff [Hz]."""
    from scipy.linalg import solveh_banded

    if cutoff >= 0.45 / step or len(values) < 8:
        return values
    weight = 1 / (2 * np.sin(np.pi * cutoff * step)) ** 6
    n = len(values)
    third = np.array([-1.0, 3.0, -3.0, 1.0])
    band = np.zeros((4, n))
    for lag in range(4):
        for k in range(4 - lag):  # D^T D summed over the rows of D
            band[lag, k : n - 3 + k] += third[k] * third[k + lag]
    band *= weight
    band[0] += 1.0
    return solveh_banded(band, values, lower=True)


def _noise_gain(cutoff: float, step: float) -> float:
    """Share of white noise's variance that the smoother takes away."""
    f = (np.arange(2048) + 0.5) / 2048 * 0.5 / step
    high = 1 - 1 / (1 + (np.sin(np.pi * f * step) / np.sin(np.pi * cutoff * step)) ** 6)
    return float(np.mean(high**2))


def choose_smoothing(runs: Sequence[Run]) -> Smoothing:
    """The lowest cut-off that takes away nothing but noise, over the runs that move, with some margin.

    The noise is what lies above the highest usable cut-off; a cut-off is too low when the variance it removes exceeds
    `EXCESS` times what that noise explains.
    """
    moving = [r for r in runs if np.ptp(r.position, axis=0).max() > 0.01]
    if not moving:
        return Smoothing(CUTOFFS[0], 0.0)
    signals = []
    for run in moving:
        grid, q = _uniform(run.time, run.position)
        signals.append((q[:, np.ptp(q, axis=0) > 0.01], float(grid[1] - grid[0])))
    step = float(np.median([s for _, s in signals]))
    usable = [c for c in CUTOFFS if c < 0.3 / step]
    if not usable:
        return Smoothing(0.45 / step, 0.0)

    def removed(cutoff: float) -> float:
        total = sum(float(np.sum((q - smooth(q, s, cutoff)) ** 2)) for q, s in signals)
        return total / sum(q.size for q, _ in signals)

    noise = removed(usable[-1]) / _noise_gain(usable[-1], step)
    best = usable[-1]
    for cutoff in reversed(usable):
        if removed(cutoff) > EXCESS * noise * _noise_gain(cutoff, step):
            break
        best = cutoff
    return Smoothing(min(best * MARGIN, 0.45 / step), float(np.sqrt(noise)))


def kinematics(run: Run, at: np.ndarray, cutoff: float) -> Kinematics:
    """Position, velocity and acceleration at times `at` (M,) [s on the run's clock].

    Logged velocity and acceleration are used where there are any (smoothed alike); the rest is differentiated.
    """
    from scipy.interpolate import make_interp_spline

    def spline(values: np.ndarray, order: int):  # type: ignore[no-untyped-def]
        grid, even = _uniform(run.time, values)
        return make_interp_spline(grid, smooth(even, float(grid[1] - grid[0]), cutoff), k=order)

    position = spline(run.position, 5)
    q = position(at)
    if run.velocity is None:
        v, a = position.derivative(1)(at), position.derivative(2)(at)
    else:
        velocity = spline(run.velocity, 5)
        v, a = velocity(at), velocity.derivative(1)(at)
    if run.acceleration is not None:
        a = spline(run.acceleration, 3)(at)
    return Kinematics(q, v, a)
