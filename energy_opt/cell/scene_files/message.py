"""MoveIt's PlanningScene message as YAML or JSON: world, allowed collision matrix, attached objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from reprlib import repr as brief
from typing import Any

import numpy as np

from energy_opt.cell.scene import WORLD, AllowedPairs, Kind, SceneObject, Shape
from energy_opt.cell.scene_files.parts import Reading, mapping, name_of, number, plane_pose, pose, sequence, vector
from energy_opt.errors import BadInput

KEYS = ("world", "robot_state", "allowed_collision_matrix", "fixed_frame_transforms")  # any of them marks the message
# shape_msgs/SolidPrimitive: BOX = 1, SPHERE = 2, CYLINDER = 3, CONE = 4. Its dimensions of a cylinder and a cone are
# [height, radius], ours radius and height.
PRIMITIVES: dict[Any, Kind] = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone"}
DIMENSIONS: dict[Kind, tuple[int, ...]] = {"box": (0, 1, 2), "sphere": (0,), "cylinder": (1, 0), "cone": (1, 0)}
ADD, REMOVE, APPEND, MOVE = range(4)  # moveit_msgs/CollisionObject.operation


def read_message(reading: Reading, document: Mapping[str, Any]) -> None:
    """Take the objects of the message `document` and the pairs that may touch into `reading`, faults included."""
    with reading.at("world"):
        world = mapping(document.get("world") or {}, "world")
        octomap = mapping(world.get("octomap") or {}, "octomap")
        if mapping(octomap.get("octomap") or {}, "octomap").get("data"):
            raise BadInput("an octomap is not read; give its obstacles as objects")
        frames = _Frames(reading, document)
        for k, entry in enumerate(sequence(world.get("collision_objects"), "collision_objects"), start=1):
            where = _where(entry, k)
            with reading.at(where):
                _apply(reading, mapping(entry, "it"), frames)
    with reading.at("robot_state"):
        state = mapping(document.get("robot_state") or {}, "it")
        for k, entry in enumerate(sequence(state.get("attached_collision_objects"), "attached_collision_objects"), 1):
            thing = entry.get("object") if isinstance(entry, Mapping) else None
            with reading.at(f"attached {_where(thing, k)}"):
                _attach(reading, mapping(entry, "it"))
    for key, neutral in (("link_padding", "padding"), ("link_scale", "scale")):
        for entry in sequence(document.get(key), key):
            value = entry.get(neutral) if isinstance(entry, Mapping) else None
            if value not in (None, 0, 1) or (neutral == "padding" and value == 1):
                reading.warn(f"{key} of {brief(entry.get('link_name'))} is not used; see --clearance")
    with reading.at("allowed_collision_matrix"):
        reading.allowed = _allowed(mapping(document.get("allowed_collision_matrix") or {}, "it"))


def _where(entry: Any, number: int) -> str:
    """Name of an entry in messages: its id, else its number."""
    name = entry.get("id") if isinstance(entry, Mapping) else None
    return f"object {name}" if isinstance(name, str) and name else f"object {number}"


class _Frames:
    """Frames of the poses, some of which the file relates to others."""

    def __init__(self, reading: Reading, document: Mapping[str, Any]) -> None:
        self.known: dict[str, tuple[str | None, np.ndarray]] = {}
        for entry in sequence(document.get("fixed_frame_transforms"), "fixed_frame_transforms"):
            row = mapping(entry, "an entry of fixed_frame_transforms")
            moved = mapping(row.get("transform"), "transform")
            turned = vector(moved.get("rotation"), "xyzw", "rotation")
            child = name_of(row.get("child_frame_id"), "child_frame_id")
            at = pose(reading, vector(moved.get("translation"), "xyz", "translation"), turned)
            reading.root = reading.root or _frame(row)
            parent, above = self.of(row)
            self.known[child] = parent, above @ at

    def of(self, entry: Mapping[str, Any]) -> tuple[str | None, np.ndarray]:
        """A frame to which the file relates the entry's, None for the scene's, and the (4, 4) pose of that in it."""
        frame = _frame(entry)
        return self.known.get(frame, (None if frame in ("", *WORLD) else frame, np.eye(4)))


def _frame(entry: Mapping[str, Any]) -> str:
    """The frame that an entry's header names, without the leading slash; empty if it names none."""
    header = entry.get("header") or {}
    frame = header.get("frame_id") if isinstance(header, Mapping) else None
    return str(frame or "").lstrip("/")


