"""The effects of the meter: how it distorts the true power.

They explain a log and are no property of the arm, so no energy includes them. Each is linear in the power, so the same
law gives the reading and, column by column, its derivatives. `sensitivity` is the exact derivative of the same discrete
law by the effect's own parameter. Before the first sample of a run, the power is assumed to be that of the first
sample.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from energy_opt.effects.base import Effect
from energy_opt.effects.parameter import Parameter

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

SHORTEST_LAG = 1e-4  # [s] a smaller lag counts as none
LAGS = (0.02, 0.06, 0.15, 0.4)  # [s] lags that are tried
DELAYS = tuple(sign * lag for lag in LAGS for sign in (1.0, -1.0))  # [s] delays of a meter's stamps that are tried


class MeterEffect(Effect):
    """Acts on the power of one run over time; those of a model act in the order of `turn`."""

    stage = "meter"
    turn: ClassVar[int] = 9
    late: ClassVar[float] = 0.0  # mean lag of the reading over the effect's parameter; 0 if this is no time

    @classmethod
    def reading(cls, time: np.ndarray, power: np.ndarray, value: float) -> np.ndarray:
        """Readings (N, ...) [W] of the meter at `time` (N,) [s] for a true power of `power` (N, ...) [W]."""
        raise NotImplementedError

    @classmethod
    def sensitivity(cls, time: np.ndarray, power: np.ndarray, value: float) -> np.ndarray:
        """Derivative (N, ...) of the reading of `power` (N, ...) by the effect's parameter."""
        raise NotImplementedError


class MeterDelay(MeterEffect):
    """The meter shows at time t the power of time t - delay.

    Between samples the power is its cubic spline; before the first and after the last sample it is constant.
    """

    name = "meter_delay"
    parameters = (Parameter("delay", "s", 0.0, -5.0, 5.0, fit=(-0.5, 1.0), trials=DELAYS),)
    turn = 1
    late = 1.0

    @classmethod
    def reading(cls, time: np.ndarray, power: np.ndarray, value: float) -> np.ndarray:
        """P(t - delay) (N, ...) [W]."""
        if value == 0:
            return power
        return _spline(time, power)(np.clip(time - value, time[0], time[-1]))

    @classmethod
    def sensitivity(cls, time: np.ndarray, power: np.ndarray, value: float) -> np.ndarray:
        """d reading / d delay = -P'(t - delay); 0 where the power is held constant."""
        shifted = time - value
        slope = _spline(time, power)(np.clip(shifted, time[0], time[-1]), 1)
        slope[(shifted < time[0]) | (shifted > time[-1])] = 0.0
        return -slope


class MeterFilter(MeterEffect):
    """First-order lag of the meter: time_constant * dy/dt + y = p.

    Solved exactly for a power that is linear between samples: with h the step and s = h / time_constant,
    y[k+1] = e y[k] + c1 p[k] + c2 p[k+1], e = exp(-s), c1 = (1 - e) / s - e, c2 = 1 - (1 - e) / s.
    """

    name = "meter_filter"
    parameters = (Parameter("time_constant", "s", 0.0, 0.0, 10.0, fit=(0.0, 2.0), trials=LAGS),)
    turn = 2
    late = 1.0

    @classmethod
    def reading(cls, time: np.ndarray, power: np.ndarray, value: float) -> np.ndarray:
        """y (N, ...) [W] by the recursion of the class text, started in equilibrium: y[0] = p[0].

        The recursion runs on p - p[0], so that it starts from zero.
        """
        if value < SHORTEST_LAG:
            return power
        e, c1, c2 = _weights(_step(time) / value)
        return power[:1] + _recursion(e, c1, c2, power - power[:1])

    @classmethod
    def sensitivity(cls, time: np.ndarray, power: np.ndarray, value: float) -> np.ndarray:
        """dy / d time_constant of the same recursion, by the chain rule over s = h / time_constant.

        With x = p - p[0] and y the filtered x, differentiate y[k+1] = e y[k] + c1 x[k] + c2 x[k+1] by s:

            y_s[k+1] = e y_s[k] + (e_s y[k] + c1_s x[k] + c2_s x[k+1])
            e_s = -e,   c2_s = (1 - e) / s^2 - e / s,   c1_s = -c2_s - e_s

        The bracket drives the same recursion (weights e, 0, 1). Finally ds / d time_constant = -h / time_constant^2.
        For a lag below SHORTEST_LAG the limit is -P'.
        """
        if value < SHORTEST_LAG:
            return -_spline(time, power)(time, 1)
        h = _step(time)
        s = h / value
        e, c1, c2 = _weights(s)
        de = -e  # by s; likewise the two below
        dc2 = (1 - e) / s**2 - e / s
        dc1 = -dc2 - de
        driven = power - power[0]
        y = _recursion(e, c1, c2, driven)
        forcing = np.zeros_like(y)
        forcing[1:] = de * y[:-1] + dc1 * driven[:-1] + dc2 * driven[1:]
        by_s = _recursion(e, 0.0, 1.0, forcing)
        return by_s * (-h / value**2)


