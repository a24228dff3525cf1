"""CSV: the samples of trajectory.csv (`time`, `<joint>.position`, ...), and plain ones (`time,joint1,...`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import read_table, write_table
from energy_opt.formats.waypoints import KINDS, Samples
from energy_opt.motion.trajectory import Trajectory

LIKE_TIME = ("t", "t [s]", "stamp", "seconds", "secs")  # names like time, besides all that begin with "time"


def read(path: Path) -> Samples:
    """Columns `<joint>.position` (or plainly `<joint>`), `.velocity`, `.acceleration`, `.effort` and `time` of a file.

    Raises:
        BadInput: names file, row and column at fault: a value is no number, time does not rise, or a joint lacks a
            column that others have.
    """
    table = read_table(path)
    joints = [name.removesuffix(".position") for name in table if name.endswith(".position")]
    plain = not joints
    if plain:
        joints = [name for name in table if name not in ("time", "power") and "." not in name]
    if not joints:
        raise BadInput(f"{path}: row 1: no column <joint>.position; columns are {', '.join(table)}")
    blocks: dict[str, Any] = {}
    for kind in KINDS:
        columns = [joint if plain and kind == "position" else f"{joint}.{kind}" for joint in joints]
        present = [name for name in columns if name in table]
        if not present:
            continue
        if len(present) < len(columns):
            missing = next(name for name in columns if name not in table)
            raise BadInput(f"{path}: row 1: column {missing} is missing, though {present[0]} is there")
        blocks[kind] = np.column_stack([table[name] for name in columns])
    time = table.get("time")
    if time is not None:
        late = np.flatnonzero(np.diff(time) <= 0)
        if late.size:
            k = int(late[0])
            raise BadInput(f"{path}: row {k + 3}, column time: {time[k + 1]:g} does not come after {time[k]:g}")
    like = [name for name in table if name.lower() in LIKE_TIME or name.lower().startswith("time")]
    like = [] if time is not None else like[:1]
    notes = tuple(f"{path}: waypoints: no column is called time, {name!r} is not read" for name in like)
    return Samples(str(path), tuple(joints), time=time, notes=notes, **blocks)


def write(trajectory: Trajectory, path: Path) -> None:
    """Write time, <joint>.position, .velocity, .acceleration, and .effort and power where known; every digit."""
    header, columns = ["time"], [trajectory.time]
    for kind in KINDS:
        block = getattr(trajectory, kind)
        if block is not None:
            header += [f"{joint}.{kind}" for joint in trajectory.joints]
            columns += list(block.T)
    if trajectory.power is not None:
        header.append("power")
        columns.append(trajectory.power)
    write_table(path, header, columns)
