"""Velocities and accelerations from positions, without phase shift; cut-offs are chosen from each run's data.

The smoother is Whittaker's (`numerics.signals`). Where the acceleration jumps, as between the parts of a trapezoidal
speed profile, smoothed positions do not show when: the smoothed acceleration is wrong beside the jump, over a time in
proportion to 1 / cut-off. A second, lower cut-off shows by how much (Richardson's extrapolation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.measured.run import Run
from energy_opt.numerics.rests import at_rest
from energy_opt.numerics.signals import evenly, smooth, smooth_each

CUTOFFS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0)  # [Hz]
EVEN = 1e-3  # share of a step by which even times may differ
MOVED = 0.01  # [rad] a joint that moves less in a run is not used to estimate noise
COARSE = 0.15  # [s] between samples above which positions give no accelerations
EXCESS = 1.15  # residual variance over that of noise alone above which a cut-off removes signal
LOWER = 0.7  # the lower cut-off, over the cut-off, with which errors beside jumps of the acceleration are estimated
# Rms error of velocity and acceleration beside such a jump, over the rms change by the lower cut-off: the roots of
# int (1 - H(x))^2 x^-k dx / int (H(x) - H(x / LOWER))^2 x^-k dx with the response H(x) = 1 / (1 + x^6), k = 4 and 2.
BESIDE_JUMP = (1.03, 2.46)
SIGMAS = 4.0  # standard deviations of this change's noise beyond which it is a jump
NORMAL_MEDIAN = 0.6745  # median of |x| of a standard normal x
CLIPS, CLIPPED = 10, 3.0  # rounds in which the noise's largest values are left out, and from how many deviations on
RINGS = 1.5  # periods of the lower cut-off in which the smoothing's response falls to a thousandth
SAME_PLACE = 2e-3  # [rad, m] a joint whose readings stay within this, and within their noise, may be at rest


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
        rest: (N, n) True for joints that rest by their readings where a smoothed speed rings, beside jumps of the
            acceleration; False where not asked for.
        still: (N, n) True for joints that rest by their readings; True where not asked for.
        jumps: (N, 2 n) [rad/s, rad/s^2] errors of v and a beside jumps of the acceleration, with the signs of the
            changes by a lower cut-off; 0 elsewhere, and where not asked for.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    cutoffs: np.ndarray
    rest: np.ndarray
    still: np.ndarray
    jumps: np.ndarray


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
        grid, even = evenly(time, values, EVEN)
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


def kinematics(run: Run, at: np.ndarray, noise: Smoothing, details: bool = False) -> Kinematics:
    """Position, velocity and acceleration at times `at` (M,) [s on the run's clock].

    Logged velocity (smoothed alike) and acceleration are used if present; the others are differentiated. `details`:
    also find rests, and estimate errors beside jumps of the acceleration (a logged one has none).
    """
    from scipy.interpolate import make_interp_spline

    if coarse(run):
        return _between(run, at)
    logged = run.velocity is not None
    grid, even = evenly(run.time, run.position, EVEN)
    step = float(grid[1] - grid[0])
    cutoffs = choose_cutoffs(even, step, noise.position_noise)
    q = make_interp_spline(grid, smooth_each(even, step, cutoffs), k=5)(at)
    if run.velocity is not None:
        grid, even = evenly(run.time, run.velocity, EVEN)
        cutoffs = choose_cutoffs(even, step, noise.velocity_noise)

    def slopes(share: float) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and acceleration with a share of the cut-offs."""
        curve = make_interp_spline(grid, smooth_each(even, step, share * cutoffs), k=5)
        return (curve(at), curve.derivative(1)(at)) if logged else (curve.derivative(1)(at), curve.derivative(2)(at))

    v, a = slopes(1.0)
    rest, changes = np.zeros(v.shape, dtype=bool), np.zeros((len(at), 2 * v.shape[1]))
    still = ~rest
    if details:
        resting = at_rest(run.time, run.position, SAME_PLACE)
        after = np.clip(np.searchsorted(run.time, at), 0, len(resting) - 1)
        still = resting[after] & resting[np.maximum(after - 1, 0)]  # both readings beside a time belong to a rest
    if run.acceleration is not None:
        a = make_interp_spline(*evenly(run.time, run.acceleration, EVEN), k=3)(at)
    elif details:
        lower = slopes(LOWER)
        beside, rings = (_beside_jumps(at, a - lower[1], still, cutoffs, periods) for periods in (0.5, RINGS))
        rest = still & rings
        changes = np.where(np.tile(beside, 2), np.column_stack([v - lower[0], a - lower[1]]), 0.0)
        changes *= np.repeat(BESIDE_JUMP, v.shape[1])
    return Kinematics(q, v, a, cutoffs, rest, still, changes)


def _beside_jumps(
    at: np.ndarray, change: np.ndarray, rest: np.ndarray, cutoffs: np.ndarray, periods: float
) -> np.ndarray:
    """True (M, n) within some `periods` of the lower cut-off from a jump of the acceleration.

    Args:
        at: (M,) s, increasing. change: (M, n) [rad/s^2] of the acceleration by the lower cut-off. rest: (M, n) True for
            joints at rest. cutoffs: (n,) [Hz].
    """
    out = np.zeros(change.shape, dtype=bool)
    for j, cutoff in enumerate(cutoffs):
        size = np.where(rest[:, j], 0.0, np.abs(change[:, j]))
        noise, level = size[size > 0], np.inf
        for _ in range(CLIPS):
            noise = noise[noise <= CLIPPED * level]
            level = float(np.median(noise)) / NORMAL_MEDIAN if len(noise) else np.inf
        jumps = np.concatenate([[0], np.cumsum(size > SIGMAS * level)])
        near = periods / (LOWER * cutoff)
        out[:, j] = jumps[np.searchsorted(at, at + near, side="right")] > jumps[np.searchsorted(at, at - near)]
    return out


def coarse(run: Run) -> bool:
    """True if samples are too far apart to know the motion between them."""
    return len(run.time) > 1 and float(np.median(np.diff(run.time))) > COARSE


def _between(run: Run, at: np.ndarray) -> Kinematics:
    """Interpolate linearly between samples too far apart to differentiate twice; accelerations only if logged."""
    n = run.position.shape[1]
    v = np.gradient(run.position, run.time, axis=0) if run.velocity is None else run.velocity
    a = np.zeros_like(v) if run.acceleration is None else run.acceleration
    q, v, a = (np.column_stack([np.interp(at, run.time, c) for c in x.T]) for x in (run.position, v, a))
    none = np.zeros(q.shape, dtype=bool)
    return Kinematics(q, v, a, np.full(n, np.inf), none, ~none, np.zeros((len(at), 2 * n)))
