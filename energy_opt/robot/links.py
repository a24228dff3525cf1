"""What is read of an arm, as plain numbers: its links, their collision bodies, a payload, stated limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

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


def outermost(links: Sequence[Link]) -> int:
    """Index of the link with most joints between it and the base, the last of several: what "the last joint" means.

    On a chain it is the last; beside one, rods of a linkage do not take its place.
    """
    depth: list[int] = []
    for link in links:
        depth.append(1 + (depth[link.parent] if link.parent >= 0 else 0))
    return max(range(len(links)), key=lambda k: (depth[k], k))


@dataclass(frozen=True)
class LinkGeometry:
    """One collision geometry of a link.

    Attributes:
        link: the link's name.
        joint: index of the joint that carries it, -1 for the base.
        pose: (4, 4) in that joint's frame.
        geometry: the shape as coal holds it, the library that Pinocchio's collision checks stand on.
    """

    link: str
    joint: int
    pose: np.ndarray
    geometry: Any


@dataclass(frozen=True)
class UrdfLimits:
    """What the URDF states, (n,) each, untouched: position [rad], velocity [rad/s], effort [N m]."""

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
