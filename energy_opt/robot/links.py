"""What is read of an arm, as plain numbers: its links, their collision bodies, a payload, stated limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class PointMass:
    """A mass [kg] at `com` (3,) [m] in the last joint's frame."""

    mass: float
    com: np.ndarray


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
