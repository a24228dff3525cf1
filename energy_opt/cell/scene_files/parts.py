"""Parts that every kind of scene file has: numbers, poses, sizes, names, shapes. Faults are collected, not raised.

Meshes come from STL and OBJ files. This is the only module that imports trimesh.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from reprlib import repr as brief
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from energy_opt.cell.scene import FARTHEST, SIZES, AllowedPairs, Kind, SceneObject, Shape
from energy_opt.errors import BadInput, suggest
from energy_opt.files import inside

MOST_SHAPES = 100_000  # most shapes in a scene
MOST_TRIANGLES = 1_000_000  # most triangles in all meshes of a scene
ZERO_QUATERNION = 1e-3  # a quaternion shorter than this has no direction
UNIT_QUATERNION = 0.01  # difference from unit length above which a quaternion causes a warning


@dataclass
class Reading:
    """Content of a scene file read so far, and its faults.

    Attributes:
        path: the file; meshes are looked for in its folder.
        objects: by name, in the order of the file.
        poses: of the tool, by name, as the file has them.
        allowed: the pairs of bodies that may touch.
        root: the file's name of the scene's frame, if it has one.
    """

    path: Path
    allow_outside: bool = False
    allow_large: bool = False
    objects: dict[str, SceneObject] = field(default_factory=dict)
    poses: dict[str, object] = field(default_factory=dict)
    allowed: AllowedPairs = field(default_factory=AllowedPairs)
    faults: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    root: str = ""
    shapes: int = 0
    triangles: int = 0

    @contextmanager
    def at(self, where: str) -> Iterator[None]:
        """A part of the file: an error in it becomes one fault, and reading continues after it."""
        try:
            yield
        except BadInput as error:
            self.faults.append(f"{self.path}: {where}: {error}")

    def warn(self, text: str) -> None:
        """Note, once, something that is not used."""
        line = f"{self.path}: {text}"
        if line not in self.warnings:
            self.warnings.append(line)

    def add(self, thing: SceneObject) -> None:
        """Take an object; BadInput where its name is taken or it has no shape."""
        if thing.name in self.objects:
            raise BadInput("is given twice; give each object its own name")
        if not thing.shapes:
            raise BadInput("has no shape")
        self.objects[thing.name] = thing

    def shape(self, kind: Kind, size: Sequence[float], pose: np.ndarray) -> Shape:
        """A primitive with its size checked.

        Args:
            kind: of the primitive. size: [m] as many numbers as `SIZES` names. pose: (4, 4).

        Raises:
            BadInput: another number of sizes, one that is not above 0 or beyond FARTHEST, or too many bodies.
        """
        names = SIZES[kind]
        if len(size) != len(names):
            raise BadInput(f"{kind} with {len(size)} sizes; expected {', '.join(names) or 'none'}")
        for name, value in zip(names, size, strict=True):
            if not 0 < value <= FARTHEST:
                raise BadInput(f"{name} of its {kind} is {value:g}; expected metres above 0, at most {FARTHEST:g}")
        self._count()
        return Shape(kind, tuple(size), pose)

    def mesh(self, vertices: np.ndarray, triangles: np.ndarray, pose: np.ndarray) -> Shape:
        """A mesh with its numbers checked.

        Args:
            vertices: (V, 3) [m], finite. triangles: (T, 3) indices of vertices. pose: (4, 4).

        Raises:
            BadInput: no triangle, an index without a vertex, no extent, or vertices not finite or too far away.
        """
        if not len(triangles):
            raise BadInput("a mesh without triangles")
        self._count(len(triangles))
        if not np.isfinite(vertices).all() or np.abs(vertices).max() > FARTHEST:
            raise BadInput(f"vertices of its mesh are not all finite and within {FARTHEST:g} m")
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise BadInput(f"its mesh has {len(vertices)} vertices and a triangle that names another")
        if np.ptp(vertices[triangles].reshape(-1, 3), axis=0).max() <= 0:
            raise BadInput("its mesh has no extent")
        return Shape("mesh", (), pose, np.asarray(vertices, dtype=float), np.asarray(triangles, dtype=np.int64))

    def _count(self, triangles: int = 0) -> None:
        """Count one more shape, and the triangles of its mesh.

        Raises:
            BadInput: there are too many, and large scenes are not allowed.
        """
        self.shapes += 1
        self.triangles += triangles
        if self.allow_large:
            return
        if self.shapes > MOST_SHAPES:
            raise BadInput(f"more than {MOST_SHAPES:,} shapes in the scene (--allow-large reads them)")
        if self.triangles > MOST_TRIANGLES:
            raise BadInput(f"more than {MOST_TRIANGLES:,} triangles in the scene's meshes (--allow-large reads them)")


def mapping(value: Any, what: str) -> Mapping[str, Any]:
    """A table of keys; `what` names it in messages.

    Raises:
        BadInput: it is no table.
    """
    if not isinstance(value, Mapping):
        raise BadInput(f"{what} is {brief(value)}; expected a table of keys")
    return value


def sequence(value: Any, what: str) -> Sequence[Any]:
    """A list; None counts as an empty one. `what` names it in messages.

    Raises:
        BadInput: it is no list.
    """
    if value is None:
        return ()
    if not isinstance(value, (list, tuple)):
        raise BadInput(f"{what} is {brief(value)}; expected a list")
    return value


def number(value: Any, what: str) -> float:
    """A finite number; `what` names it in messages.

    Raises:
        BadInput: it is no finite number.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise BadInput(f"{what} is {brief(value)}; expected a number")
    if not abs(value) <= sys.float_info.max:  # whole numbers may be larger
        raise BadInput(f"{what} is {brief(value)}; expected a finite number")
    return float(value)


