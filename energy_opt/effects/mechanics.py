"""Torque effects that store energy rather than lose it."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np

from energy_opt.effects.base import Effect, Signals
from energy_opt.effects.kinks import Kinks
from energy_opt.effects.parameter import Parameter
from energy_opt.effects.stages import TorqueEffect

SMALL = 1e-9  # [N m/rad] a spring's stiffness is kept this far from 0 while its rest position is sought


class Armature(TorqueEffect):
    """inertia * a: the rotor's inertia reflected to the joint side (gear ratio squared times rotor inertia)."""

    name = "armature"
    parameters = (Parameter("inertia", "kg m^2", 0.0, 0.0, 1e3, "joint"),)
    stores = True

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
    stores = True
    same_on_all_joints = False

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        return -p.stiffness * (x.q - p.rest)

    @classmethod
    def stored(cls, q: ca.SX, v: ca.SX, p: SimpleNamespace) -> ca.SX:
        """What the motor must put in to bring the joints from rest to q, J (negative where the spring helps)."""
        return -ca.dot(p.stiffness * (q - p.rest), q - p.rest) / 2

    @classmethod
    def idle(cls, joints: int, **words: str | int) -> Effect:
        return cls(stiffness=np.full(joints, SMALL), rest=np.zeros(joints))

    @classmethod
    def to_chart(cls, full: np.ndarray, joints: int) -> np.ndarray:
        """(k, k * rest): the torque is linear in these."""
        return np.concatenate([full[:joints], full[joints:] * full[:joints]])

    @classmethod
    def from_chart(cls, x: np.ndarray, joints: int) -> np.ndarray:
        k = _away(x[:joints])
        return np.concatenate([k, x[joints:] / k])

    @classmethod
    def chart_slope(cls, x: np.ndarray, joints: int) -> np.ndarray:
        k, out = _away(x[:joints]), np.eye(len(x))
        out[joints:, joints:] = np.diag(1 / k)
        out[joints:, :joints] = np.diag(-x[joints:] / k**2)
        return out

    @classmethod
    def chart_bounds(cls, joints: int) -> tuple[np.ndarray, np.ndarray]:
        return np.full(2 * joints, -1e4), np.full(2 * joints, 1e4)


def _away(k: np.ndarray) -> np.ndarray:
    return np.where(np.abs(k) < SMALL, SMALL, k)