class MeterGain(MeterEffect):
    """The meter reads gain times the truth."""

    name = "meter_gain"
    parameters = (Parameter("gain", "1", 1.0, 0.1, 10.0),)
    turn = 3

    @classmethod
    def reading(cls, time: np.ndarray, power: np.ndarray, value: float) -> np.ndarray:
        """gain * P."""
        return value * power

    @classmethod
    def sensitivity(cls, time: np.ndarray, power: np.ndarray, value: float) -> np.ndarray:
        """d reading / d gain = P."""
        return power.copy()


class MeterWindow(MeterEffect):
    """The meter shows the mean of the last `duration` seconds, of a power that is linear between samples.

    With F the integral of the power, y(t) = (F(t) - F(t - d)) / d and dy/dd = (p(t - d) - y(t)) / d.
    """

    name = "meter_window"
    parameters = (Parameter("duration", "s", 0.0, 0.0, 60.0, fit=(0.0, 5.0), trials=LAGS),)
    turn = 4
    late = 0.5

    @classmethod
    def reading(cls, time: np.ndarray, power: np.ndarray, value: float) -> np.ndarray:
        """(F(t) - F(t - d)) / d with F the integral of the piecewise linear power."""
        if value < SHORTEST_LAG:
            return power
        return (_integral(time, power, time) - _integral(time, power, time - value)) / value

    @classmethod
    def sensitivity(cls, time: np.ndarray, power: np.ndarray, value: float) -> np.ndarray:
        """(P(t - d) - y(t)) / d; the limit for d to 0 is -P' / 2."""
        if value < SHORTEST_LAG:
            return -_spline(time, power)(time, 1) / 2
        before = np.maximum(time - value, time[0])
        flat = power.reshape(len(power), -1)
        there = np.column_stack([np.interp(before, time, column) for column in flat.T]).reshape(power.shape)
        return (there - cls.reading(time, power, value)) / value


def _integral(time: np.ndarray, power: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Integral (M, ...) from the first sample to `at` (M,) [s] of powers (N, ...); constant before the first sample."""
    flat = power.reshape(len(power), -1)
    step = np.diff(time)[:, None]
    whole = np.vstack([np.zeros(flat.shape[1]), np.cumsum((flat[1:] + flat[:-1]) / 2 * step, axis=0)])
    k = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    into = np.maximum(at - time[k], 0.0)[:, None]
    slope = (flat[k + 1] - flat[k]) / step[k]
    out = whole[k] + flat[k] * into + slope * into**2 / 2 + flat[:1] * np.minimum(at - time[0], 0.0)[:, None]
    return out.reshape(len(at), *power.shape[1:])


def _spline(time: np.ndarray, power: np.ndarray) -> CubicSpline:
    """Through (N,) times and (N, ...) powers; the last few are kept, as one power is read at several delays."""
    return _cached_spline(*(np.asarray(x, dtype=float).tobytes() for x in (time, power)), power.shape)


@lru_cache(maxsize=64)
def _cached_spline(time: bytes, power: bytes, shape: tuple[int, ...]) -> CubicSpline:
    """The spline of `_spline` from bytes, which can be keys of a cache."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(np.frombuffer(time), np.frombuffer(power).reshape(shape))


def _step(time: np.ndarray) -> float:
    """Mean step [s] of evenly spaced times."""
    return float(time[-1] - time[0]) / (len(time) - 1)


def _weights(s: float) -> tuple[float, float, float]:
    """e = exp(-s), c1 and c2 of `MeterFilter`. (1 - e) / s is computed with expm1, so that small s loses no digits."""
    e = float(np.exp(-s))
    rest = -float(np.expm1(-s)) / s
    return e, rest - e, 1 - rest


def _recursion(e: float, c1: float, c2: float, x: np.ndarray) -> np.ndarray:
    """y[0] = 0, y[k+1] = e y[k] + c1 x[k] + c2 x[k+1], along the first axis of x (N, ...).

    Solved as a triangular band matrix; SciPy's `lfilter` would load all of `scipy.signal`, which takes half a second.
    """
    from scipy.linalg.lapack import dtbtrs

    flat = x.reshape(len(x), -1)
    driven = np.zeros(flat.shape, order="F")
    driven[1:] = c1 * flat[:-1] + c2 * flat[1:]
    band = np.ones((2, len(x)))  # diagonal and subdiagonal
    band[1] = -e
    y, _ = dtbtrs(band, driven, uplo="L", diag="U", overwrite_b=True)
    return np.asarray(y.reshape(x.shape))
