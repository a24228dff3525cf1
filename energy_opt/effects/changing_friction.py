"""Friction in the joints that changes: as the arm warms, with its temperature, or with the time of day."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np

from energy_opt.effects.base import Effect, Signals
from energy_opt.effects.friction import SIGN_WIDTH, CoulombFriction, ViscousFriction
from energy_opt.effects.parameter import Kinks, Parameter
from energy_opt.effects.stages import TorqueEffect

SOAKING = (10.0, 2e3)  # [s] range of time constants with which an arm warms up
SOAKING_TRIALS = (12.0, 30.0, 120.0, 500.0)  # [s]
DAY = 86400.0  # [s]
AT_WORK = 40.0  # [degC] temperature of a cobot's joint at work, as in UR's own calibrations (43 to 46 degC)


class ThermalViscous(TorqueEffect):
    """b * v * (1 - share * warm): viscous friction that falls as the grease warms.

    warm = 1 - exp(-t / time_constant), with t since the set's first sample. If the joint's temperature is logged, warm
    is 0 at the set's first temperature and 1 at its highest, linear between them.
    """

    name = "thermal_viscous"
    parameters = (
        Parameter("b", "N m s/rad", 0.0, 0.0, 1e4, "joint"),
        Parameter("share", "1", 0.5, -1.0, 1.0, shapes=True, fit=(0.0, 1.0), trials=(0.5,)),
        Parameter("time_constant", "s", 60.0, 1e-1, 1e5, shapes=True, fit=SOAKING, trials=SOAKING_TRIALS),
    )
    drifts = True
    convex_in_retiming = False
    dissipates = True
    contains = (ViscousFriction.name,)

    @classmethod
    def containing(cls, *others: Effect) -> tuple[Effect, ...]:
        """Friction that does not fall, with each trial of the time constant."""
        b = others[0].values["b"]
        return tuple(cls(b=b, share=0, time_constant=seconds) for seconds in SOAKING_TRIALS)

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """b v (1 - share warm), (n, 1) [N m]."""
        warm = 1 - ca.exp(-x.t / p.time_constant) if x.warmth is None else x.warmth
        return p.b * x.v * (1 - p.share * warm)


class TemperatureFriction(TorqueEffect):
    """(tau_c * sign(v) + b * v) * exp(-rate * (T - reference)): friction that falls as the joint warms.

    Reynolds' law of a lubricant's viscosity. T is the joint's logged temperature; if it is unknown, as in a plan, T is
    the reference. `diagnose` tries this effect if `<joint>.temperature` is logged.
    """

    name = "temperature_friction"
    parameters = (
        Parameter("tau_c", "N m", 0.0, 0.0, 1e3, "joint"),
        Parameter("b", "N m s/rad", 0.0, 0.0, 1e4, "joint"),
        Parameter("rate", "1/K", 0.02, -0.2, 0.2, shapes=True, fit=(-0.05, 0.15), trials=(0.01, 0.03)),
        Parameter("reference", "degC", AT_WORK, -50.0, 150.0, shapes=True, steps=True, trials=(AT_WORK,)),
    )
    follows = ("temperature",)
    convex_in_retiming = False
    dissipates = True
    contains = (CoulombFriction.name, ViscousFriction.name)

    @classmethod
    def containing(cls, *others: Effect) -> tuple[Effect, ...]:
        """Friction that is the same at every temperature."""
        return (cls(tau_c=others[0].values["tau_c"], b=others[1].values["b"], rate=0, reference=AT_WORK),)

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """(tau_c sign(v) + b v) exp(-rate (T - reference)), (n, 1) [N m]; the exponential is 1 if T is unknown."""
        known = x.temperature is not None
        share = ca.exp(-p.rate * (x.temperature - p.reference)) if known else ca.SX(1)
        return (p.tau_c * k.sign(x.v, SIGN_WIDTH) + p.b * x.v) * share


class DailyFriction(TorqueEffect):
    """(tau_c * sign(v) + b * v) * (1 + share * cos(2 pi (t - peak) / 24 h)): friction that follows the time of day.

    t counts from the set's first sample. `peak` is the time at which friction is largest, for example at night in a
    cold hall. A plan uses the day's mean. `diagnose` tries this effect in sets that last four hours or more.
    """

    name = "daily_friction"
    parameters = (
        Parameter("tau_c", "N m", 0.0, 0.0, 1e3, "joint"),
        Parameter("b", "N m s/rad", 0.0, 0.0, 1e4, "joint"),
        Parameter("share", "1", 0.3, -1.0, 1.0, shapes=True, trials=(0.3,)),
        Parameter("peak", "s", DAY / 8, 0.0, DAY, shapes=True, trials=(DAY / 8, 3 * DAY / 8, 5 * DAY / 8, 7 * DAY / 8)),
    )
    follows = ("day",)
    convex_in_retiming = False
    dissipates = True
    contains = (CoulombFriction.name, ViscousFriction.name)

    @classmethod
    def containing(cls, *others: Effect) -> tuple[Effect, ...]:
        """Friction that is the same all day, with each trial of the peak."""
        same = {"tau_c": others[0].values["tau_c"], "b": others[1].values["b"], "share": 0}
        return tuple(cls(**same, peak=DAY * (2 * k + 1) / 8) for k in range(4))

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """(tau_c sign(v) + b v) (1 + share cos(2 pi (t - peak) / DAY)), (n, 1) [N m]; without a time of day, share is
        0.
        """
        share = 1 + p.share * ca.cos(2 * np.pi * (x.day - p.peak) / DAY) if x.day is not None else ca.SX(1)
        return (p.tau_c * k.sign(x.v, SIGN_WIDTH) + p.b * x.v) * share

    @classmethod
    def example(cls, joints: int, rng: np.random.Generator) -> np.ndarray:
        """As of every effect, but with share and peak [s] at values that a day of data shows well."""
        return np.append(super().example(joints, rng)[:-2], [0.4, 2e4])