def _operation(value: Any) -> int:
    """The operation, which is a byte: a number, or one character where a tool wrote bytes."""
    if isinstance(value, bytes) and len(value) == 1:
        return value[0]
    if isinstance(value, str) and len(value) == 1 and ord(value) <= MOVE:
        return ord(value)
    return int(number(0 if value is None else value, "operation"))


def _apply(reading: Reading, entry: Mapping[str, Any], frames: _Frames) -> None:
    """Apply the operation of an object."""
    operation = _operation(entry.get("operation"))
    if operation == REMOVE:
        if not entry.get("id"):
            reading.objects.clear()
        reading.objects.pop(str(entry.get("id")), None)
        return
    name = name_of(entry.get("id"), "id")
    frame, at = frames.of(entry)
    at = at @ _pose(reading, entry.get("pose"), "pose")
    if operation == ADD:
        reading.add(SceneObject(name, _shapes(reading, entry), at, frame=frame))
        return
    if operation not in (APPEND, MOVE):
        raise BadInput(f"operation is {operation}; expected 0 (add), 1 (remove), 2 (append) or 3 (move)")
    old = reading.objects.get(name)
    if old is None:
        raise BadInput("cannot be changed: no object of that name comes before it")
    if operation == APPEND:
        if frame != old.frame:
            raise BadInput("shapes are appended in another frame than the object's; expected the same")
        added = tuple(
            replace(shape, pose=np.linalg.solve(old.pose, at @ shape.pose)) for shape in _shapes(reading, entry)
        )
        reading.objects[name] = replace(old, shapes=(*old.shapes, *added))
    else:
        reading.objects[name] = replace(old, pose=at, frame=frame)


def _attach(reading: Reading, entry: Mapping[str, Any]) -> None:
    """An object that a link carries; its pose is in the frame that its header names, the link's by default."""
    thing = mapping(entry.get("object"), "object")
    if _operation(thing.get("operation")) == REMOVE:
        return
    link = name_of(entry.get("link_name"), "link_name")
    touch = tuple(name_of(item, "touch_links") for item in sequence(entry.get("touch_links"), "touch_links"))
    name, at = name_of(thing.get("id"), "id"), _pose(reading, thing.get("pose"), "pose")
    reading.add(SceneObject(name, _shapes(reading, thing), at, link, _frame(thing) or link, touch))


def _pose(reading: Reading, value: Any, what: str) -> np.ndarray:
    """geometry_msgs/Pose; none is the identity."""
    if value is None:
        return np.eye(4)
    table = mapping(value, what)
    position = vector(table.get("position", [0, 0, 0]), "xyz", f"{what}'s position")
    return pose(reading, position, vector(table.get("orientation", [0, 0, 0, 1]), "xyzw", f"{what}'s orientation"))


def _poses(reading: Reading, entry: Mapping[str, Any], key: str, count: int) -> list[np.ndarray]:
    """One pose for each of `count` shapes; the object's own if none are given."""
    given = sequence(entry.get(key), key)
    if len(given) not in (0, count):
        raise BadInput(f"{len(given)} {key} for {count} shapes")
    return [_pose(reading, value, key[:-1]) for value in given] or [np.eye(4)] * count


def _shapes(reading: Reading, entry: Mapping[str, Any]) -> tuple[Shape, ...]:
    """The primitives, meshes and planes of a collision object, each at its pose."""
    out = []
    for key, word, read in (
        ("primitives", "primitive", _primitive),
        ("meshes", "mesh", _mesh),
        ("planes", "plane", _plane),
    ):
        given = sequence(entry.get(key), key)
        for solid, at in zip(given, _poses(reading, entry, f"{word}_poses", len(given)), strict=True):
            out.append(read(reading, mapping(solid, f"a {word}"), at))
    return tuple(out)


