"""Finds the mesh files of a description's collision bodies on this machine; resolves package:// and model:// paths."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote, urlparse

from energy_opt.errors import BadInput
from energy_opt.robot.description import Description

KNOWN_FORMATS = (".stl", ".obj", ".dae", ".ply")
LARGEST = 100_000_000  # [bytes] largest mesh file; a binary STL of a million triangles has half of that


def mesh_files(
    description: Description, package_dirs: Sequence[Path] = (), allow_large: bool = False
) -> dict[str, Path]:
    """The file of each mesh of the collision bodies, by the name that the description has.

    A path package://NAME/REST is looked for as DIR/NAME/REST, or DIR/REST where DIR is that package itself, with DIR
    from `package_dirs`, ROS_PACKAGE_PATH, AMENT_PREFIX_PATH (its share folders) and the folders above the URDF. The
    path of a file:// address of another machine is looked for below `package_dirs`, from its last folders on.

    Raises:
        BadInput: meshes are missing, of another kind, or too large; one line that names the first of them.
    """
    path = description.path
    for folder in package_dirs:
        if not folder.is_dir():
            raise BadInput(f"--package-dir {folder}: no such folder")
    ros, ament = (os.environ.get(name, "").split(os.pathsep) for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"))
    installed = [*map(Path, filter(None, ros)), *(Path(folder) / "share" for folder in filter(None, ament))]
    roots = [*package_dirs, *installed, *path.resolve().parents]
    wanted = {
        body.file: link.name for link in description.links.values() for body in link.collisions if body.kind == "mesh"
    }
    out: dict[str, Path] = {}
    missing = []
    for name, link in wanted.items():
        try:
            found = next((p for p in _candidates(name, path, roots, package_dirs) if p.is_file()), None)
        except (OSError, ValueError):  # a name that no file can have
            found = None
        if found is None:
            missing.append(f"{name} (link {link})")
            continue
        if found.suffix.lower() not in KNOWN_FORMATS:
            raise BadInput(f"{path}: link {link}: {found}: expected {', '.join(KNOWN_FORMATS)}")
        size = found.stat().st_size
        if size > LARGEST and not allow_large:
            raise BadInput(
                f"{path}: link {link}: {found}: {size:,} bytes; expected a collision mesh of at most {LARGEST:,} "
                "(--allow-large reads it)"
            )
        out[name] = found.absolute()
    if missing:
        raise BadInput(
            f"{path}: {len(missing)} of {len(wanted)} collision meshes not found, first {missing[0]}; give the "
            "folder of its package with --package-dir DIR, or plan without the arm's body with --self-collision off"
        )
    return out


def _candidates(name: str, urdf: Path, roots: Sequence[Path], given: Sequence[Path]) -> Iterator[Path]:
    """Files that a mesh's name may mean, the likeliest first."""
    parts = urlparse(name)
    if parts.scheme in ("package", "model"):
        rest = unquote(parts.path).lstrip("/")
        for root in roots:
            yield root / parts.netloc / rest
            if root.name == parts.netloc or (root / "package.xml").is_file():
                yield root / rest
    elif parts.scheme == "file":
        path = Path(unquote(parts.netloc + parts.path))
        yield urdf.resolve().parent / path
        for k in range(1, len(path.parts) - 1):  # from another machine: at least its last folder and its name
            yield from (root.joinpath(*path.parts[k:]) for root in given)
    else:
        yield urdf.resolve().parent / name
