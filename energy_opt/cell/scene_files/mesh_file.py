"""Meshes from STL and OBJ files. The only module that imports trimesh."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.scene_files.parts import Reading
from energy_opt.errors import BadInput
from energy_opt.files import inside

LARGEST = 100_000_000  # bytes; a binary STL of a million triangles has half of that
SUFFIXES = (".stl", ".obj")


def read_mesh(reading: Reading, name: Any) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) in the file's unit and triangles (T, 3) of a file in the scene's folder.

    Raises:
        BadInput: no such file, outside of the folder, too large, of another kind, or not readable.
    """
    if not isinstance(name, str) or not name or not name.isprintable():
        raise BadInput("a mesh without a file of that name; expected file: NAME.stl or NAME.obj in the scene's folder")
    folder = reading.path.resolve().parent
    path = inside(folder, name, reading.allow_outside)
    if path.suffix.lower() not in SUFFIXES:
        raise BadInput(f"{name}: expected a mesh of kind {' or '.join(SUFFIXES)}")
    if not path.is_file():
        raise BadInput(f"{name}: no such file in {folder}")
    size = path.stat().st_size
    if size > LARGEST and not reading.allow_large:
        raise BadInput(f"{name}: {size:,} bytes; expected at most {LARGEST:,} (--allow-large takes it)")
    return _load(path, name)


def _load(path: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    try:
        data = path.read_bytes()
        mesh = trimesh.load_mesh(BytesIO(data), file_type=path.suffix.lower()[1:], process=False, skip_materials=True)
        return np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)
    except OSError as error:
        raise BadInput(f"{name}: {error.strerror}") from None
    except Exception as error:  # what a reader of meshes raises on a faulty file is no closed list
        words = " ".join(str(error).split())[:200]
        raise BadInput(f"{name}: not a mesh that can be read ({words or type(error).__name__})") from None
