"""A URDF as a list of moving bodies: fixed and locked joints are welded, geometry is dropped.

The reading is the virtual arm's own, so that a slip in the library's robot model cannot repeat itself here.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput

TURNING = ("revolute", "continuous")
MOVING = (*TURNING, "prismatic")


@dataclass
class Body:
    """A moving body, its joint at its origin.

    Attributes:
        joint: name of the joint that carries it.
        slides: whether that joint is prismatic.
        parent: index of the body that it hangs on, -1 for the base.
        placement: 4 x 4 transform from the parent's frame to its own at joint angle 0.
        axis: joint axis in its own frame, shape (3,).
        mass, first, second: mass [kg], first moment [kg m] and rotational inertia about its origin [kg m^2].
    """

    joint: str
    slides: bool
    parent: int
    placement: np.ndarray
    axis: np.ndarray
    mass: float = 0.0
    first: np.ndarray = field(default_factory=lambda: np.zeros(3))
    second: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))

    def add(self, mass: float, com: np.ndarray, inertia: np.ndarray) -> None:
        """Weld on a mass with its centre at `com` and the rotational inertia `inertia` about that centre."""
        self.mass += mass
        self.first = self.first + mass * com
        self.second = self.second + inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))

    def about_centre(self) -> tuple[np.ndarray, np.ndarray]:
        """Centre of mass (3,) and rotational inertia about it (3, 3)."""
        com = self.first / self.mass if self.mass > 0 else np.zeros(3)
        return com, self.second - self.mass * (com @ com * np.eye(3) - np.outer(com, com))


def rotation(rpy: Sequence[float] | np.ndarray) -> np.ndarray:
    """Fixed-axis roll, pitch, yaw as URDF defines them: Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation by `angle` about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def _triple(element: ET.Element | None, key: str, default: str) -> np.ndarray:
    text = element.get(key, default) if element is not None else default
    return np.array([float(word) for word in text.split()])


def _origin(element: ET.Element) -> np.ndarray:
    origin = element.find("origin")
    out = np.eye(4)
    out[:3, :3] = rotation(_triple(origin, "rpy", "0 0 0"))
    out[:3, 3] = _triple(origin, "xyz", "0 0 0")
    return out


def _inertial(link: ET.Element) -> tuple[float, np.ndarray, np.ndarray] | None:
    """Mass, transform of the inertial frame and inertia in it; None for a link without mass."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        return None
    xx, yy, zz, xy, xz, yz = (float(inertia.get(k, "0")) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return float(mass.get("value", "0")), _origin(inertial), matrix


def read_bodies(urdf: Path, joints: Sequence[str], locked: Mapping[str, float]) -> list[Body]:
    """The moving bodies of a URDF in the order of `joints`; every other joint is held at its value in `locked`, else 0.

    Raises:
        BadInput: a joint is not in the file or neither turns nor slides.
    """
    root = ET.parse(urdf).getroot()
    links = {link.get("name"): link for link in root.findall("link")}
    children: dict[str, list[ET.Element]] = {}
    kinds: dict[str, str] = {}
    heads = set()
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:
            continue
        children.setdefault(parent.get("link", ""), []).append(joint)
        kinds[joint.get("name", "")] = joint.get("type", "")
        heads.add(child.get("link"))
    for name in joints:
        if kinds.get(name) not in MOVING:
            raise BadInput(
                f"{urdf}: joint {name!r} is {kinds.get(name, 'absent')}; the virtual arm needs it to turn or slide"
            )

    bodies: list[Body] = []

    def visit(link: str, parent: int, placed: np.ndarray) -> None:
        given = _inertial(links[link]) if link in links else None
        if given is not None and parent >= 0:
            mass, frame, inertia = given
            frame = placed @ frame
            spin = frame[:3, :3]
            bodies[parent].add(mass, frame[:3, 3], spin @ inertia @ spin.T)
        for joint in children.get(link, []):
            child = joint.find("child")
            axis = _triple(joint.find("axis"), "xyz", "1 0 0")
            axis = axis / (np.linalg.norm(axis) or 1.0)
            placement = placed @ _origin(joint)
            name, head = joint.get("name", ""), child.get("link", "") if child is not None else ""
            if name in joints:
                bodies.append(Body(name, kinds[name] == "prismatic", parent, placement, axis))
                visit(head, len(bodies) - 1, np.eye(4))
                continue
            held, move = float(locked.get(name, 0.0)), np.eye(4)
            if kinds[name] == "prismatic":
                move[:3, 3] = axis * held
            elif kinds[name] in TURNING:
                move[:3, :3] = turn(axis, held)
            visit(head, parent, placement @ move)

    for name in [name for name in links if name not in heads and name is not None]:
        visit(name, -1, np.eye(4))
    if [body.joint for body in bodies] != list(joints):
        raise BadInput(f"{urdf}: joints {', '.join(joints)} are not in the order of the kinematic tree")
    return bodies
