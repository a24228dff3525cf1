"""Joint data of a recording: stamps and signals from a table, in SI units and in the robot's order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.measured.columns import Rule, factor_of
from energy_opt.measured.names import is_commanded
from energy_opt.measured.plausible import continued, degrees_fault, held_samples, into_limits, leaps, spikes, step_fault
from energy_opt.measured.run import JOINT_SIGNALS
from energy_opt.measured.table import Table
from energy_opt.numerics.stamps import Stamped, clean, stamp_factor
from energy_opt.robot import Robot

FEWEST = 8  # least samples of a run
# Largest plausible values of an arm's measurements: SI units, absolute values.
LARGEST = {
    "time": 1e11, "position": 1e4, "velocity": 1e4, "acceleration": 1e6, "effort": 1e6, "current": 1e5,
    "temperature": 1e3, "power": 1e7, "energy": 1e13,
}  # fmt: skip


def runs_backward(table: Table, column: str, time: np.ndarray, index: np.ndarray) -> bool:
    """True if a stamp in `time` (N,) [s] lies before its predecessor, which is added to the table's faults.

    Args:
        table: the file. column: of the stamps. time: of its samples `index` (N,).
    """
    back = np.flatnonzero(np.diff(time) < 0)
    if back.size:
        k = int(back[0]) + 1
        text = (
            f"time {time[k]:.14g} s does not come after {time[k - 1]:.14g} s; give one file for each start of the clock"
        )
        table.fault(text, column, int(index[k]))
    return bool(back.size)


@dataclass(frozen=True)
class Joints:
    """Samples of the joints; `index`, `dropped`: table indices of kept and repeated samples; `time`: [s] as stamped."""

    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    stamps: Stamped
    index: np.ndarray
    dropped: np.ndarray
    dated: bool


def quantity(table: Table, name: str, rule: Rule) -> np.ndarray:
    """A quantity in SI units (N,), nan for empty cells.

    Args:
        table: the file; implausible values are added to its faults. name: of the quantity. rule: its columns.
    """
    values = table.combined(rule.columns, rule.combined)
    factor = factor_of(name, rule, table)
    if name.endswith("time"):
        factor = 1.0 if table.is_date(rule.columns[0]) else stamp_factor(values, name) if np.isnan(factor) else factor
    values = values * factor
    kind = "time" if name.endswith("time") else name.rpartition(".")[2]
    wild = np.flatnonzero(np.abs(values) > LARGEST[kind])
    if wild.size:
        text = f"{values[wild[0]]:.4g} cannot be a {kind} (SI units); is the file damaged, or the unit another?"
        table.fault(text, " * ".join(rule.columns), int(wild[0]))
    return values


def read_joints(table: Table, rules: Mapping[str, Rule], robot: Robot, kind: str) -> Joints | None:
    """The joints' samples of a table; None if it has faults, which are then in `table.faults`.

    Args:
        table: the file. rules: the columns of each quantity. robot: the arm. kind: "motion" or "static".

    Raises:
        BadInput: no column is named for a joint's position.
    """
    _check_columns_differ(table, rules, robot)
    table.load(name for rule in rules.values() if rule.has_columns(table) for name in rule.columns)
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
        table.fault(f"{len(index)} data rows; a run needs at least {FEWEST}")
        return None
    stamps = rules["time"].columns[0]
    held = held_samples(signals["position"][index])
    index = index[~held]
    spike = spikes(time[index], signals["position"][index], robot)
    spiked, index = index[spike], index[~spike]
    if runs_backward(table, stamps, time[index], index):
        return None
    # samples are spread between stamps; two do not say how many belong to each
    if np.count_nonzero(np.diff(time[index])) < 2:
        known = f"{len(index)} rows have two different times or one"
        table.fault(f"{known}; expected a time for each row, with enough digits", stamps)
        return None
    filled = {name for name, values in signals.items() if np.isfinite(values[index]).all()}
    samples = clean(time[index], np.column_stack([signals[name][index] for name in signals if name in filled]))
    dropped, index = np.concatenate([spiked, np.delete(index, samples.kept)]), index[samples.kept]
    remarks = [*samples.remarks]
    headers = {joint: rules[f"{joint}.position"].columns[0] for joint in robot.joints}
    commanded = next((header for joint, header in headers.items() if is_commanded(header, joint)), None)
    if commanded is not None:
        remarks.append(f"positions are commanded ones, not measured, by the header {commanded!r}")
    if held.any():
        remarks.append("positions are held over several rows: taken where they change")
    if spiked.size:
        first = table.row_number(int(spiked[0]))
        remarks.append(f"{len(spiked)} rows dropped: positions jump away and back (first: row {first})")
    if "temperature" in signals:
        signals["temperature"] = _completed(time, signals["temperature"])
    kept = {name: values[index] for name, values in signals.items()}
    for name in [name for name, values in kept.items() if not np.isfinite(values).all()]:
        share = 100 * float(np.mean(~np.isfinite(kept.pop(name))))
        remarks.append(f"logged {name} is left out: {share:.0f} % of its cells are empty")
    kept["position"], said = _in_turn(samples, kept["position"], robot)
    remarks += said
    jumps = leaps(samples.time, kept["position"], robot)
    if jumps.size and kind == "motion":
        first = table.row_number(int(index[jumps[0] + 1]))
        remarks.append(
            f"cut at {len(jumps)} row(s) where a position jumps and stays (first: row {first}); is an angle wrapped?"
        )
        samples = replace(samples, gaps=tuple(sorted({*samples.gaps, *jumps.tolist()})))
    samples = replace(samples, remarks=tuple(remarks))
    converted = [j for j in robot.joints if factor_of(f"{j}.position", rules[f"{j}.position"], table) != 1]
    fault = step_fault(samples.time, kept["position"], kind, robot)
    fault = fault or degrees_fault(kept["position"], robot, converted)
    if fault is not None:
        table.fault(fault[2], rules[f"{fault[1]}.position"].columns[0] if fault[1] else stamps, int(index[fault[0]]))
        return None
    return Joints(samples.time, kept, samples, index, dropped, table.is_date(stamps))


def _in_turn(samples: Stamped, position: np.ndarray, robot: Robot) -> tuple[np.ndarray, list[str]]:
    """Positions (N, n) whose angles pass on where they wrap, and are inside their limits if a turn brings them there.

    Also remarks that say so.
    """
    passing, wrapped = continued(samples.time, position, robot)
    position, moved = into_limits(passing, robot, samples.gaps, position)
    remarks = []
    for which, said in (
        (wrapped.any(axis=0), "jumps by a turn from one row to the next: it is taken to pass on"),
        (
            moved,
            "is one turn outside its limits: it is moved by this turn (else check its zero, its sign, the robot)",
        ),
    ):
        if which.any():
            remarks.append(f"the angle of {', '.join(robot.joints[k] for k in np.flatnonzero(which))} {said}")
    return position, remarks


def _completed(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (N, n) at times (N,) with straight lines over empty cells: a temperature changes slowly."""
    out = values.copy()
    for k, one in enumerate(values.T):
        known = np.flatnonzero(np.isfinite(one) & np.isfinite(time))
        if known.size:
            known = known[np.argsort(time[known], kind="stable")]
            out[:, k] = np.interp(time, time[known], one[known])
    return out


def _check_columns_differ(table: Table, rules: Mapping[str, Rule], robot: Robot) -> None:
    """Add a fault where two joints have the same column of positions."""
    by: dict[tuple[str, ...], str] = {}
    for joint in robot.joints:
        rule = rules.get(f"{joint}.position")
        other = by.setdefault(rule.columns, joint) if rule is not None else joint
        if rule is not None and other != joint:
            place = f"column {rule.columns[0]} is read as the position of {other} and of {joint}"
            table.fault(f"{place}; expected a column for each joint")


def _per_joint(table: Table, robot: Robot, rules: Mapping[str, Rule], signal: str) -> np.ndarray | None:
    """Values (N, n) of a signal; None if the signal is optional and the file has none of its columns."""
    names = [f"{joint}.{signal}" for joint in robot.joints]
    given = [name in rules and rules[name].has_columns(table) for name in names]
    if signal != "position" and not any(given):
        return None
    for name in names:
        if name not in rules:
            raise BadInput(f"{table.path}: no column is named for {name}; say it in [columns]")
    return np.column_stack([quantity(table, name, rules[name]) for name in names])
