"""A strict reading of a URDF's masses and collision bodies by minidom, decimal numbers and SciPy's rotations alone."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any
from xml.dom import minidom
from xml.parsers.expat import ExpatError

import numpy as np
from scipy.spatial.transform import Rotation

DECIMAL = re.compile(r"[ \t\r\n]*([+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?)[ \t\r\n]*")
SHAPES = {"box": ["size"], "sphere": ["radius"], "cylinder": ["radius", "length"], "capsule": ["radius", "length"]}
MOMENTS = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]


class Refused(Exception):
    """A strict reading does not take the file."""


@dataclass(frozen=True)
class Reading:
    """Mass [kg] of what each moving joint carries; kind, sizes and place at zero of each collision body, sorted."""

    mass: dict[str, float]
    bodies: list[tuple[Any, ...]]


def strict(text: str) -> Reading:
    """What the XML of a URDF says; Refused where any of it can be read in two ways."""
    try:
        root = minidom.parseString(text.encode()).documentElement
    except (ExpatError, ValueError):
        raise Refused("XML") from None
    if root.tagName != "robot":
        raise Refused(root.tagName)
    links, joints = {}, {}
    for node in _children(root, ["link", "joint"]):
        name = node.getAttribute("name")
        table = links if node.tagName == "link" else joints
        if name in table or not re.fullmatch(r"[A-Za-z0-9_./-]{1,128}", name):
            raise Refused(name)
        table[name] = _link(node) if node.tagName == "link" else _joint(node)
    by_child = {}
    for name, (kind, parent, child, place) in joints.items():
        if parent not in links or child not in links or child in by_child:
            raise Refused(name)
        by_child[child] = name, kind, parent, place
    if len([name for name in links if name not in by_child]) != 1:
        raise Refused("base")
    mass = {name: 0.0 for name, joint in joints.items() if joint[0] != "fixed"}
    bodies = []
    for name, (own, shapes) in links.items():
        place, on, at, seen = np.eye(4), "", name, set()
        while at in by_child:
            joint, kind, parent, step = by_child[at]
            if at in seen:
                raise Refused("circle")
            seen.add(at)
            on = on or (joint if kind != "fixed" else "")
            place, at = step @ place, parent
        if on:
            mass[on] += own
        for kind, sizes, pose in shapes:
            bodies.append((kind, *np.round(sizes, 9), *np.round((place @ pose)[:3].ravel() + 0.0, 6)))
    return Reading(mass, sorted(bodies))


def _children(node: Any, known: Sequence[str], single: bool = False) -> list[Any]:
    """The element's children; Refused where a tag is none of the known ones, or there twice and not alike."""
    out = [child for child in node.childNodes if child.nodeType == child.ELEMENT_NODE]
    for child in out:
        if child.tagName not in known:
            raise Refused(child.tagName)
    if not single:
        return out
    kept: dict[str, Any] = {}
    for child in out:
        before = kept.setdefault(child.tagName, child)
        if before.toxml().split() != child.toxml().split():
            raise Refused(child.tagName)
    return list(kept.values())


def _numbers(node: Any, attribute: str, count: int, default: str | None = None) -> list[float]:
    text = node.getAttribute(attribute) if node is not None and node.hasAttribute(attribute) else default
    words = [] if text is None else re.split(r"[ \t\r\n]+", text.strip(" \t\r\n"))
    if len(words) != count or not all(DECIMAL.fullmatch(word) for word in words):
        raise Refused(f"{attribute}={text}")
    values = [float(Decimal(word)) for word in words]
    if not np.isfinite(values).all():
        raise Refused(f"{attribute}={text}")
    return values


def _only(node: Any, attributes: Sequence[str]) -> None:
    for name in dict(node.attributes.items()):
        if name not in attributes:
            raise Refused(name)


def _place(parts: dict[str, Any]) -> np.ndarray:
    origin = parts.get("origin")
    if origin is not None:
        _only(origin, ["xyz", "rpy"])
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("xyz", _numbers(origin, "rpy", 3, "0 0 0")).as_matrix()
    out[:3, 3] = _numbers(origin, "xyz", 3, "0 0 0")
    return out


def _parts(node: Any, known: Sequence[str]) -> dict[str, Any]:
    return {child.tagName: child for child in _children(node, known, single=True)}


def _link(node: Any) -> tuple[float, list[tuple[str, list[float], np.ndarray]]]:
    mass, shapes, inertials = 0.0, [], []
    for child in _children(node, ["inertial", "collision", "visual"]):
        if child.tagName == "inertial":
            inertials.append(child)
            parts = _parts(child, ["origin", "mass", "inertia"])
            _place(parts)
            if set(parts) < {"mass", "inertia"}:
                raise Refused("inertial")
            for tag, attributes in (("mass", ["value"]), ("inertia", MOMENTS)):
                _only(parts[tag], attributes)
                values = [_numbers(parts[tag], attribute, 1)[0] for attribute in attributes]
                mass = values[0] if tag == "mass" else mass
            if mass < 0:
                raise Refused("mass")
        elif child.tagName == "collision":
            parts = _parts(child, ["origin", "geometry"])
            inside = _children(parts["geometry"], list(SHAPES)) if "geometry" in parts else []
            if len(inside) != 1:
                raise Refused("geometry")
            attributes = SHAPES[inside[0].tagName]
            _only(inside[0], attributes)
            many = 3 if inside[0].tagName == "box" else 1
            sizes = [x for attribute in attributes for x in _numbers(inside[0], attribute, many)]
            if min(sizes) < 0:
                raise Refused("size")
            shapes.append((inside[0].tagName, sizes, _place(parts)))
    if len({" ".join(i.toxml().split()) for i in inertials}) > 1:
        raise Refused("inertial")
    return mass, shapes


def _joint(node: Any) -> tuple[str, str, str, np.ndarray]:
    parts = _parts(node, ["origin", "parent", "child", "axis", "limit"])
    kind = node.getAttribute("type")
    if kind not in ("revolute", "fixed") or not {"parent", "child"} <= set(parts):
        raise Refused(kind)
    if kind == "revolute":
        if "axis" in parts:
            _only(parts["axis"], ["xyz"])
            if not any(_numbers(parts["axis"], "xyz", 3)):
                raise Refused("axis")
        if "limit" not in parts:
            raise Refused("limit")
        _only(parts["limit"], ["lower", "upper", "velocity", "effort"])
        lower, upper, velocity, effort = (
            _numbers(parts["limit"], name, 1, "0")[0] for name in ("lower", "upper", "velocity", "effort")
        )
        if lower > upper or velocity < 0 or effort < 0:
            raise Refused("limit")
    return kind, parts["parent"].getAttribute("link"), parts["child"].getAttribute("link"), _place(parts)