def _plane(reading: Reading, plane: Mapping[str, Any], at: np.ndarray) -> Shape:
    """shape_msgs/Plane."""
    return reading.shape("plane", (), at @ plane_pose(reading, vector(plane.get("coef"), "abcd", "coef")))


def _primitive(reading: Reading, solid: Mapping[str, Any], at: np.ndarray) -> Shape:
    """A primitive of shape_msgs/SolidPrimitive, its type by number or by name.

    Raises:
        BadInput: another type, or another number of dimensions.
    """
    word = solid.get("type")
    if isinstance(word, str):
        word = int(word) if word.isdigit() else word.lower()
    kind = word if word in DIMENSIONS else PRIMITIVES.get(word) if isinstance(word, int) else None
    if kind is None:
        raise BadInput(f"a primitive of type {brief(word)}; expected box (1), sphere (2), cylinder (3) or cone (4)")
    sizes = sequence(solid.get("dimensions"), "dimensions")
    order = DIMENSIONS[kind]
    if len(sizes) != len(order):
        raise BadInput(f"a {kind} with {len(sizes)} dimensions; expected {len(order)}")
    return reading.shape(kind, [number(sizes[k], "a dimension") for k in order], at)


def _mesh(reading: Reading, mesh: Mapping[str, Any], at: np.ndarray) -> Shape:
    """shape_msgs/Mesh."""
    corners = [vector(row, "xyz", "vertex") for row in sequence(mesh.get("vertices"), "vertices")]
    faces = [_triangle(row) for row in sequence(mesh.get("triangles"), "triangles")]
    return reading.mesh(np.array(corners, dtype=float).reshape(-1, 3), np.array(faces, dtype=np.int64), at)


def _triangle(row: Any) -> Sequence[int]:
    """Three indices of vertices, from shape_msgs/MeshTriangle or a list.

    Raises:
        BadInput: they are not three whole numbers.
    """
    indices = sequence(row.get("vertex_indices") if isinstance(row, Mapping) else row, "vertex_indices")
    if len(indices) != 3 or not all(isinstance(k, int) and not isinstance(k, bool) and k < 2**31 for k in indices):
        raise BadInput(f"a triangle is {brief(indices)}; expected three indices of vertices")
    return indices


def _allowed(matrix: Mapping[str, Any]) -> AllowedPairs:
    """moveit_msgs/AllowedCollisionMatrix: a symmetric matrix over names, and defaults for other names."""
    names = [name_of(item, "entry_names") for item in sequence(matrix.get("entry_names"), "entry_names")]
    matched = sequence(matrix.get("entry_values"), "entry_values")
    if len(matched) != len(names):
        raise BadInput(f"{len(matched)} entry_values for {len(names)} entry_names")
    entries = {}
    for name, row in zip(names, matched, strict=True):
        row = sequence(row.get("enabled") if isinstance(row, Mapping) else row, "enabled")
        if len(row) != len(names):
            raise BadInput(f"the row of {name} has {len(row)} entries for {len(names)} names")
        for other, enabled in zip(names, row, strict=True):
            if name < other or (name, other) not in entries:
                entries[min(name, other), max(name, other)] = _flag(enabled)
    fixed = [name_of(n, "default_entry_names") for n in sequence(matrix.get("default_entry_names"), "it")]
    values = sequence(matrix.get("default_entry_values"), "default_entry_values")
    if len(values) != len(fixed):
        raise BadInput(f"{len(values)} default_entry_values for {len(fixed)} default_entry_names")
    return AllowedPairs(entries, dict(zip(fixed, map(_flag, values), strict=True)))


def _flag(value: Any) -> bool:
    if value not in (True, False):  # 0 and 1 equal them
        raise BadInput(f"an entry is {brief(value)}; expected true or false")
    return bool(value)
