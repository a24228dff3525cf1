"""Robots that are known by name: where their files lie, and which joints are usually locked."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass, field
from pathlib import Path

from energy_opt.errors import BadInput
from energy_opt.files import inside, read_toml

DATA = Path(__file__).parent / "data"


@dataclass(frozen=True)
class Entry:
    """A robot by name; its files are relative to example-robot-data's folder, or to this package's own where `own`."""

    file: str
    own: bool = False
    lock: dict[str, float] = field(default_factory=dict)
    srdf: str | None = None


CATALOG: dict[str, Entry] = {name: Entry(**row) for name, row in read_toml(DATA / "catalog.toml").items()}


def known_robots() -> tuple[str, ...]:
    """The names that `load_robot` takes beside paths of URDF files."""
    return tuple(CATALOG)


def urdf_of(entry: Entry) -> Path:
    """Where the URDF of a catalogue entry lies on this machine; BadInput if it is not installed."""
    if entry.own:
        return DATA / entry.file
    found = _installed(entry.file)
    if found is None:
        raise BadInput(f"{entry.file} is not installed; expected from the package example-robot-data")
    return found


def srdf_beside(name: str, urdf: Path) -> Path | None:
    """The SRDF that comes with a robot by name; None where there is none, or where `urdf` is another robot's file."""
    entry = CATALOG.get(name)
    if entry is None or entry.srdf is None or urdf != urdf_of(entry):
        return None
    return _installed(entry.srdf)


def _installed(file: str) -> Path | None:
    """A file of example-robot-data on this machine."""
    beside = importlib.util.find_spec("cmeel")
    roots = [Path(sys.prefix) / "share/example-robot-data/robots"]
    if beside is not None and beside.submodule_search_locations:
        site = Path(next(iter(beside.submodule_search_locations))).parent
        roots.insert(0, site / "cmeel.prefix/share/example-robot-data/robots")
    return next((root / file for root in roots if (root / file).is_file()), None)


def robot_named(name: str, folder: Path, allow_outside: bool = False) -> str:
    """The robot that a document in `folder` names: a name in the catalogue, or the path of a URDF.

    Raises:
        BadInput: the URDF lies outside of the folder, and `allow_outside` is False.
    """
    if not name or name in CATALOG:
        return name
    path = inside(folder, name, allow_outside)
    return name if allow_outside and not path.is_file() else str(path)
