"""The short YAML: a list of objects, each one shape.

objects:
  - {name: table, type: box, size: [1.2, 0.8, 0.04], position: [0.5, 0, -0.02]}
  - {name: post, type: cylinder, radius: 0.05, height: 1.0, position: [0.3, 0.4, 0.5]}
  - {name: part, type: mesh, file: part.stl, scale: 0.001, position: [0.5, 0.2, 0]}
  - {name: gripped, type: sphere, radius: 0.03, position: [0, 0, 0.1], attach: true}
poses:                                 # of the tool, in the scene's frame or in that of an object
  pick: {pose: "part: 0, 0, 0.12, 3.14, 0, 0", free: [rz]}
"""

from __future__ import annotations

from collections.abc import Mapping
from reprlib import repr as brief
from typing import Any

import numpy as np

from energy_opt.cell.scene import KINDS, SIZES, TOOL, AllowedPairs, SceneObject, Shape
from energy_opt.cell.scene_files.mesh_file import read_mesh
from energy_opt.cell.scene_files.parts import (
    Reading,
    mapping,
    name_of,
    number,
    pose,
    sequence,
    unknown_key,
    vector,
)
from energy_opt.errors import BadInput

TOP = ("format", "name", "objects", "allow", "poses")
KEYS = (
    "name", "type", "size", "radius", "height", "file", "scale", "position", "quaternion", "attach", "touch_links",
)  # fmt: skip


def read_short(reading: Reading, document: Mapping[str, Any]) -> AllowedPairs:
    """Take the objects of the document; returns the pairs that may touch."""
    for key in document:
        if key not in TOP:
            reading.faults.append(f"{reading.path}: {unknown_key(key, TOP)}")
    with reading.at("objects"):
        for k, entry in enumerate(sequence(document.get("objects"), "it"), start=1):
            name = entry.get("name") if isinstance(entry, Mapping) else None
            with reading.at(f"object {name if name and isinstance(name, (str, int)) else k}"):
                _take(reading, mapping(entry, "it"))
    with reading.at("poses"):
        for key, value in mapping(document.get("poses", {}), "it").items():
            reading.poses[name_of(key, "a name")] = value
    allowed = AllowedPairs()
    with reading.at("allow"):
        pairs = [sequence(pair, "a pair") for pair in sequence(document.get("allow"), "it")]
        for pair in pairs:
            if len(pair) != 2:
                raise BadInput(f"{brief(pair)} is not a pair of names")
        allowed = AllowedPairs.of([[name_of(name, "a name") for name in pair] for pair in pairs])
    return allowed


def _take(reading: Reading, entry: Mapping[str, Any]) -> None:
    name = name_of(entry.get("name"), "name")
    for key in entry:
        if key not in KEYS:
            raise BadInput(unknown_key(key, KEYS))
    attach = entry.get("attach", False)
    if not isinstance(attach, (bool, str)):
        raise BadInput(f"attach is {brief(attach)}; expected true, false or the name of a link")
    link = (TOOL if attach is True else attach) or None
    touch = tuple(name_of(item, "touch_links") for item in sequence(entry.get("touch_links"), "touch_links"))
    position = vector(entry.get("position", [0, 0, 0]), "xyz", "position")
    at = pose(reading, position, vector(entry.get("quaternion", [0, 0, 0, 1]), "xyzw", "quaternion"))
    reading.add(SceneObject(name, (_shape(reading, entry),), at, link, link, touch))


def _shape(reading: Reading, entry: Mapping[str, Any]) -> Shape:
    kind = entry.get("type")
    if kind not in KINDS:
        raise BadInput(f"type is {brief(kind)}; expected {', '.join(KINDS)}")
    if kind == "mesh":
        vertices, triangles = read_mesh(reading, entry.get("file", entry.get("size")))
        return reading.mesh(vertices * _scale(entry.get("scale", 1.0)), triangles, np.eye(4))
    sizes = entry.get("size")
    if sizes is None:
        given = [key for key in SIZES[kind] if key in entry]
        missing = [key for key in SIZES[kind] if key not in entry]
        if missing:
            expected = "size: [x, y, z]" if kind == "box" else ", ".join(SIZES[kind])
            raise BadInput(f"a {kind} without {missing[0]}; expected {expected}")
        sizes = [entry[key] for key in given]
    elif isinstance(sizes, (int, float, str)):
        sizes = [sizes]
    return reading.shape(kind, [number(value, "size") for value in sequence(sizes, "size")], np.eye(4))


def _scale(value: Any) -> np.ndarray:
    """(3,) from one factor or three; none of them zero, and turned inside out no more than the file."""
    factors = vector(value, "xyz", "scale") if isinstance(value, (list, tuple)) else [number(value, "scale")] * 3
    if min(factors) <= 0:
        raise BadInput("scale is not above 0")
    return np.array(factors)