def vector(value: Any, names: str, what: str) -> list[float]:
    """Numbers from a list in the order of `names`, or from a table with these keys.

    Args:
        value: as read. names: one letter for each number. what: names it in messages.

    Raises:
        BadInput: another count, a missing key, or something that is no finite number.
    """
    if isinstance(value, Mapping):
        missing = [name for name in names if name not in value]
        if missing:
            raise BadInput(f"{what} has no {missing[0]}; expected {', '.join(names)}")
        value = [value[name] for name in names]
    value = sequence(value, what)
    if len(value) != len(names):
        raise BadInput(f"{what} has {len(value)} numbers; expected {', '.join(names)}")
    return [number(item, f"{name} of its {what}") for name, item in zip(names, value, strict=True)]


def pose(reading: Reading, position: Sequence[float], quaternion: Sequence[float]) -> np.ndarray:
    """A pose (4, 4) from a position [m] and a quaternion x, y, z, w; a warning is noted if its length is far from 1.

    Raises:
        BadInput: the position is beyond FARTHEST, or the quaternion is zero.
    """
    if max(map(abs, position)) > FARTHEST:
        raise BadInput(f"position {', '.join(f'{x:g}' for x in position)} is beyond {FARTHEST:g} m")
    length = math.hypot(*quaternion)
    if length < ZERO_QUATERNION:
        raise BadInput("its quaternion is zero; expected x, y, z, w of unit length")
    if abs(length - 1) > UNIT_QUATERNION:
        reading.warn(f"a quaternion has length {length:.3g}; taken as that direction")
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_quat(quaternion).as_matrix(), position
    return out


def plane_pose(reading: Reading, coefficients: Sequence[float]) -> np.ndarray:
    """Pose (4, 4) of the plane a x + b y + c z + d = 0 [m] with the coefficients a, b, c, d: its normal is +z there.

    Raises:
        BadInput: the normal is zero, or the plane is too far away.
    """
    length = math.hypot(*coefficients[:3])
    if length < ZERO_QUATERNION:
        raise BadInput("the normal of its plane is zero")
    *normal, offset = (x / length for x in coefficients)
    # The rotation that takes z to the normal by the shortest way: quaternion (z x n, 1 + z . n); half a turn about x
    # where the normal is -z.
    turn = (-normal[1], normal[0], 0.0, 1 + normal[2]) if normal[2] > -1 + 1e-12 else (1.0, 0.0, 0.0, 0.0)
    return pose(reading, [-offset * n for n in normal], [q / math.hypot(*turn) for q in turn])


def name_of(value: Any, key: str) -> str:
    """The name of an object or link; a number is taken as text. `key` names the entry in messages.

    Raises:
        BadInput: it is no text, or empty.
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        value = str(value)
    if not isinstance(value, str) or not value.strip():
        raise BadInput(f"{key} is {brief(value)}; expected a name")
    return value


def unknown_key(key: Any, known: Iterable[str]) -> str:
    """Message for an unknown key."""
    names = list(known)
    return f"unknown key {brief(key)}" + (suggest(str(key), names) or f"; known are {', '.join(names)}")


LARGEST = 100_000_000  # [bytes] largest mesh file; a binary STL of a million triangles has half of that
MESH_SUFFIXES = (".stl", ".obj")


def read_mesh(reading: Reading, name: Any) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) in the file's unit and triangles (T, 3) of the file `name` in the scene's folder.

    Raises:
        BadInput: no such file, outside of the folder, too large, of another kind, or not readable.
    """
    if not isinstance(name, str) or not name or not name.isprintable():
        raise BadInput("a mesh without a file of that name; expected file: NAME.stl or NAME.obj in the scene's folder")
    folder = reading.path.resolve().parent
    path = inside(folder, name, reading.allow_outside)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise BadInput(f"{name}: expected a mesh of kind {' or '.join(MESH_SUFFIXES)}")
    if not path.is_file():
        raise BadInput(f"{name}: no such file in {folder}")
    size = path.stat().st_size
    if size > LARGEST and not reading.allow_large:
        raise BadInput(f"{name}: {size:,} bytes; expected at most {LARGEST:,} (--allow-large reads it)")
    return _load(path, name)


def _load(path: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and triangles (T, 3) of a mesh file, by trimesh."""
    import trimesh

    try:
        data = path.read_bytes()
        mesh = trimesh.load_mesh(BytesIO(data), file_type=path.suffix.lower()[1:], process=False, skip_materials=True)
        return np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)
    except OSError as error:
        raise BadInput(f"{name}: {error.strerror}") from None
    except Exception as error:  # mesh readers raise many kinds of exceptions on faulty files
        words = " ".join(str(error).split())[:200]
        raise BadInput(f"{name}: not a mesh that can be read ({words or type(error).__name__})") from None
