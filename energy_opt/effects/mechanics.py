"""Torque effects that store energy rather than lose it."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca

from energy_opt.effects.base import Kinks, Parameter, Signals, TorqueEffect


class Armature(TorqueEffect):
    """inertia * a: the rotor's inertia reflected to the joint side (gear ratio squared times rotor inertia)."""

    name = "armature"
    parameters = (Parameter("inertia", "kg m^2", 0.0, 0.0, 1e3, "joint"),)

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return p.inertia * x.a

    @classmethod
    def stored(cls, q: ca.SX, v: ca.SX, p: SimpleNamespace) -> ca.SX:
        """Kinetic energy of the rotors, J."""
        return ca.dot(p.inertia * v, v) / 2


class GravitySpring(TorqueEffect):
    """-stiffness * (q - rest): a spring that helps the motor, as gravity compensators do."""

    name = "gravity_spring"
    parameters = (
        Parameter("stiffness", "N m/rad", 0.0, -1e5, 1e5, "joint"),
        Parameter("rest", "rad", 0.0, -100.0, 100.0, "joint", shapes=True),
    )

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return -p.stiffness * (x.q - p.rest)

    @classmethod
    def stored(cls, q: ca.SX, v: ca.SX, p: SimpleNamespace) -> ca.SX:
        """What the motor must put in to bring the joints from rest to q, J (negative where the spring helps)."""
        return -ca.dot(p.stiffness * (q - p.rest), q - p.rest) / 2
