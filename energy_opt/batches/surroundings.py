"""Body and cell of a suite's moves, in a form that any worker can take: files are carried as text."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from energy_opt.batches.faults import Faults, Files, is_number
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene_files import carried, read_scene
from energy_opt.errors import BadInput
from energy_opt.files import read_text
from energy_opt.robot import Robot

if TYPE_CHECKING:
    from energy_opt.cell.cell import Cell

KEYS = (
    "self_collision",
    "scene",
    "base",
    "floor",
    "clearance",
    "planner",
    "srdf",
    "payload_size",
    "package_dirs",
    "tool",
)


@dataclass(frozen=True)
class Surroundings:
    """What a move must keep clear of.

    Attributes:
        request: as asked for, less its files.
        scene, srdf: the content of these files (see `carried`); empty where there is none.
    """

    request: CellRequest = field(default_factory=CellRequest)
    scene: str = ""
    srdf: str = ""

    def cell(self, robot: Robot, payload: tuple[float, ...] = ()) -> Cell:
        """The robot's body in its cell; a payload's box is about its centre of mass."""
        from energy_opt.cell.cell import Cell

        request = self.request
        if request.payload_size is not None:
            request = replace(request, payload_at=payload[1:]) if payload else replace(request, payload_size=None)
        scene = carried.from_text(self.scene) if self.scene else None
        with tempfile.TemporaryDirectory(prefix="energy-opt-") as folder:
            if self.srdf:
                file = Path(folder) / f"{robot.name}.srdf"
                file.write_text(self.srdf, encoding="utf-8")
                request = replace(request, srdf=file)
            return Cell(robot, request, scene)


def read_surroundings(table: Mapping[str, Any], files: Files, faults: Faults) -> Surroundings:
    """Body and cell that a suite's table asks for; what is faulty is named in `faults` and left out."""
    given: dict[str, Any] = {}
    for key, kind, expected in (
        ("self_collision", bool, "true or false"),
        ("planner", str, "a planner's name"),
        ("tool", str, "FRAME or FRAME,X,Y,Z"),
        ("floor", float, "a height [m]"),
        ("clearance", float, "metres"),
        ("base", list, "[x, y, z, roll, pitch, yaw]"),
        ("payload_size", list, "[x, y, z] [m]"),
    ):
        if key not in table:
            continue
        value: Any = table[key]
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        numbers = value if isinstance(value, list) else [0]
        if not isinstance(value, kind) or not all(map(is_number, numbers)):
            faults.add(key, f"{table[key]!r}; expected {expected}")
        else:
            given[key] = tuple(float(x) for x in value) if isinstance(value, list) else value
    if "package_dirs" in table:
        try:
            given["package_dirs"] = _folders(table["package_dirs"], files)
        except BadInput as error:
            faults.add("package_dirs", str(error))
    scene = srdf = ""
    try:
        request = CellRequest(**given)
    except BadInput as error:
        faults.add("cell", str(error))
        request = CellRequest()
    try:
        if "scene" in table:
            scene = carried.to_text(
                read_scene(
                    _path(table["scene"], "scene", files),
                    allow_outside=files.allow_outside,
                    allow_large=files.allow_large,
                )
            )
        if "srdf" in table:
            srdf = read_text(_path(table["srdf"], "srdf", files))
    except BadInput as error:
        faults.add("scene" if not scene and "scene" in table else "srdf", str(error))
    return Surroundings(request, scene, srdf)


def _path(name: Any, key: str, files: Files) -> Path:
    if not isinstance(name, str):
        raise BadInput(f"{name!r} is not a file beside the suite")
    return files.path(name, key)


def _folders(names: Any, files: Files) -> tuple[Path, ...]:
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise BadInput(f"{names!r}; expected a list of folders")
    return tuple(files.path(name, "package_dirs").resolve() for name in names)
