"""Joint positions for a libfranka callback: one row for each of its 1 kHz steps, within its discontinuity limits.

libfranka differentiates the commanded positions once, twice and three times from step to step, from rest before the
first to rest after the last, and aborts a motion whose velocity, acceleration or jerk is beyond the arm's limits.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.formats.resample import of_steps
from energy_opt.formats.waypoints import Samples
from energy_opt.motion.trajectory import Trajectory
from energy_opt.tables import read_table, write_table

RATE = 1000.0  # [Hz]
JOINTS = 7


def check_arm(joints: int) -> None:
    """Raise BadInput where the arm does not have seven joints."""
    if joints != JOINTS:
        raise BadInput(f"--write franka: for arms of seven joints; this one has {joints}")


def write(trajectory: Trajectory, path: Path) -> None:
    """Write `time` and a column of positions for each joint; every digit."""
    write_table(path, ["time", *trajectory.joints], [trajectory.time, *trajectory.position.T])


def read(path: Path) -> Samples:
    """The samples of such a file; velocity and acceleration as differences over two steps.

    Raises:
        BadInput: it is no table of time and positions at 1 kHz.
    """
    table = read_table(path)
    time = table.pop("time", None)
    if time is None or len(time) < 2 or np.abs(np.diff(time) * RATE - 1).max() > 1e-6:
        raise BadInput(f"{path}: expected a column time in steps of 1 ms")
    t = of_steps(tuple(table), np.column_stack(list(table.values())), RATE)
    return Samples(str(path), t.joints, t.position, t.time, t.velocity, t.acceleration, planned=True, steps=RATE)
