"""CSV: the samples of trajectory.csv (`time`, `<joint>.position`, ...), and plain ones (`time,joint1,...`)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput, refuse
from energy_opt.formats.waypoints import KINDS, Samples, repeated
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.stamps import restamped
from energy_opt.tables import IMPORT, read_table, write_table

# headers of times with their unit: time_ms, t [s], timestamp(us)
STAMPS = re.compile(r"(?:time|time_?stamp|stamp|elapsed|t)(?:_|\s*[\[(]\s*)(s|ms|us|ns)\s*[\])]?", re.IGNORECASE)
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
MANY = 20  # least samples of a recording, whose recorder may repeat a stamp; in a table of fewer this is a mistake
LIKE_TIME = ("t", "ms", "stamp", "seconds", "secs")  # names like time, besides all that begin with "time"


def read(path: Path) -> Samples:
    """Columns `<joint>.position` (or plainly `<joint>`), `.velocity`, `.acceleration`, `.effort` and `time` of a file.

    Times are seconds, or in the unit that the header states: `time_ms`, `t [us]`. Samples of a recording that repeat a
    stamp are put on the controller's clock or left out, as in a measured set; a note says so.

    Raises:
        BadInput: a line for each fault, with file, row and column: a value is no number, time does not rise, or a
            joint lacks a column that others have.
    """
    table = read_table(path)
    stamps = "time" if "time" in table else next((name for name in table if STAMPS.fullmatch(name)), None)
    joints = [name.removesuffix(".position") for name in table if name.endswith(".position")]
    plain = not joints
    if plain:
        joints = [name for name in table if name not in (stamps, "power") and "." not in name]
    if not joints:
        stem = next((name.rpartition(".")[0] for name in table if "." in name), "<joint>")
        listed = f"columns are {', '.join(table)}; expected names such as {stem}.position; {IMPORT}"
        raise BadInput(f"{path}: row 1: no column <joint>.position; {listed}")
    blocks: dict[str, Any] = {}
    for kind in KINDS:
        columns = [joint if plain and kind == "position" else f"{joint}.{kind}" for joint in joints]
        present = [name for name in columns if name in table]
        if not present:
            continue
        missing = [name for name in columns if name not in table]
        refuse(f"{path}: row 1: column {name} is missing, though {present[0]} is there" for name in missing)
        blocks[kind] = np.column_stack([table[name] for name in columns])
    if stamps is not None:
        stated = STAMPS.fullmatch(stamps)
        clock = table[stamps]
        time = clock * (1.0 if stated is None else SECONDS[stated[1].lower()])
        notes: tuple[str, ...] = ()
        steps = np.diff(time)
        if len(time) >= MANY and steps.min() == 0 and np.count_nonzero(steps) > 1:
            kept, time, remarks = restamped(time, np.column_stack(list(blocks.values())))
            notes = tuple(f"{path}: {remark}" for remark in remarks)
        else:
            fresh = ~repeated(time, blocks["position"])
            late = np.flatnonzero((steps <= 0) & fresh[1:])
            refuse(
                f"{path}: row {k + 3}, column {stamps}: {clock[k + 1]:g} does not come after {clock[k]:g}" for k in late
            )
            kept, time = np.flatnonzero(fresh), time[fresh]
        blocks = {kind: block[kept] for kind, block in blocks.items()}
        return Samples(str(path), tuple(joints), time=time, timed=stated is not None, notes=notes, **blocks)
    like = [name for name in table if name.lower() in LIKE_TIME or name.lower().startswith("time")][:1]
    untimed = "expected a column time [s], or with its unit, such as time_ms"
    untimed += f"; found {like[0]!r}, which is not read" if like else ""
    notes = (f"{path}: waypoints without times; {untimed}",) if like else ()
    return Samples(str(path), tuple(joints), untimed=untimed, notes=notes, **blocks)


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
