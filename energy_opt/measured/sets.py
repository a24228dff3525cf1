"""From the files of a measured set to its runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.measured.columns import PAYLOAD, SIGNALS, Rule, build_rules
from energy_opt.measured.log import LogFile, RunEntry, read_log
from energy_opt.measured.run import MeasuredSet, Run
from energy_opt.measured.segment import cut_at_standstill
from energy_opt.measured.table import Table
from energy_opt.robot import PointMass, Robot, load_robot


def read_set(folder: Path, robot: Robot | None = None) -> MeasuredSet:
    """Read a measured set.

    Args:
        folder: the set's folder, or its log.toml.
        robot: the robot to use instead of the one that the log names.

    Raises:
        BadInput: the first fault, with file, row and column, and how many more there are.
    """
    log = read_log(folder)
    robot = robot or robot_of(log)
    runs, faults = collect(log, robot)
    if faults:
        more = f" (and {len(faults) - 1} more faults; `energy-opt check` lists them)" if len(faults) > 1 else ""
        raise BadInput(faults[0] + more)
    return MeasuredSet(log.path.parent, robot, tuple(runs), _clock(log), stated_payload(log))


def stated_payload(log: LogFile) -> PointMass | None:
    """The payload that the recorder states, in the last joint's frame; None where it states none or several."""
    names = PAYLOAD.get(log.preset or "", ())
    stated = []
    for entry in log.runs:
        table = Table(log.path.parent / entry.file)
        if not names or not all(name in table for name in names):
            return None
        values = np.column_stack([table.column(name) for name in names])
        if table.faults or np.ptp(values, axis=0).max() > 0:
            return None
        stated.append(values[0])
    if not stated or any(not np.array_equal(x, stated[0]) for x in stated) or stated[0][0] <= 0:
        return None
    return PointMass(float(stated[0][0]), stated[0][1:])


def _clock(log: LogFile) -> bool:
    """True where the set time of every run is known."""
    return len(log.runs) == 1 or all(entry.start is not None for entry in log.runs)


def robot_of(log: LogFile, limits: Path | None = None) -> Robot:
    """The robot that a log names; a URDF's path counts from the set's folder. `limits`: a joint_limits.yaml."""
    beside = log.path.parent / log.robot
    name = str(beside) if beside.suffix in (".urdf", ".xml") and beside.is_file() else log.robot
    return load_robot(name, limits=limits)


def collect(log: LogFile, robot: Robot) -> tuple[list[Run], list[str]]:
    """All runs that can be read, and every fault found on the way."""
    faults = [
        f"{log.path}: columns.{key}: no joint {key.rpartition('.')[0]!r}; the robot's are {', '.join(robot.joints)}"
        for key in log.rules
        if key.rpartition(".")[0] not in (*robot.joints, "", "power")
    ]
    rules = build_rules(robot.joints, log.preset, log.rules)
    runs: list[Run] = []
    clock = 0.0
    for entry in log.runs:
        try:
            run, found = _read_run(log, entry, robot, rules, clock)
        except BadInput as error:
            faults.append(str(error))
            continue
        faults += found
        if run is not None and not found:
            clock = run.start + float(run.time[-1])
            runs += cut_at_standstill(run) if log.standstill else [run]
    return runs, faults


def _read_run(
    log: LogFile, entry: RunEntry, robot: Robot, rules: dict[str, Rule], clock: float
) -> tuple[Run | None, list[str]]:
    table = Table(log.path.parent / entry.file)
    time = _quantity(table, rules["time"])
    signals = {signal: _per_joint(table, robot.joints, rules, signal) for signal in SIGNALS}
    power_table, power_time = table, time
    if entry.power_file is not None:
        power_table = Table(log.path.parent / entry.power_file)
        power_time = _quantity(power_table, _power_time(power_table, rules))
    power = _quantity(power_table, rules["power"])
    faults = list(table.faults)
    if entry.power_file is not None:
        faults += power_table.faults
    faults = list(dict.fromkeys(faults))
    position = signals["position"]
    if faults or position is None:
        return None, faults
    faults = _clock_faults(table, rules["time"], time)
    if entry.power_file is not None:
        faults += _clock_faults(power_table, _power_time(power_table, rules), power_time)
    if faults:
        return None, faults
    zero = 0.0 if entry.power_file is not None or abs(time[0]) < 3600.0 else float(time[0])
    time, power_time = time - zero, power_time - zero
    overlap = min(time[-1], power_time[-1]) - max(time[0], power_time[0])
    if overlap < 0.5 * (time[-1] - time[0]):
        return None, [
            f"{power_table.path}: its clock runs from {power_time[0]:g} to {power_time[-1]:g} s, the motion's from "
            f"{time[0]:g} to {time[-1]:g} s: they hardly overlap; both count from the run's time 0"
        ]
    inside = (power_time >= time[0] - 1e-9) & (power_time <= time[-1] + 1e-9)
    start = clock if entry.start is None else entry.start
    run = Run(
        entry.file, entry.kind, start, time, position, signals["velocity"], signals["acceleration"], signals["effort"],
        signals["temperature"], power_time[inside], power[inside],
    )  # fmt: skip
    return run, []


def _power_time(table: Table, rules: dict[str, Rule]) -> Rule:
    if "power.time" in rules:
        return rules["power.time"]
    return rules["time"] if all(name in table for name in rules["time"].columns) else Rule(("time",))


def _quantity(table: Table, rule: Rule) -> np.ndarray:
    return table.product(rule.columns) * rule.factor


def _per_joint(table: Table, joints: Sequence[str], rules: dict[str, Rule], signal: str) -> np.ndarray | None:
    """(N, n) of a signal; None where the file has none of its columns and need not have them."""
    wanted = [rules.get(f"{joint}.{signal}") for joint in joints]
    there = [rule is not None and all(name in table for name in rule.columns) for rule in wanted]
    if signal != "position" and not any(there):
        return None
    columns = [_quantity(table, rule) for rule in wanted if rule is not None]
    return np.column_stack(columns) if len(columns) == len(joints) else None


def _clock_faults(table: Table, rule: Rule, time: np.ndarray) -> list[str]:
    if len(time) < 8:
        return [f"{table.path}: {len(time)} data rows; a run needs at least 8"]
    back = np.flatnonzero(np.diff(time) <= 0)
    if back.size:
        row = table.row_number(int(back[0]) + 1)
        return [
            f"{table.path}: row {row}, column {rule.columns[0]}: time {time[back[0] + 1]:g} s does not come after "
            f"{time[back[0]]:g} s"
        ]
    step = np.diff(time)
    gap = int(np.argmax(step))
    if step[gap] > max(0.25, 10 * float(np.median(step))):
        row = table.row_number(gap + 1)
        return [
            f"{table.path}: row {row}, column {rule.columns[0]}: {step[gap]:.3g} s without a sample; "
            "split the run there"
        ]
    return []
