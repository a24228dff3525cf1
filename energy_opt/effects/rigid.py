"""Effects that change the rigid body itself; they enter the inverse dynamics, not its result."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca

from energy_opt.effects.base import Effect, Parameter


class Payload(Effect):
    """A point mass at `com` in the last joint's frame."""

    name = "payload"
    stage = "rigid"
    parameters = (
        Parameter("mass", "kg", 0.0, 0.0, 1e3),
        Parameter("com", "m", 0.0, -10.0, 10.0, 3, shapes=True),
    )

    @classmethod
    def inertia(cls, p: SimpleNamespace) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Mass m, first moment h = m c (3, 1) and second moment S = m c c^T (3, 3) about the last joint's origin."""
        return p.mass, p.mass * p.com, p.mass * (p.com @ p.com.T)


class BaseTilt(Effect):
    """The base is turned by `roll` about x, then by `pitch` about y; gravity in the base frame turns the other way."""

    name = "base_tilt"
    stage = "rigid"
    parameters = (
        Parameter("roll", "rad", 0.0, -3.2, 3.2),
        Parameter("pitch", "rad", 0.0, -3.2, 3.2),
    )

    @classmethod
    def gravity(cls, gravity: ca.SX, p: SimpleNamespace) -> ca.SX:
        """Gravity (3, 1) seen from the turned base: (Ry(pitch) Rx(roll))^T g."""
        cr, sr, cp, sp = ca.cos(p.roll), ca.sin(p.roll), ca.cos(p.pitch), ca.sin(p.pitch)
        x, y, z = gravity[0], gravity[1], gravity[2]
        u, w = cp * x - sp * z, sp * x + cp * z  # Ry^T g
        return ca.vertcat(u, cr * y + sr * w, -sr * y + cr * w)  # Rx^T (Ry^T g)
