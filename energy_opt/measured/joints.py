"""The joints' side of a recording: stamps and signals from a table, in SI units and in the robot's order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.measured.columns import Rule, factor_of
from energy_opt.measured.run import JOINT_SIGNALS
from energy_opt.measured.stamps import Stamped, backward, clean
from energy_opt.measured.table import Table
from energy_opt.robot import Robot
from energy_opt.robot.limits import look_like_degrees

FEWEST = 8  # samples of a run
# Beyond these a value is no measurement of an arm's: SI units, absolute values.
LARGEST = {
    "time": 1e11, "position": 1e4, "velocity": 1e4, "acceleration": 1e6, "effort": 1e6, "current": 1e5,
    "temperature": 1e3, "power": 1e7, "energy": 1e13,
}  # fmt: skip
FAR = 1.5  # [rad] outside a limit, from which positions are taken for degrees
TOO_FAST = 20.0  # velocity limits, from which the stamps' unit is doubted
COARSEST = 1.0  # [s] between samples of a motion; what is coarser is no motion, or its stamps are in another unit
FINEST = 1e-5  # [s]
EPOCH = 1e8  # [s] later stamps count from 1970 and hold for every file alike


@dataclass(frozen=True)
class Joints:
    """Samples of the joints: `index` in the table of those kept, `dropped` of repeats; `time` counts as stamps do."""

    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    stamps: Stamped
    index: np.ndarray
    dropped: np.ndarray
    dated: bool


def quantity(table: Table, name: str, rule: Rule) -> np.ndarray:
    """A quantity in SI units, (N,), nan where cells are empty; what no arm can have is added to the table's faults."""
    values = table.product(rule.columns)
    factor = factor_of(name, rule, table)
    if name.endswith("time"):
        factor = 1.0 if table.is_date(rule.columns[0]) else stamp_factor(values, name) if np.isnan(factor) else factor
    values = values * factor
    kind = "time" if name.endswith("time") else name.rpartition(".")[2]
    wild = np.flatnonzero(np.abs(values) > LARGEST[kind])
    if wild.size:
        table.faults.append(
            f"{table.path}: row {table.row_number(int(wild[0]))}, column {' * '.join(rule.columns)}: "
            f"{values[wild[0]]:.4g} cannot be a {kind} (SI units); is the file damaged, or the unit another?"
        )
    return values


def stamp_factor(stamps: np.ndarray, name: str = "time", span: float | None = None) -> float:
    """Seconds per unit of stamps whose unit nobody says: by their size where they count from 1970, else by their step.

    Recorders of arms write 5 to 2000 samples/s, so a step of 0.5 or more is no second's; meters write 0.1 to 100.
    A `span` [s] that the file should have about decides before that.
    """
    stamps = stamps[np.isfinite(stamps)]
    if len(stamps) < 2:
        return 1.0
    size, step = float(np.median(np.abs(stamps))), np.diff(stamps)
    step = step[step > 0]
    usual = float(np.median(step)) if step.size else 1.0
    for first, factor in ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3)):
        if size > first:
            return factor
    if size > EPOCH and float(stamps[-1] - stamps[0]) < 1e6 and usual < 20:
        return 1.0
    if span is not None:
        return min((1.0, 1e-3, 1e-6, 1e-9), key=lambda f: abs(np.log(f * (stamps[-1] - stamps[0]) / span)))
    slow = 20.0 if name == "power.time" else 1.0
    for first, factor in ((2e5, 1e-9), (400.0, 1e-6), (0.5, 1e-3)):
        if usual >= first * slow:
            return factor
    return 1.0


def wanted(rules: Mapping[str, Rule], table: Table) -> list[str]:
    """The columns of a table that rules name, to be read in one pass."""
    return [name for rule in rules.values() if rule.there(table) for name in rule.columns]


