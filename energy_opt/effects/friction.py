"""Friction in the joints, as torque that the motor must add.

Widths of the smoothed sign: 0.01 rad/s, about a hundredth of a cobot's usual joint speed.
"""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca

from energy_opt.effects.base import Signals
from energy_opt.effects.kinks import Kinks
from energy_opt.effects.parameter import Parameter
from energy_opt.effects.stages import TorqueEffect

SIGN_WIDTH = 0.01  # [rad/s]
TORQUE_WIDTH = 0.05  # [N m]
SOAKING = (10.0, 2e3)  # [s] time constants with which an arm warms up
SOAKING_TRIALS = (12.0, 30.0, 120.0, 500.0)  # [s]


class CoulombFriction(TorqueEffect):
    """tau_c * sign(v): dry friction. On a fixed path its sign is fixed, so retiming stays convex."""

    name = "coulomb_friction"
    parameters = (Parameter("tau_c", "N m", 0.0, 0.0, 1e5, "joint", fit=(0.0, 1e3)),)
    dissipates = True

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return p.tau_c * k.sign(x.v, SIGN_WIDTH)


class ViscousFriction(TorqueEffect):
    """b * v: friction in proportion to speed. Retiming loses its convexity (torque has a term in sqrt(b))."""

    name = "viscous_friction"
    parameters = (Parameter("b", "N m s/rad", 0.0, 0.0, 1e6, "joint", fit=(0.0, 1e4)),)
    convex_in_retiming = False
    dissipates = True

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return p.b * x.v


class StribeckFriction(TorqueEffect):
    """tau_s * exp(-(v / v_s)^2) * sign(v): extra breakaway torque at low speed."""

    name = "stribeck_friction"
    parameters = (
        Parameter("tau_s", "N m", 0.0, 0.0, 1e3, "joint"),
        Parameter("v_s", "rad/s", 0.1, 1e-3, 10.0, shapes=True, fit=(5e-3, 1.5), trials=(0.03, 0.1, 0.3)),
    )
    convex_in_retiming = False
    dissipates = True

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return p.tau_s * ca.exp(-((x.v / p.v_s) ** 2)) * k.sign(x.v, SIGN_WIDTH)


class LoadFriction(TorqueEffect):
    """mu * |tau| * sign(v): friction of gears under load."""

    name = "load_friction"
    parameters = (Parameter("mu", "1", 0.0, 0.0, 1.0, "joint"),)
    convex_in_retiming = False  # tau_m^2 bends inwards at tau = 0 where a spring or a rotor keeps tau_m from zero there
    dissipates = True

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return p.mu * k.magnitude(x.tau, TORQUE_WIDTH) * k.sign(x.v, SIGN_WIDTH)


class GearEfficiency(TorqueEffect):
    """tau / eta where the motor drives the joint (tau * v > 0), tau * eta where the joint drives the motor.

    Both cases in one expression: tau * (c + s * sign(tau * v)) with c = (1/eta + eta)/2 and s = (1/eta - eta)/2.
    At rest (v = 0) neither side drives; sign(0) = 0 leaves the mean of the two, c.
    """

    name = "gear_efficiency"
    parameters = (Parameter("eta", "1", 1.0, 0.05, 1.0, "joint", fit=(0.2, 1.0)),)
    convex_in_retiming = False  # as load friction
    dissipates = True

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        mean, half = (1 / p.eta + p.eta) / 2, (1 / p.eta - p.eta) / 2
        return x.tau * (mean - 1) + half * k.magnitude(x.tau, TORQUE_WIDTH) * k.sign(x.v, SIGN_WIDTH)


class AsymmetricFriction(TorqueEffect):
    """tau_plus where v > 0, -tau_minus where v < 0: dry friction that differs by direction.

    Written as m s + d s^2 with s = sign(v), m the mean and d half the difference: nothing at rest. Convex in retiming,
    as Coulomb friction is.
    """

    name = "asymmetric_friction"
    parameters = (
        Parameter("tau_plus", "N m", 0.0, 0.0, 1e3, "joint"),
        Parameter("tau_minus", "N m", 0.0, 0.0, 1e3, "joint"),
    )
    dissipates = True

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        s = k.sign(x.v, SIGN_WIDTH)
        return (p.tau_plus + p.tau_minus) / 2 * s + (p.tau_plus - p.tau_minus) / 2 * s**2


class PowerLawFriction(TorqueEffect):
    """c * |v|^exponent * sign(v): lubricated gears, between dry (exponent 0) and viscous friction (1)."""

    name = "power_law_friction"
    parameters = (
        Parameter("c", "N m (s/rad)^exponent", 0.0, 0.0, 1e3, "joint"),
        Parameter("exponent", "1", 0.5, 0.05, 3.0, shapes=True, fit=(0.1, 2.5), trials=(0.35, 0.6, 1.6)),
    )
    convex_in_retiming = False
    dissipates = True

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return p.c * k.power(x.v, p.exponent, SIGN_WIDTH)


class ThermalViscous(TorqueEffect):
    """b * v * (1 - share * warm): viscous friction that falls as the grease warms.

    warm = 1 - exp(-t / time_constant), t since the set's first sample; where the joint's temperature is logged, how far
    it has come from the set's first value to its highest.
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

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        warm = 1 - ca.exp(-x.t / p.time_constant) if x.warmth is None else x.warmth
        return p.b * x.v * (1 - p.share * warm)


class SigmoidFriction(TorqueEffect):
    """a / (1 + exp(-k (v + c))) - a / (1 + exp(-k c)): friction that rises smoothly from 0 and levels off.

    The form in which the Panda's friction is published (Gaz, Cognetti, Oliva, Robuffo Giordano and De Luca, IEEE RA-L
    4(4), 2019). A level friction of a (1 +- tanh(k c / 2)) / 2 by direction; k / 2 is how steep it is about v = -c.
    """

    name = "sigmoid_friction"
    parameters = (
        Parameter("a", "N m", 0.0, 0.0, 1e3, "joint"),
        Parameter("k", "s/rad", 10.0, 1e-2, 1e3, "joint", shapes=True),
        Parameter("c", "rad/s", 0.0, -10.0, 10.0, "joint", shapes=True),
    )
    convex_in_retiming = False
    dissipates = True
    sought = False  # dry and viscous friction say the same of data

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return p.a / 2 * (ca.tanh(p.k * (x.v + p.c) / 2) - ca.tanh(p.k * p.c / 2))
