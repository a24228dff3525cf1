"""Effects that change the rigid body itself; they enter the inverse dynamics, not its result."""

from __future__ import annotations

from types import SimpleNamespace
from typing import ClassVar

import casadi as ca
import numpy as np

from energy_opt.effects.base import Effect
from energy_opt.effects.parameter import Parameter
from energy_opt.effects.stages import RigidEffect


class Payload(RigidEffect):
    """A point mass at `com` in the last joint's frame."""

    name = "payload"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("mass", "kg", 0.0, 0.0, 1e3, fit=(1e-4, 200.0)),
        Parameter("com", "m", 0.0, -10.0, 10.0, 3, shapes=True),
    )

    @classmethod
    def inertia(cls, p: SimpleNamespace) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Mass m, first moment h = m c (3, 1) and second moment S = m c c^T (3, 3) about the last joint's origin."""
        return p.mass, p.mass * p.com, p.mass * (p.com @ p.com.T)

    @classmethod
    def point_mass(cls, p: SimpleNamespace) -> tuple[ca.SX, ca.SX] | None:
        return p.mass, p.com

    @classmethod
    def idle(cls, joints: int, **words: str | int) -> Effect:
        return cls(mass=1e-3, com=np.zeros(3))

    @classmethod
    def to_chart(cls, full: np.ndarray, joints: int) -> np.ndarray:
        """(m, m c): the torque is linear in these but for the second moment."""
        return np.concatenate([full[:1], full[1:] * full[0]])

    @classmethod
    def from_chart(cls, x: np.ndarray, joints: int) -> np.ndarray:
        return np.concatenate([x[:1], x[1:] / x[0]])

    @classmethod
    def chart_slope(cls, x: np.ndarray, joints: int) -> np.ndarray:
        out = np.eye(4)
        out[1:, 1:] = np.eye(3) / x[0]
        out[1:, 0] = -x[1:] / x[0] ** 2
        return out

    @classmethod
    def chart_bounds(cls, joints: int) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = super().chart_bounds(joints)
        return np.append(lower[:1], [-100.0] * 3), np.append(upper[:1], [100.0] * 3)  # [kg], [kg m]


class BaseTilt(RigidEffect):
    """The base is turned by `roll` about x, then by `pitch` about y; gravity in the base frame turns the other way."""

    name = "base_tilt"
    parameters = (
        Parameter("roll", "rad", 0.0, -3.2, 3.2, fit=(-1.5, 1.5)),
        Parameter("pitch", "rad", 0.0, -3.2, 3.2, fit=(-1.5, 1.5)),
    )

    @classmethod
    def gravity(cls, gravity: ca.SX, p: SimpleNamespace) -> ca.SX:
        """Gravity (3, 1) seen from the turned base: (Ry(pitch) Rx(roll))^T g."""
        cr, sr, cp, sp = ca.cos(p.roll), ca.sin(p.roll), ca.cos(p.pitch), ca.sin(p.pitch)
        x, y, z = gravity[0], gravity[1], gravity[2]
        u, w = cp * x - sp * z, sp * x + cp * z  # Ry^T g
        return ca.vertcat(u, cr * y + sr * w, -sr * y + cr * w)  # Rx^T (Ry^T g)
