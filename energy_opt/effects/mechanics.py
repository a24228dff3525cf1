"""Effects of masses and springs: those that store energy in torque, and those that change the rigid body itself.

The latter enter the inverse dynamics, not its result: a payload, one that is picked up or put down in mid-run while the
arm is at rest, a tilted base, links that differ from the URDF by some per cent.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import ClassVar

import casadi as ca
import numpy as np

from energy_opt.effects.base import SMALL, Effect, Signals
from energy_opt.effects.parameter import Kinks, Parameter
from energy_opt.effects.stages import Link, RigidEffect, TorqueEffect


class Armature(TorqueEffect):
    """inertia * a: the rotor's inertia reflected to the joint side (gear ratio squared times rotor inertia)."""

    name = "armature"
    parameters = (Parameter("inertia", "kg m^2", 0.0, 0.0, 1e3, "joint"),)
    stores = True

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """inertia a, (n, 1) [N m]."""
        return p.inertia * x.a

    @classmethod
    def stored(cls, q: ca.SX, v: ca.SX, p: SimpleNamespace) -> ca.SX:
        """Kinetic energy of the rotors, J."""
        return ca.dot(p.inertia * v, v) / 2


class GravitySpring(TorqueEffect):
    """-stiffness * (q - rest): a spring that helps the motor, as gravity compensators do."""

    name = "gravity_spring"
    parameters = (
        Parameter("stiffness", "N m/rad", 0.0, -1e5, 1e5, "joint", fit=(-1e4, 1e4)),
        Parameter("rest", "rad", 0.0, -100.0, 100.0, "joint", shapes=True),
    )
    products = {"rest": ("stiffness", 1e4)}  # the torque is linear in these
    stores = True
    same_on_all_joints = False

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """-stiffness (q - rest), (n, 1) [N m]."""
        return -p.stiffness * (x.q - p.rest)

    @classmethod
    def stored(cls, q: ca.SX, v: ca.SX, p: SimpleNamespace) -> ca.SX:
        """Work [J] of the motor to bring the joints from `rest` to q; negative if the spring helps."""
        return -ca.dot(p.stiffness * (q - p.rest), q - p.rest) / 2

    @classmethod
    def idle(cls, joints: int, **words: str | int) -> Effect:
        """Almost no stiffness: at exactly 0 the derivative by `rest` would vanish."""
        return cls(stiffness=np.full(joints, SMALL), rest=np.zeros(joints))


class Payload(RigidEffect):
    """A point mass at `com` in the last joint's frame."""

    name = "payload"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("mass", "kg", 0.0, 0.0, 1e3, fit=(1e-4, 200.0)),
        Parameter("com", "m", 0.0, -10.0, 10.0, 3, shapes=True),
    )
    products = {"com": ("mass", 100.0)}  # [kg m] the torque is linear in these except for the second moment

    @classmethod
    def point_mass(cls, p: SimpleNamespace) -> tuple[ca.SX, ca.SX] | None:
        """The mass [kg] and its place (3, 1) [m]."""
        return p.mass, p.com

    @classmethod
    def idle(cls, joints: int, **words: str | int) -> Effect:
        """One gram at the joint's origin: at mass 0 the derivative by `com` would vanish."""
        return cls(mass=1e-3, com=np.zeros(3))


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


ALWAYS = 1e3  # [dwells] until the run's end


class PayloadChange(Payload):
    """A point mass at `com` in the last joint's frame, from the `first` dwell of every run on, for `lasts` dwells.

    A dwell is a standstill between two motions of one run; the payload changes in its middle. It belongs to a
    recording: in a plan the payload is the move's own.
    """

    name = "payload_change"
    parameters = (
        *Payload.parameters,
        Parameter("first", "1", 1.0, 1.0, ALWAYS, shapes=True, steps=True, trials=(1.0, 2.0)),
        Parameter("lasts", "1", ALWAYS, 1.0, ALWAYS, shapes=True, steps=True, trials=(1.0, ALWAYS)),
    )
    follows = ("dwell",)

    @classmethod
    def point_mass(cls, p: SimpleNamespace) -> tuple[ca.SX, ca.SX] | None:
        """None: the mass is not there all the time, see `changing_mass`."""
        return None

    @classmethod
    def changing_mass(cls, x: Signals, p: SimpleNamespace) -> tuple[ca.SX, ca.SX, ca.SX] | None:
        """The mass [kg], its place (3, 1) [m], and 1 in dwells `first` to `first + lasts` (exclusive), else 0; None in
        plans.
        """
        if x.dwell is None:
            return None
        there = ca.logic_and(x.dwell >= p.first, x.dwell < p.first + p.lasts)
        return p.mass, p.com, ca.if_else(there, 1, 0)

    @classmethod
    def idle(cls, joints: int, **words: str | int) -> Effect:
        """One gram from the first dwell on."""
        return cls(mass=1e-3, com=np.zeros(3), first=1.0, lasts=ALWAYS)

    @classmethod
    def example(cls, joints: int, rng: np.random.Generator) -> np.ndarray:
        """A mass of 0.05 to 0.15 kg that is there during the dwells 2 and 3."""
        return np.array([*rng.uniform(0.05, 0.15, 4), 2.0, 2.0])


class LinkInertia(RigidEffect):
    """Deviation of every link from the URDF: its mass, its centre of mass and its inertia about that centre.

    The links are those that the joints carry, in the joints' order, each with all bodies that are fixed to it. Links of
    joints that follow others (mimic) stay as the URDF has them.
    """

    name = "link_inertia"
    parameters = (
        Parameter("mass", "kg", 0.0, -1e3, 1e3, "joint"),
        Parameter("com", "m", 0.0, -10.0, 10.0, ("joint", 3)),
        Parameter("inertia", "kg m^2", 0.0, -1e3, 1e3, ("joint", 6)),
    )
    same_on_all_joints = False
    bakes = True

    @classmethod
    def links(cls, nominal: Sequence[Link], p: SimpleNamespace) -> list[Link] | None:
        """Nominal links plus the deviations: mass [kg], centre (3, 1) [m], inertia (3, 3) [kg m^2] about the centre."""
        out = []
        for j, (mass, com, inertia) in enumerate(nominal):
            xx, xy, yy, xz, yz, zz = (p.inertia[6 * j + i] for i in range(6))
            turned = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
            out.append((mass + p.mass[j], com + p.com[3 * j : 3 * j + 3], inertia + turned))
        return out
