"""Friction that follows the joint's temperature, or the time of day."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np

from energy_opt.effects.base import Signals
from energy_opt.effects.friction import SIGN_WIDTH
from energy_opt.effects.kinks import Kinks
from energy_opt.effects.parameter import Parameter
from energy_opt.effects.stages import TorqueEffect

DAY = 86400.0  # [s]
AT_WORK = 40.0  # [degC] of a cobot's joint at work, as UR's own calibrations (43 to 46 degC)


class TemperatureFriction(TorqueEffect):
    """(tau_c * sign(v) + b * v) * exp(-rate * (T - reference)): friction that falls as the joint warms.

    Reynolds' law of a lubricant's viscosity. T is the joint's logged temperature; where none is known, as in a plan, it
    is the reference. It is sought where `<joint>.temperature` is logged.
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

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        known = x.temperature is not None
        share = ca.exp(-p.rate * (x.temperature - p.reference)) if known else ca.SX(1)
        return (p.tau_c * k.sign(x.v, SIGN_WIDTH) + p.b * x.v) * share


class DailyFriction(TorqueEffect):
    """(tau_c * sign(v) + b * v) * (1 + share * cos(2 pi (t - peak) / 24 h)): friction that follows the time of day.

    t counts from the set's first sample, `peak` is when friction is largest, as in a hall that is cold at night. A plan
    counts with the day's mean. It is sought in sets that last four hours or more.
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

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        share = 1 + p.share * ca.cos(2 * np.pi * (x.day - p.peak) / DAY) if x.day is not None else ca.SX(1)
        return (p.tau_c * k.sign(x.v, SIGN_WIDTH) + p.b * x.v) * share

    @classmethod
    def example(cls, joints: int, rng: np.random.Generator) -> np.ndarray:
        return np.append(super().example(joints, rng)[:-2], [0.4, 2e4])
