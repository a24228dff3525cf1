"""What is known of an arm, as plain numbers: its links, a payload, stated limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PointMass:
    """A mass [kg] at `com` (3,) [m] in the last joint's frame."""

    mass: float
    com: np.ndarray


@dataclass(frozen=True)
class Follows:
    """How a joint follows another: its position is `ratio` times that of joint `leader`, an index, plus `offset`."""

    leader: int
    ratio: float
    offset: float


@dataclass(frozen=True)
class Link:
    """One moving link and the joint that carries it, as plain numbers.

    Attributes:
        name: the joint's name.
        prismatic: slides along `axis` where True, else turns about it.
        continuous: a revolute joint without an end.
        parent: index of the parent link, -1 for the base.
        placement: (4, 4) pose of the joint's frame in the parent's at q = 0.
        axis: (3,) unit vector in the joint's frame.
        mass, lever, inertia: kg, (3,) m to the centre of mass, (3, 3) kg m^2 about the centre of mass.
        armature: reflected rotor inertia, kg m^2 (0 unless the model states it).
        follows: the joint that moves by itself and takes this one along; None where this one is such a joint.
    """

    name: str
    prismatic: bool
    continuous: bool
    parent: int
    placement: np.ndarray
    axis: np.ndarray
    mass: float
    lever: np.ndarray
    inertia: np.ndarray
    armature: float
    follows: Follows | None = None


def pose_of(position: Sequence[float], rpy: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(4, 4) pose from a position [m] and roll, pitch, yaw [rad] as URDF has them: Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    out = np.eye(4)
    out[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    out[:3, 3] = position
    return out


def pseudo_inertia(mass: float, lever: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """(4, 4) second moments from mass, centre of mass (3,) and inertia (3, 3) about it.

    They add up over bodies and move to another frame as T J T^T (Wensing, Kim, Slotine 2018).
    """
    centre = np.append(lever, 1.0)
    out = mass * np.outer(centre, centre)
    out[:3, :3] += np.trace(inertia) / 2 * np.eye(3) - inertia
    return out


def outermost(links: Sequence[Link]) -> int:
    """Index of the link with most joints between it and the base, the last of several: what "the last joint" means.

    On a chain it is the last; beside one, rods of a linkage do not take its place.
    """
    depth: list[int] = []
    for link in links:
        depth.append(1 + (depth[link.parent] if link.parent >= 0 else 0))
    return max(range(len(links)), key=lambda k: (depth[k], k))


@dataclass(frozen=True)
class UrdfLimits:
    """What the URDF states, (n,) each, untouched: position [rad], velocity [rad/s], effort [N m]."""

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
