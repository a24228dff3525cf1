"""Velocities and accelerations from positions, without phase shift; cut-offs are chosen from each run's data.

The smoother is Whittaker's (`numerics.signals`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.measured.run import Run
from energy_opt.numerics.signals import smooth

CUTOFFS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0)  # [Hz]
MOVED = 0.01  # [rad] a joint that moves less in a run is not used to estimate noise
COARSE = 0.15  # [s] between samples above which positions give no accelerations
EXCESS = 1.15  # residual variance over that of noise alone above which a cut-off removes signal


@dataclass(frozen=True)
class Smoothing:
    """Noise of the readings, used to choose cut-offs.

    Attributes:
        position_noise: [rad] of positions. velocity_noise: [rad/s] of logged velocities.
    """

    position_noise: float
    velocity_noise: float


@dataclass(frozen=True)
class Kinematics:
    """A smoothed motion at the requested times.

    Attributes:
        q, v, a: (N, n) [rad, rad/s, rad/s^2]. cutoffs: (n,) [Hz] that were used.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    cutoffs: np.ndarray


def _uniform(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same signal on an even grid of the same number of samples."""
    from scipy.interpolate import CubicSpline

    grid = np.linspace(time[0], time[-1], len(time))
    step = (time[-1] - time[0]) / (len(time) - 1)
    if np.abs(time - grid).max() < 1e-3 * step:
        return grid, values
    return grid, CubicSpline(time, values)(grid)


def _noise_gain(cutoff: float, step: float) -> float:
    """Share of white noise's variance that the smoother removes."""
    f = (np.arange(2048) + 0.5) / 2048 * 0.5 / step
    high = 1 - 1 / (1 + (np.sin(np.pi * f * step) / np.sin(np.pi * cutoff * step)) ** 6)
    return float(np.mean(high**2))


def choose_smoothing(runs: Sequence[Run]) -> Smoothing:
    """Noise of positions and velocities over the runs that move: the signal above the highest usable cut-off."""
    moving = [r for r in runs if np.ptp(r.position, axis=0).max() > MOVED]
    velocities = [(r.time, r.velocity) for r in moving if r.velocity is not None]
    return Smoothing(_noise([(r.time, r.position) for r in moving]), _noise(velocities))


def _noise(signals: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Standard deviation of white noise that explains what the highest cut-off removes; median over the columns."""
    levels: list[float] = []
    for time, values in signals:
        grid, even = _uniform(time, values)
        step = float(grid[1] - grid[0])
        usable = _usable(step)
        removed = np.mean((even - smooth(even, step, usable[-1])) ** 2, axis=0) / _noise_gain(usable[-1], step)
        levels += [float(x) for x in removed[np.ptp(even, axis=0) > MOVED]]
    return float(np.sqrt(np.median(levels))) if levels else 0.0


def _usable(step: float) -> list[float]:
    """The cut-offs below 0.3 of the sampling rate; at least one."""
    return [c for c in CUTOFFS if c < 0.3 / step] or [0.3 / step]


def choose_cutoffs(values: np.ndarray, step: float, noise: float) -> np.ndarray:
    """For each column the lowest cut-off (n,) [Hz] that removes only noise.

    Args:
        values: (N, n), evenly sampled.
        step: s.
        noise: standard deviation of a reading's noise.
    """
    out = np.full(values.shape[1], np.nan)
    usable = _usable(step)
    for cutoff in usable:
        removed = np.mean((values - smooth(values, step, cutoff)) ** 2, axis=0)
        fits = removed <= EXCESS * noise**2 * _noise_gain(cutoff, step)
        out = np.where(np.isnan(out) & fits, cutoff, out)
    return np.where(np.isnan(out), usable[-1], out)


def kinematics(run: Run, at: np.ndarray, noise: Smoothing) -> Kinematics:
    """Position, velocity and acceleration at times `at` (M,) [s on the run's clock].

    Logged velocity (smoothed alike) and acceleration are used if present; the others are differentiated.
    """
    from scipy.interpolate import make_interp_spline

    if coarse(run):
        return _between(run, at)

    def spline(values: np.ndarray, level: float):  # type: ignore[no-untyped-def]
        grid, even = _uniform(run.time, values)
        step = float(grid[1] - grid[0])
        cutoffs = choose_cutoffs(even, step, level)
        smoothed = even.copy()
        for cutoff in np.unique(cutoffs):
            columns = cutoffs == cutoff
            smoothed[:, columns] = smooth(even[:, columns], step, float(cutoff))
        return make_interp_spline(grid, smoothed, k=5), cutoffs

    position, cutoffs = spline(run.position, noise.position_noise)
    q = position(at)
    if run.velocity is None:
        v, a = position.derivative(1)(at), position.derivative(2)(at)
    else:
        velocity, cutoffs = spline(run.velocity, noise.velocity_noise)
        v, a = velocity(at), velocity.derivative(1)(at)
    if run.acceleration is not None:
        grid, even = _uniform(run.time, run.acceleration)
        a = make_interp_spline(grid, even, k=3)(at)
    return Kinematics(q, v, a, cutoffs)


def coarse(run: Run) -> bool:
    """True if samples are too far apart to know the motion between them."""
    return len(run.time) > 1 and float(np.median(np.diff(run.time))) > COARSE


def _between(run: Run, at: np.ndarray) -> Kinematics:
    """Interpolate linearly between samples too far apart to differentiate twice; accelerations only if logged."""
    n = run.position.shape[1]
    v = np.gradient(run.position, run.time, axis=0) if run.velocity is None else run.velocity
    a = np.zeros_like(v) if run.acceleration is None else run.acceleration
    q, v, a = (np.column_stack([np.interp(at, run.time, c) for c in x.T]) for x in (run.position, v, a))
    return Kinematics(q, v, a, np.full(n, np.inf))