def read_joints(table: Table, rules: Mapping[str, Rule], robot: Robot, kind: str) -> Joints | None:
    """The joints' samples of a table; None where it has faults, which then stand in `table.faults`."""
    table.load(wanted(rules, table))
    time = quantity(table, "time", rules["time"])
    signals = {}
    for signal in JOINT_SIGNALS:
        values = _per_joint(table, robot, rules, signal)
        if values is not None:
            signals[signal] = values
    if table.faults:
        return None
    index = np.flatnonzero(np.isfinite(time) & np.isfinite(signals["position"]).all(axis=1))
    if len(index) < FEWEST:
        table.faults.append(f"{table.path}: {len(index)} data rows; a run needs at least {FEWEST}")
        return None
    back = backward(time[index])
    if back is not None:
        table.faults.append(
            f"{table.path}: row {table.row_number(int(index[back]))}, column {rules['time'].columns[0]}: time "
            f"{time[index[back]]:.10g} s does not come after {time[index[back - 1]]:.10g} s"
        )
        return None
    samples = clean(time[index], np.column_stack([values[index] for values in signals.values()]))
    dropped, index = np.delete(index, samples.kept), index[samples.kept]
    kept = {name: values[index] for name, values in signals.items() if np.isfinite(values[index]).all()}
    found = Joints(samples.time, kept, samples, index, dropped, table.is_date(rules["time"].columns[0]))
    fault = _step_fault(found, kind, robot) or degrees_fault(kept["position"], robot)
    if fault is not None:
        row = table.row_number(int(index[fault[0]]))
        joint = rules[f"{fault[1]}.position"].columns[0] if fault[1] else rules["time"].columns[0]
        table.faults.append(f"{table.path}: row {row}, column {joint}: {fault[2]}")
        return None
    return found


def _per_joint(table: Table, robot: Robot, rules: Mapping[str, Rule], signal: str) -> np.ndarray | None:
    """(N, n) of a signal; None where the file has none of its columns and need not have them."""
    names = [f"{joint}.{signal}" for joint in robot.joints]
    given = [name in rules and rules[name].there(table) for name in names]
    if signal != "position" and not any(given):
        return None
    for name in names:
        if name not in rules:
            raise BadInput(f"{table.path}: no column is named for {name}; say it in [columns]")
    return np.column_stack([quantity(table, name, rules[name]) for name in names])


def _step_fault(joints: Joints, kind: str, robot: Robot) -> tuple[int, str, str] | None:
    """Row, joint and words where stamps are too far apart or too near for what the joints do."""
    position = joints.signals["position"]
    step = float(np.median(np.diff(joints.time)))
    moves = float(np.ptp(position, axis=0).max()) > 0.01
    if step > COARSEST and (moves or kind == "motion"):
        return 0, "", f"{step:.4g} s between rows; is the time's unit right (ms, us, ns)?"
    if step < FINEST:
        return 0, "", f"{step:.3g} s between rows; is the time's unit right?"
    speed = np.percentile(np.abs(np.diff(position, axis=0)) / np.diff(joints.time)[:, None], 99, axis=0)
    j = int(np.argmax(speed / robot.limits.velocity))
    if speed[j] > TOO_FAST * robot.limits.velocity[j] and degrees_fault(position, robot) is None:
        unit = robot.unit("velocity", robot.joints[j])
        limit = f"{robot.joints[j]}'s limit of {robot.limits.velocity[j]:.3g}"
        return (
            0,
            "",
            f"speeds of {speed[j]:.3g} {unit}, far above {limit}; is the time's unit right?",
        )
    return None


def degrees_fault(position: np.ndarray, robot: Robot) -> tuple[int, str, str] | None:
    """Row, joint and remedy where positions (N, n) lie so far outside the limits that they must be degrees."""
    found = look_like_degrees(robot.limits, position, FAR, robot.slides)
    if found is None:
        return None
    row, j = found
    lower, upper = robot.limits.lower, robot.limits.upper
    joint = robot.joints[j]
    return (
        row,
        joint,
        f"{position[row, j]:.4g} rad is far outside {joint}'s limits [{lower[j]:.4g}, {upper[j]:.4g}]: these look "
        'like degrees; give the column\'s unit in log.toml ({ column = "...", unit = "deg" }), '
        "or `energy-opt import` the file, which converts",
    )
