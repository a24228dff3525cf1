"""MoveIt's .scene text (`saveGeometryToStream`), as written since objects have poses and as written before."""

from __future__ import annotations

import math

import numpy as np

from energy_opt.cell.scene import SceneObject, Shape
from energy_opt.cell.scene_files.parts import Reading, plane_pose, pose
from energy_opt.errors import BadInput

# What follows the word of a primitive; a cylinder and a cone are written radius first, unlike in messages.
SIZES = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}


def read_text_scene(reading: Reading, text: str) -> None:
    """Take the objects of the text; what follows a fault is not read."""
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
            reading.add(_object(reading, name, lines))
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
        """The next line; nothing may be left of the one before."""
        if self._words:
            raise BadInput(f"{self._words[-1][:40]!r} is left over")
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
        """So many finite numbers."""
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
            raise BadInput(f"{word} {what} announced, more than the file has rows")
        return int(word)


def _object(reading: Reading, name: str, lines: _Lines) -> SceneObject:
    """An object after its name. Three numbers on the next line are its pose; one is already the count of shapes."""
    at, posed = np.eye(4), len(lines.peek()) > 1
    if posed:
        at = _pose(reading, lines, "its pose")
    shapes = []
    for _ in range(lines.count("shapes")):
        kind = lines.word()
        shape = _shape(reading, kind, lines)
        placed = _pose(reading, lines, f"the pose of its {kind}")
        lines.numbers(4, "a colour")
        shapes.append(Shape(shape.kind, shape.size, placed @ shape.pose, shape.vertices, shape.triangles))
    following = lines.peek()
    if posed and following and len(following) == 1 and following[0].isdigit():
        for _ in range(lines.count("subframes")):
            lines.line()
            _pose(reading, lines, "the pose of a subframe")
    return SceneObject(name, tuple(shapes), at)


def _pose(reading: Reading, lines: _Lines, what: str) -> np.ndarray:
    position = lines.numbers(3, what)
    return pose(reading, position, lines.numbers(4, what))


def _shape(reading: Reading, kind: str, lines: _Lines) -> Shape:
    if kind in SIZES:
        return reading.shape(kind, lines.numbers(SIZES[kind], f"the size of its {kind}"), np.eye(4))  # type: ignore[arg-type]
    if kind == "plane":
        return reading.shape("plane", (), plane_pose(reading, lines.numbers(4, "its plane")))
    if kind == "mesh":
        corners, faces = lines.count("vertices"), lines.count("triangles")
        vertices = np.array(lines.numbers(3 * corners, "its vertices")).reshape(-1, 3)
        indices = np.array(lines.numbers(3 * faces, "its triangles")).reshape(-1, 3)
        if (indices != np.round(indices)).any() or (np.abs(indices) > 2**31).any():
            raise BadInput("its triangles are not whole numbers")
        return reading.mesh(vertices, indices.astype(np.int64), np.eye(4))
    raise BadInput(f"a shape of type {kind[:40]!r}; expected {', '.join(SIZES)}, plane or mesh")
