"""Two plain kinds of scene file: the short YAML, a list of objects of one shape each, and MoveIt's .scene text.

objects:
  - {name: table, type: box, size: [1.2, 0.8, 0.04], position: [0.5, 0, -0.02]}
  - {name: post, type: cylinder, radius: 0.05, height: 1.0, position: [0.3, 0.4, 0.5]}
  - {name: part, type: mesh, file: part.stl, scale: 0.001, position: [0.5, 0.2, 0]}
  - {name: gripped, type: sphere, radius: 0.03, position: [0, 0, 0.1], attach: true}
poses:                                 # of the tool, in the scene's frame or in that of an object
  pick: {pose: "part: 0, 0, 0.12, 3.14, 0, 0", free: [rz]}

The .scene text (`saveGeometryToStream`) is read in its present form, in which objects have poses, and in its older one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from reprlib import repr as brief
from typing import Any

import numpy as np

from energy_opt.cell.scene import KINDS, SIZES, TOOL, AllowedPairs, SceneObject, Shape
from energy_opt.cell.scene_files.parts import (
    Reading,
    mapping,
    name_of,
    number,
    plane_pose,
    pose,
    read_mesh,
    sequence,
    unknown_key,
    vector,
)
from energy_opt.errors import BadInput

TOP = ("format", "name", "objects", "allow", "poses")
KEYS = (
    "name", "type", "size", "radius", "height", "file", "scale", "position", "quaternion", "attach", "touch_links",
)  # fmt: skip


def read_short(reading: Reading, document: Mapping[str, Any]) -> None:
    """Take the objects of a document in the short form, and the pairs that may touch; faults are collected."""
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
    with reading.at("allow"):
        pairs = [sequence(pair, "a pair") for pair in sequence(document.get("allow"), "it")]
        for pair in pairs:
            if len(pair) != 2:
                raise BadInput(f"{brief(pair)} is not a pair of names")
        named = [sorted(name_of(name, "a name") for name in pair) for pair in pairs]
        reading.allowed = AllowedPairs({(a, b): True for a, b in named})  # noqa: C420 (a pair is a list here)


def _take(reading: Reading, entry: Mapping[str, Any]) -> None:
    """Read one entry of `objects`: name, shape, pose, and what it is attached to."""
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
    """The shape of an entry: a primitive with its sizes, or a mesh file."""
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
    """Scale (3,) from one factor or three, all above 0."""
    factors = vector(value, "xyz", "scale") if isinstance(value, (list, tuple)) else [number(value, "scale")] * 3
    if min(factors) <= 0:
        raise BadInput("scale is not above 0")
    return np.array(factors)


# What follows the word of a primitive; a cylinder and a cone are written radius first, unlike in messages.
TEXT_SIZES = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}


def read_text_scene(reading: Reading, text: str) -> None:
    """Take the objects of a scene in MoveIt's text form, up to the first fault, which is collected in `reading`."""
    lines = _Lines(text)
    where = "row 1"
    try:
        lines.line()  # the scene's name, which may be empty
        while True:
            mark = lines.line().strip()
            if mark in (".", ""):
                if mark == ".":
                    return
                continue
            if not mark.startswith("*") or not mark[1:].strip():
                raise BadInput(f"{mark[:40]!r}; expected '* NAME' of an object, or '.' at the end")
            name = mark[1:].strip()
            where = f"object {name}"
            reading.add(_text_object(reading, name, lines))
            where = f"after {where}"
    except BadInput as error:
        reading.faults.append(f"{reading.path}: {where} (row {lines.row}): {error}")


class _Lines:
    """The text as lines and, within them, as words; knows the row of what was read last."""

    def __init__(self, text: str) -> None:
        self._lines = text.splitlines()
        self.row = 0
        self._words: list[str] = []

    def line(self) -> str:
        """The next line; no word of the line before may remain."""
        if self._words:
            raise BadInput(f"{self._words[-1][:40]!r} is not expected here; expected the end of the line")
        if self.row >= len(self._lines):
            raise BadInput("the file ends here; expected '.' on a line of its own")
        self.row += 1
        return self._lines[self.row - 1]

    def peek(self) -> list[str]:
        """Words of the next line that has any; empty at the end of the file."""
        while self.row < len(self._lines):
            words = self._lines[self.row].split()
            if words:
                return words
            self.row += 1
        return []

    def word(self) -> str:
        """The next word, over line ends."""
        while not self._words:
            self._words = self.line().split()[::-1]
        return self._words.pop()

    def numbers(self, count: int, what: str) -> list[float]:
        """`count` finite numbers."""
        out = []
        for _ in range(count):
            word = self.word()
            try:
                value = float(word)
            except ValueError:
                raise BadInput(f"{word[:40]!r} in {what}; expected a number") from None
            if not math.isfinite(value):
                raise BadInput(f"{word} in {what}; expected a finite number")
            out.append(value)
        return out

    def count(self, what: str) -> int:
        """A whole number, 0 or above; no more than there can be in the rest of the file."""
        word = self.word()
        if not word.isdigit() or len(word) > 12:
            raise BadInput(f"{word[:40]!r}; expected the number of {what}")
        if int(word) > len(self._lines):
            raise BadInput(f"the number of {what} is {word}, but the file has fewer rows")
        return int(word)


def _text_object(reading: Reading, name: str, lines: _Lines) -> SceneObject:
    """An object after its name. Three numbers on the next line are its pose; one is already the count of shapes."""
    at, posed = np.eye(4), len(lines.peek()) > 1
    if posed:
        at = _text_pose(reading, lines, "its pose")
    shapes = []
    for _ in range(lines.count("shapes")):
        kind = lines.word()
        shape = _text_shape(reading, kind, lines)
        placed = _text_pose(reading, lines, f"the pose of its {kind}")
        lines.numbers(4, "a colour")
        shapes.append(Shape(shape.kind, shape.size, placed @ shape.pose, shape.vertices, shape.triangles))
    following = lines.peek()
    if posed and following and len(following) == 1 and following[0].isdigit():
        for _ in range(lines.count("subframes")):
            lines.line()
            _text_pose(reading, lines, "the pose of a subframe")
    return SceneObject(name, tuple(shapes), at)


def _text_pose(reading: Reading, lines: _Lines, what: str) -> np.ndarray:
    """Pose (4, 4) from a line of a position [m] and a line of a quaternion x, y, z, w."""
    position = lines.numbers(3, what)
    return pose(reading, position, lines.numbers(4, what))


def _text_shape(reading: Reading, kind: str, lines: _Lines) -> Shape:
    """The shape of an object in a .scene file, whose kind has been read."""
    if kind in TEXT_SIZES:
        return reading.shape(kind, lines.numbers(TEXT_SIZES[kind], f"the size of its {kind}"), np.eye(4))  # type: ignore[arg-type]
    if kind == "plane":
        return reading.shape("plane", (), plane_pose(reading, lines.numbers(4, "its plane")))
    if kind == "mesh":
        corners, faces = lines.count("vertices"), lines.count("triangles")
        vertices = np.array(lines.numbers(3 * corners, "its vertices")).reshape(-1, 3)
        indices = np.array(lines.numbers(3 * faces, "its triangles")).reshape(-1, 3)
        if (indices != np.round(indices)).any() or (np.abs(indices) > 2**31).any():
            raise BadInput("its triangles are not whole numbers")
        return reading.mesh(vertices, indices.astype(np.int64), np.eye(4))
    raise BadInput(f"a shape of type {kind[:40]!r}; expected {', '.join(TEXT_SIZES)}, plane or mesh")
