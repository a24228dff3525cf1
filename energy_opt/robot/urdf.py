"""What a URDF must hold before its numbers are believed: every fault is named with link or joint, and attribute.

The library that builds the model is lenient: a mass that does not parse becomes zero, and the energy silently wrong.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput, near
from energy_opt.robot.xml import read_robot_xml

MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
TRIANGLE = 1e-3  # share by which the largest principal moment may exceed the sum of the others: rounded files do
KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


def check_urdf(path: Path) -> None:
    """Refuse a URDF whose numbers or structure cannot be those of an arm.

    Raises:
        BadInput: naming link or joint and attribute, and what would be right.
    """
    root = read_robot_xml(path)
    links = _named(path, root, "link")
    for name, link in links.items():
        _inertial(f"{path}: link {name!r}", link)
    joints = _named(path, root, "joint")
    for name, joint in joints.items():
        _joint(f"{path}: joint {name!r}", joint, links)
    _tree(path, links, joints)


def mimics(path: Path) -> dict[str, tuple[str, float, float]]:
    """The joints that follow another: its name, the multiplier and the offset (rad or m) of each.

    Raises:
        BadInput: the other is no joint of the file that moves, or a number is none.
    """
    joints, out = {str(joint.get("name")): joint for joint in read_robot_xml(path).findall("joint")}, {}
    moving = [name for name, joint in joints.items() if joint.get("type") != "fixed"]
    for name in moving:
        mimic = joints[name].find("mimic")
        if mimic is not None:
            where = f"{path}: joint {name!r}, mimic"
            leader, others = mimic.get("joint"), [other for other in moving if other != name]
            if leader not in others:
                hint = near(leader or "", others) or f"; they are {', '.join(others) or 'none'}"
                raise BadInput(f"{where}: joint={leader!r}; expected the name of another joint that moves{hint}")
            out[name] = leader, _number(where, mimic, "multiplier", 1.0), _number(where, mimic, "offset", 0.0)
    return out


def _named(path: Path, root: ElementTree.Element, tag: str) -> dict[str, ElementTree.Element]:
    out: dict[str, ElementTree.Element] = {}
    for element in root.findall(tag):
        name = element.get("name")
        if not name:
            raise BadInput(f"{path}: a <{tag}> without a name")
        if name in out:
            raise BadInput(f"{path}: {tag} {name!r} stands there twice")
        out[name] = element
    return out


def _number(where: str, element: ElementTree.Element | None, attribute: str, default: float | None = None) -> float:
    text = None if element is None else element.get(attribute)
    if text is None:
        if default is None:
            raise BadInput(f"{where}: {attribute} is missing; expected a number")
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadInput(f"{where}: {attribute}={text!r} is not a finite number")
    return value


def _vector(where: str, element: ElementTree.Element | None, attribute: str, default: str) -> np.ndarray:
    text = default if element is None else element.get(attribute, default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([math.nan])
    if values.shape != (3,) or not np.isfinite(values).all():
        raise BadInput(f"{where}: {attribute}={text!r}; expected three finite numbers")
    return values


def _origin(where: str, element: ElementTree.Element) -> None:
    origin = element.find("origin")
    for attribute in ("xyz", "rpy"):
        _vector(f"{where}, origin", origin, attribute, "0 0 0")


def _inertial(where: str, link: ElementTree.Element) -> None:
    inertial = link.find("inertial")
    if inertial is None:
        return
    _origin(f"{where}, inertial", inertial)
    mass = _number(f"{where}, mass", inertial.find("mass"), "value")
    if mass < 0:
        raise BadInput(f"{where}, mass: value={mass:g} kg is negative")
    inertia = inertial.find("inertia")
    at = f"{where}, inertia"
    xx, xy, xz, yy, yz, zz = (_number(at, inertia, name) for name in MOMENTS)
    moments = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    if moments[0] < -1e-9:
        raise BadInput(f"{at}: a principal moment of {moments[0]:.3g} kg m^2 is negative (ixx … izz)")
    if moments[2] > (moments[0] + moments[1]) * (1 + TRIANGLE) + 1e-9:
        raise BadInput(
            f"{at}: principal moments {', '.join(f'{m:.3g}' for m in moments)} kg m^2 are those of no body: the "
            "largest exceeds the sum of the others (ixx … izz)"
        )


def _joint(where: str, joint: ElementTree.Element, links: dict[str, ElementTree.Element]) -> None:
    kind = joint.get("type", "")
    if kind not in KINDS:
        raise BadInput(f"{where}: type={kind!r}; expected one of {', '.join(KINDS)}")
    _origin(where, joint)
    for end in ("parent", "child"):
        element = joint.find(end)
        link = None if element is None else element.get("link")
        if link not in links:
            raise BadInput(f"{where}: its {end} link {link!r} is not in the file")
    if kind in ("revolute", "continuous", "prismatic"):
        axis = _vector(f"{where}, axis", joint.find("axis"), "xyz", "1 0 0")
        if np.linalg.norm(axis) < 1e-6:
            raise BadInput(f"{where}, axis: xyz has no length; expected a direction")
    limit = joint.find("limit")
    if kind in ("revolute", "prismatic") and limit is not None:
        lower, upper = (_number(f"{where}, limit", limit, name, 0.0) for name in ("lower", "upper"))
        if lower > upper:
            raise BadInput(f"{where}, limit: lower={lower:g} is above upper={upper:g}")
    if limit is not None:
        for name in ("velocity", "effort"):
            if _number(f"{where}, limit", limit, name, 0.0) < 0:
                raise BadInput(f"{where}, limit: {name}={limit.get(name)} is negative")


def _tree(path: Path, links: dict[str, ElementTree.Element], joints: dict[str, ElementTree.Element]) -> None:
    """Every link has one parent at most, and there is one link that has none."""
    parent_of: dict[str, str] = {}
    for name, joint in joints.items():
        child, parent = (joint.find(end).get("link") for end in ("child", "parent"))  # type: ignore[union-attr]
        assert child is not None and parent is not None
        if child in parent_of:
            raise BadInput(f"{path}: link {child!r} has two parents; joint {name!r} gives it the second")
        parent_of[child] = parent
    roots = [name for name in links if name not in parent_of]
    if len(roots) != 1:
        found = ", ".join(map(repr, roots[:5])) or "none: its joints go in a circle"
        raise BadInput(f"{path}: expected one link without a parent, the base; found {found}")
    reached = {roots[0]}
    while len(reached) < len(links):
        more = {child for child, parent in parent_of.items() if parent in reached} - reached
        if not more:
            circle = next(name for name in links if name not in reached)
            raise BadInput(f"{path}: link {circle!r} hangs in a circle of joints, not on the base {roots[0]!r}")
        reached |= more
