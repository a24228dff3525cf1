"""Finds the mesh files of a description's collision bodies on this machine; resolves package:// and model:// paths."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Sequence
from itertools import islice
from pathlib import Path
from urllib.parse import unquote, urlparse

from energy_opt.errors import BadInput
from energy_opt.robot.description import Description

KNOWN_FORMATS = (".stl", ".obj", ".dae", ".ply")
LARGEST = 100_000_000  # [bytes] largest mesh file; a binary STL of a million triangles has half of that
# packages are looked for so many levels below --package-dir, among so many folders of each level
LEVELS, FOLDERS = 4, 5000


def mesh_files(
    description: Description, package_dirs: Sequence[Path] = (), allow_large: bool = False
) -> dict[str, Path]:
    """The file of each mesh of the collision bodies, by the name that the description has.

    A path package://NAME/REST is looked for as DIR/NAME/REST, or DIR/REST where DIR is that package itself, with DIR
    from `package_dirs`, ROS_PACKAGE_PATH, AMENT_PREFIX_PATH (its share folders) and the folders above the URDF; last,
    in folders NAME a few levels below `package_dirs`. The path of a file:// address of another machine is looked for
    below `package_dirs`, from its last folders on.

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
    packages: list[Path] | None = None
    for name, link in wanted.items():
        found = _first(_candidates(name, path, roots, package_dirs))
        if found is None and package_dirs:
            if packages is None:
                packages = [p.parent for p in _below(package_dirs, {urlparse(n).netloc for n in wanted})]
            found = _first(_candidates(name, path, packages, ()))
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
        folders = ", ".join(map(str, package_dirs))
        looked = f" (looked in {folders} and up to {LEVELS} folders below)" if package_dirs else ""
        raise BadInput(
            f"{path}: {len(missing)} of {len(wanted)} collision meshes not found{looked}, first {missing[0]}; give the "
            "folder of its package with --package-dir DIR, or plan without the arm's body with --self-collision off"
        )
    return out


def _first(candidates: Iterator[Path]) -> Path | None:
    """The first of them that is a file; None if none is."""
    try:
        return next((p for p in candidates if p.is_file()), None)
    except (OSError, ValueError):  # a name that no file can have
        return None


def _below(folders: Sequence[Path], names: Collection[str]) -> list[Path]:
    """Folders of these names at most `LEVELS` below the given ones, the nearest first; hidden ones are left out."""
    level, out = list(folders), list[Path]()
    for _ in range(LEVELS):
        level = list(islice((inner for folder in level for inner in _folders_in(folder)), FOLDERS))
        out += [folder for folder in level if folder.name in names]
    return out


def _folders_in(folder: Path) -> list[Path]:
    """The folders in a folder that are not hidden, by their names; none if it cannot be read."""
    try:
        return sorted(p for p in folder.iterdir() if not p.name.startswith(".") and p.is_dir())
    except OSError:
        return []


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
