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


class CoulombFriction(TorqueEffect):
    """tau_c * sign(v): dry friction. On a fixed path its sign is fixed, so retiming stays convex."""

    name = "coulomb_friction"
    parameters = (Parameter("tau_c", "N m", 0.0, 0.0, 1e3, "joint"),)
    dissipates = True

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return p.tau_c * k.sign(x.v, SIGN_WIDTH)


class ViscousFriction(TorqueEffect):
    """b * v: friction in proportion to speed. Retiming loses its convexity (torque has a term in sqrt(b))."""

    name = "viscous_friction"
    parameters = (Parameter("b", "N m s/rad", 0.0, 0.0, 1e4, "joint"),)
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
