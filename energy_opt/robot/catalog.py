"""The robots known by name: where their URDF is, and which joints (grippers) stay locked."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass, field
from pathlib import Path

from energy_opt.errors import BadInput

DATA = Path(__file__).parent / "data"


@dataclass(frozen=True)
class Entry:
    """A robot by name; `file` is relative to example-robot-data's folder, or to this package's own where `own`."""

    file: str
    own: bool = False
    lock: dict[str, float] = field(default_factory=dict)


CATALOG: dict[str, Entry] = {
    "panda": Entry("panda_description/urdf/panda.urdf", lock={"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}),
    "ur3": Entry("ur_description/urdf/ur3_robot.urdf"),
    "ur5": Entry("ur_description/urdf/ur5_robot.urdf"),
    "ur10": Entry("ur_description/urdf/ur10_robot.urdf"),
    "kinova": Entry("kinova_description/robots/kinova.urdf"),
    "xarm7": Entry("xarm_description/urdf/xarm7.urdf"),
    "z1": Entry("z1_description/urdf/z1.urdf", lock={"jointGripper": 0.0}),
    "ur3e": Entry("urdf/ur3e.urdf", own=True),
    "ur5e": Entry("urdf/ur5e.urdf", own=True),
    "ur10e": Entry("urdf/ur10e.urdf", own=True),
}


def known_robots() -> tuple[str, ...]:
    """The names that `load_robot` takes beside paths of URDF files."""
    return tuple(CATALOG)


def urdf_of(entry: Entry) -> Path:
    """Where the URDF of a catalogue entry lies on this machine."""
    if entry.own:
        return DATA / entry.file
    beside = importlib.util.find_spec("cmeel")
    roots = [Path(sys.prefix) / "share/example-robot-data/robots"]
    if beside is not None and beside.submodule_search_locations:
        site = Path(next(iter(beside.submodule_search_locations))).parent
        roots.insert(0, site / "cmeel.prefix/share/example-robot-data/robots")
    for root in roots:
        if (root / entry.file).is_file():
            return root / entry.file
    raise BadInput(f"{entry.file} is not installed; expected from the package example-robot-data")


def published_limits(name: str) -> Path | None:
    """Published limits of a robot by name, kept in this package, where there are any."""
    path = DATA / "limits" / f"{name}.yaml"
    return path if path.is_file() else None
