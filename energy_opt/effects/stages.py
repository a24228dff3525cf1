"""The base classes of the effects, one for each stage of the power law (see `base`), and the effects of the meter.

Effects of the stage "meter" describe how the meter distorts the true power. They explain a log, not an arm, and never
belong to an energy. Each is linear in the power, so the same law gives the reading and, column by column, its
derivatives. `sensitivity` is the exact derivative of the same discrete law by the effect's own parameter. Before the
first sample of a run, the power is assumed to be that of the first sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca
import numpy as np

from energy_opt.effects.base import Effect, Signals
from energy_opt.effects.parameter import Kinks, Parameter

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# Mass [kg], centre of mass (3, 1) [m], inertia (3, 3) [kg m^2] about it: numbers or symbols.
Link = tuple[Any, Any, Any]


class RigidEffect(Effect):
    """Changes the rigid body itself."""

    stage = "rigid"

    @classmethod
    def gravity(cls, gravity: ca.SX, p: SimpleNamespace) -> ca.SX:
        """Gravity (3, 1) [m/s^2] in the base frame, from what it is without the effect."""
        return gravity

    @classmethod
    def links(cls, nominal: Sequence[Link], p: SimpleNamespace) -> list[Link] | None:
        """Actual links, in joint order, from the URDF's links; None for an effect that does not change them."""
        return None

    @classmethod
    def point_mass(cls, p: SimpleNamespace) -> tuple[ca.SX, ca.SX] | None:
        """Mass [kg] and its place (3, 1) [m] in the last joint's frame; None for an effect that adds none."""
        return None

    @classmethod
    def held(cls, x: Signals, p: SimpleNamespace) -> tuple[ca.SX, ca.SX, ca.SX] | None:
        """Mass [kg], place (3, 1) [m] in the last joint's frame and the share of it that is there at an instant.

        None for an effect whose mass does not change in mid-run. In plans such a mass is not there.
        """
        return None


class TorqueEffect(Effect):
    """Adds to the motor's torque at the joint side."""

    stage = "torque"

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Added torque, N m, shape (n, 1)."""
        raise NotImplementedError


class HeatEffect(Effect):
    """Heat of each joint's drive, part of its drive power."""

    stage = "heat"

    @classmethod
    def heat(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Power per joint, W, shape (n, 1)."""
        raise NotImplementedError


class WindingEffect(Effect):
    """Multiplies the heat of the effects that it `needs`."""

    stage = "winding"

    @classmethod
    def factor(cls, x: Signals, p: SimpleNamespace) -> ca.SX:
        """Factor on that heat, a scalar or (n, 1)."""
        raise NotImplementedError


class SoakingEffect(WindingEffect):
    """Multiplies heat by what the joints' own heat did before: its law runs over time.

    Its last parameter says how long it remembers; the signal `heated` depends on that one alone.
    """

    follows = ("heated",)

    @classmethod
    def soaked(cls, time: np.ndarray, heat: np.ndarray, values: np.ndarray) -> np.ndarray:
        """The signal `heated` (N, n) [W] from the heat (N, n) [W] at times (N,) [s]; `values` are as `full`."""
        raise NotImplementedError


class DriveEffect(Effect):
    """What becomes of the joints' drive power on its way to the bus."""

    stage = "drive"

    @classmethod
    def drawn(cls, drive: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Power drawn by the drives, W, from their drive power (n, 1)."""
        raise NotImplementedError


class StoreEffect(DriveEffect):
    """Keeps some of the drives' negative power and gives it back: its law runs over time.

    `drawn` replaces it where the past is unknown: nothing comes back, so a plan's energy is never below the
    truth. Where the motion is known in order, `supplied` is the law.
    """

    follows = ("returned",)

    @classmethod
    def supplied(cls, step: np.ndarray, bus: np.ndarray, value: float) -> np.ndarray:
        """Power (N,) [W] that the supply gives, from the drives' power `bus` (N,) [W], each for `step` (N,) s."""
        raise NotImplementedError


class PowerEffect(Effect):
    """Adds to the power of the whole arm."""

    stage = "power"

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Added power, W, a scalar."""
        raise NotImplementedError

    @classmethod
    def constant(cls, p: SimpleNamespace) -> ca.SX | float:
        """Power, W, that it adds at every instant, whatever the arm does."""
        return 0.0


class SupplyEffect(Effect):
    """Between the drives and the meter."""

    stage = "supply"

    @classmethod
    def at_meter(cls, power: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Power at the meter, W, from the power behind the supply."""
        raise NotImplementedError


SHORTEST_LAG = 1e-4  # [s] a smaller lag counts as none
LAGS = (0.02, 0.06, 0.15, 0.4)  # [s] lags that are tried
DELAYS = tuple(sign * lag for lag in LAGS for sign in (1.0, -1.0))  # [s] delays of a meter's stamps that are tried


class MeterEffect(Effect):
    """Acts on the power of one run over time; those of a model act in the order of `turn`."""

    stage = "meter"
    turn: ClassVar[int] = 9

    @classmethod
    def reading(cls, time: np.ndarray, power: np.ndarray, value: float) -> np.ndarray:
        """What the meter shows (N, ...) [W] at `time` (N,) [s] when the power there is `power` (N, ...)."""
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
    sought = False  # a window declared in [meter] is applied as such; a lag and a delay fit data nearly as well

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
    return _kept(*(np.asarray(x, dtype=float).tobytes() for x in (time, power)), power.shape)


@lru_cache(maxsize=64)
def _kept(time: bytes, power: bytes, shape: tuple[int, ...]) -> CubicSpline:
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

    `lfilter` starts with y[0] = c2 x[0]. Its contribution decays as e^k and is subtracted.
    """
    from scipy.signal import lfilter

    y = lfilter([c2, c1], [1.0, -e], x, axis=0)
    start = c2 * x[:1]  # what lfilter put into y[0]
    decay = e ** np.arange(len(x)).reshape(-1, *([1] * (x.ndim - 1)))
    return y - decay * start
