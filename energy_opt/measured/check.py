"""Is a measured set usable: every fault, with file, row and column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.measured.differentiate import choose_smoothing, coarse, kinematics
from energy_opt.measured.log import LogFile, read_log
from energy_opt.measured.run import Run
from energy_opt.measured.sets import collect, robot_of
from energy_opt.robot import Robot

MISMATCH = 0.2  # logged velocity may differ from that of the positions by this share of its own spread (rms)


def check_set(folder: str | Path, allow_outside: bool = False) -> list[str]:
    """All faults of a measured set, empty where it can be used as it is; never raises for a faulty file."""
    return inspect_set(Path(folder), allow_outside)[0]


def inspect_set(
    folder: Path, allow_outside: bool = False, lock: Mapping[str, float] | None = None
) -> tuple[list[str], list[str]]:
    """All faults of a measured set, and remarks on what reading took: samples dropped, recordings cut, clocks found.

    `lock`: joints of the log's robot that stay, and where.
    """
    try:
        log = read_log(folder, allow_outside)
        robot = robot_of(log, None, lock)
    except BadInput as error:
        return str(error).splitlines(), []
    runs, faults, remarks = collect(log, robot)
    for run in runs:
        faults += _plausible(run, robot, str(log.path.parent / run.file.partition("#")[0]))
    faults += _constant(runs, log)
    if not faults and not any(len(run.power) for run in runs):
        remarks.append("no run has a reading of power: nothing but currents and torques can be identified")
    return faults, remarks


def _plausible(run: Run, robot: Robot, where: str) -> list[str]:
    faults = []
    moved = np.ptp(run.position, axis=0)
    if run.kind == "static" and moved.max() > 0.01:
        joint = robot.joints[int(np.argmax(moved))]
        unit = robot.unit("position", joint)
        faults.append(f"{where}: column {joint}.position: moves by {moved.max():.3g} {unit} in a run called static")
    for j, joint in enumerate(robot.joints):
        margin = 0.05
        low, high = robot.limits.lower[j] - margin, robot.limits.upper[j] + margin
        out = np.flatnonzero((run.position[:, j] < low) | (run.position[:, j] > high))
        if out.size:
            row, value = int(run.lines[out[0]]), run.position[out[0], j]
            faults.append(
                f"{where}: row {row}, column {joint}.position: {value:.4g} {robot.units[j]} is outside the joint's "
                f"limits [{low + margin:.4g}, {high - margin:.4g}]; is the unit right?"
            )
    if run.velocity is not None and len(run.time) > 16 and not coarse(run):
        positions = _positions_only(run)
        own = kinematics(positions, run.time, choose_smoothing([positions])).v
        for j, joint in enumerate(robot.joints):
            spread = float(np.std(own[:, j]))
            off = float(np.sqrt(np.mean((run.velocity[:, j] - own[:, j]) ** 2)))
            if spread > 0.02 and off > MISMATCH * spread:
                faults.append(
                    f"{where}: column {joint}.velocity: differs from the slope of the positions by {off:.3g} "
                    f"{robot.unit('velocity', joint)} rms "
                    f"(its own spread is {spread:.3g}); are unit and joint right?"
                )
    return faults


def _constant(runs: Sequence[Run], log: LogFile) -> list[str]:
    """Meters that show one value throughout a recording."""
    by_file: dict[str, list[np.ndarray]] = {}
    for run in runs:
        by_file.setdefault(run.file.partition("#")[0], []).append(run.power)
    faults = []
    for file, powers in by_file.items():
        power = np.concatenate(powers)
        if power.size > 100 and np.ptp(power) == 0:
            faults.append(
                f"{log.path.parent / file}: column power: is {power[0]:g} W throughout; is the meter connected?"
            )
    return faults


def _positions_only(run: Run) -> Run:
    import dataclasses

    return dataclasses.replace(run, velocity=None, acceleration=None)
