"""Where the meshes of a URDF's collision bodies lie on this machine: package:// and model:// paths resolved."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlparse

from energy_opt.errors import BadInput
from energy_opt.robot.xml import read_robot_xml

KNOWN_FORMATS = (".stl", ".obj", ".dae", ".ply")


@dataclass(frozen=True)
class CollisionUrdf:
    """A URDF whose collision meshes are files of this machine.

    Attributes:
        text: the URDF without visual elements, every mesh of a collision element by absolute path.
        links: links that have a collision element.
        meshes: the mesh files, each once, in order.
    """

    text: str
    links: tuple[str, ...]
    meshes: tuple[Path, ...]


def collision_urdf(path: Path, package_dirs: Sequence[Path] = ()) -> CollisionUrdf:
    """The collision bodies of a URDF with their meshes found.

    A path package://NAME/REST is looked for as DIR/NAME/REST, or DIR/REST where DIR is that package itself, with DIR
    from `package_dirs`, ROS_PACKAGE_PATH, AMENT_PREFIX_PATH (its share folders) and the folders above the URDF.

    Raises:
        BadInput: the file is not a URDF, or meshes are missing; one line that names the first of them.
    """
    path = Path(path)
    for folder in package_dirs:
        if not folder.is_dir():
            raise BadInput(f"--package-dir {folder}: no such folder")
    root = read_robot_xml(path)
    roots = [*package_dirs, *_ros_folders(), *path.resolve().parents]
    links, meshes, missing = [], [], []
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
        bodies = link.findall("collision")
        if bodies:
            links.append(str(link.get("name")))
        for mesh in (m for body in bodies for m in body.iter("mesh")):
            name = mesh.get("filename", "")
            found = next((p for p in _candidates(name, path, roots) if p.is_file()), None)
            if found is None:
                missing.append(f"{name or 'a mesh without filename'} (link {link.get('name')})")
                continue
            if found.suffix.lower() not in KNOWN_FORMATS:
                raise BadInput(f"{path}: link {link.get('name')}: {found}: expected {', '.join(KNOWN_FORMATS)}")
            mesh.set("filename", str(found.absolute()))
            meshes.append(found.absolute())
    if missing:
        total = len(missing) + len(meshes)
        raise BadInput(
            f"{path}: {len(missing)} of {total} collision meshes not found, first {missing[0]}; say where its package "
            "lies with --package-dir DIR, or go on without the arm's body by --self-collision off"
        )
    return CollisionUrdf(ElementTree.tostring(root, encoding="unicode"), tuple(links), tuple(dict.fromkeys(meshes)))


def _ros_folders() -> Iterator[Path]:
    """Folders of packages that a ROS environment names."""
    for folder in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        yield Path(folder)
    for folder in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(folder) / "share"


def _candidates(name: str, urdf: Path, roots: Sequence[Path]) -> Iterator[Path]:
    """Files that a mesh's name may mean, the likeliest first; none for an empty name."""
    parts = urlparse(name)
    if parts.scheme in ("package", "model"):
        rest = unquote(parts.path).lstrip("/")
        for root in roots:
            yield root / parts.netloc / rest
            if root.name == parts.netloc or (root / "package.xml").is_file():
                yield root / rest
    elif parts.scheme == "file":
        yield Path(unquote(parts.netloc + parts.path))
    elif name:
        yield urdf.resolve().parent / name
