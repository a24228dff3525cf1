"""URDFs of arms that are not as their maker says: links off by a share, a body held that nobody declared."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np

from energy_opt.robot import Robot
from energy_opt.robot.description import read_description


def write_changed(robot: Robot, spread: tuple[float, float], rng: np.random.Generator, path: Path) -> None:
    """The robot's URDF with every link's mass, centre of mass and inertia off by a share within `spread`."""
    tree = ET.parse(robot.urdf)
    for inertial in tree.getroot().iter("inertial"):
        mass, inertia, origin = inertial.find("mass"), inertial.find("inertia"), inertial.find("origin")
        if mass is None or inertia is None:
            continue
        off = rng.uniform(*spread, 3) * rng.choice([-1, 1], 3)
        mass.set("value", repr(float(float(mass.get("value", "0")) * (1 + off[0]))))
        for key, value in inertia.attrib.items():
            inertia.set(key, repr(float(float(value) * (1 + off[0]) * (1 + off[1]))))
        if origin is not None and origin.get("xyz"):
            com = np.array([float(x) for x in str(origin.get("xyz")).split()])
            side = rng.normal(size=3)
            com = com * (1 + off[2]) + spread[1] * 0.4 * np.linalg.norm(com) * side / np.linalg.norm(side)
            origin.set("xyz", " ".join(repr(float(x)) for x in com))
    tree.write(path)


def with_urdf(robot: Robot, urdf: Path) -> Robot:
    """The robot as another file describes its links; limits and rigid body stay those of the first."""
    return replace(robot, description=read_description(urdf))


def write_loaded(urdf: Path, robot: Robot, mass: float, com: np.ndarray) -> Path:
    """The URDF with a small body of `mass` kg welded to the last joint's link at `com` (3,) m."""
    tree = ET.parse(urdf)
    root = tree.getroot()
    joint = next(j for j in root.findall("joint") if j.get("name") == robot.joints[-1])
    child = joint.find("child")
    assert child is not None
    link = ET.SubElement(root, "link", name="held")
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz="0 0 0", rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(float(mass)))
    ET.SubElement(
        inertial, "inertia", {k: "1e-5" if k[1] == k[2] else "0" for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
    )
    weld = ET.SubElement(root, "joint", name="holds", type="fixed")
    ET.SubElement(weld, "parent", link=str(child.get("link")))
    ET.SubElement(weld, "child", link="held")
    ET.SubElement(weld, "origin", xyz=" ".join(repr(float(x)) for x in com), rpy="0 0 0")
    out = urdf.with_name("loaded.urdf")
    tree.write(out)
    return out
