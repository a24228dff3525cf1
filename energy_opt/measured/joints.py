"""Joint data of a recording: stamps and signals from a table, in SI units and in the robot's order.

The recorder's stamps are cleaned: repeated stamps, missing samples and gaps are found and counted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.measured.columns import Rule, factor_of
from energy_opt.measured.even_clock import on_even_clock
from energy_opt.measured.plausible import degrees_fault, held_samples, leaps, spikes, step_fault
from energy_opt.measured.run import JOINT_SIGNALS
from energy_opt.measured.table import Table
from energy_opt.robot import Robot

COARSE = 0.3  # share of samples with a repeated stamp above which stamps are coarser than the samples
GAP = 0.25  # [s] without a sample (or `GAP_STEPS` steps, if longer) from which the motion in between is unknown
GAP_STEPS = 10
BUNCHED = 5.0  # mean step over median step above which samples arrive in bunches
SKIPPED = 1.6  # usual steps between two samples from which one is missing


@dataclass(frozen=True)
class Stamped:
    """Indices of the kept samples (K,), their stamps (K,) [s], and the kept samples that a gap follows."""

    kept: np.ndarray
    time: np.ndarray
    gaps: tuple[int, ...]
    remarks: tuple[str, ...] = field(default=())


def runs_backward(table: Table, column: str, time: np.ndarray, index: np.ndarray) -> bool:
    """True if a stamp in `time` (N,) [s] lies before its predecessor, which is added to the table's faults.

    Args:
        table: the file. column: of the stamps. time: of its samples `index` (N,).
    """
    back = np.flatnonzero(np.diff(time) < 0)
    if back.size:
        k = int(back[0]) + 1
        table.faults.append(
            f"{table.path}: row {table.row_number(int(index[k]))}, column {column}: time {time[k]:.10g} s does not "
            f"come after {time[k - 1]:.10g} s"
        )
    return bool(back.size)


def clean(time: np.ndarray, values: np.ndarray) -> Stamped:
    """Samples with increasing stamps out of samples with stamps that do not decrease.

    A sample that repeats the one before it, stamp and values, is dropped. Samples that share a stamp but differ are
    spread evenly where stamps are coarser than the samples, moved into the place of a missing sample after them if
    there is one, and dropped otherwise.

    Args:
        time: (N,) s, not decreasing. values: (N, m) of all that is logged.
    """
    remarks = []
    same = np.concatenate([[False], np.diff(time) == 0])
    copies = same & np.concatenate([[False], (np.diff(values, axis=0) == 0).all(axis=1)])
    coarse = float((same & ~copies).mean()) > COARSE
    kept = np.flatnonzero(~copies)
    if copies.any() and not coarse:
        remarks.append(f"{int(copies.sum())} repeated rows dropped")
    elif copies.any():  # with coarse stamps, equal samples of an arm at rest are real
        kept = np.arange(len(time))
    stamps = time[kept].astype(float)
    same = np.concatenate([[False], np.diff(stamps) == 0])
    if same.any():
        if coarse:
            stamps = _spread(stamps, same)
            remarks.append(f"stamps stand still in {int(same.sum())} of {len(stamps)} rows: rows spread evenly, kept")
        else:
            kept, stamps, moved = _moved_to_gaps(kept, stamps, same)
            if moved:
                remarks.append(f"{moved} rows with a repeated stamp moved to the missing stamp after them")
            if int(same.sum()) - moved:
                remarks.append(f"{int(same.sum()) - moved} rows with a repeated stamp dropped")
    spread = _spread_bunches(stamps)
    if spread is not None:
        stamps = spread
        row = 1e3 * float(np.median(np.diff(stamps)))
        remarks.append(f"stamps come in bunches: rows spread evenly, {row:.3g} ms apart, as on the controller's clock")
    even = on_even_clock(time, values, kept, stamps)
    if even is not None:  # all samples are real
        off = 1e3 * float(np.abs(time - even).max())
        kept, stamps = np.arange(len(time)), even
        remarks = [
            f"stamps are up to {off:.2g} ms late or early: rows put on an even clock, as they run smoothly on it"
        ]
    if len(stamps) < 3:
        return Stamped(kept, stamps, (), tuple(remarks))
    step = np.diff(stamps)
    usual = float(np.median(step))
    limit = max(GAP, GAP_STEPS * usual)
    wide = step > limit
    missing = np.rint(step / usual).astype(int) - 1
    skipped = (step > SKIPPED * usual) & ~wide
    if skipped.any() and skipped.mean() < 0.1:
        remarks.append(f"{int(missing[skipped].sum())} rows missing in {int(skipped.sum())} places: bridged")
    if wide.any():
        begins = stamps[:-1][wide] - stamps[0]
        lengths = ", ".join(f"{x:.3g} s after {t:.4g} s" for x, t in zip(step[wide][:3], begins, strict=False))
        more = f" and {int(wide.sum()) - 3} more" if wide.sum() > 3 else ""
        remarks.append(f"cut at {int(wide.sum())} gap(s) without rows ({lengths}{more})")
    return Stamped(kept, stamps, tuple(int(k) for k in np.flatnonzero(wide)), tuple(remarks))


def _spread_bunches(stamps: np.ndarray) -> np.ndarray | None:
    """Stamps of samples in bunches, spread evenly up to the last of each bunch; None if there are no bunches."""
    step = np.diff(stamps)
    near = step[step < GAP]
    if len(near) < 3 or BUNCHED * float(np.median(near)) >= float(near.mean()):
        return None
    last = np.append(np.flatnonzero(step > near.mean()), len(stamps) - 1)
    size = np.diff(last, prepend=-1)
    apart = np.diff(stamps[last], prepend=np.nan) / size
    row = float(np.nanmedian(apart))
    apart = np.where(apart < 2 * row, apart, row)  # also for the first bunch, whose start is unknown
    bunch = np.repeat(np.arange(len(last)), size)
    return np.asarray(stamps[last][bunch] - apart[bunch] * (last[bunch] - np.arange(len(stamps))))


def _spread(stamps: np.ndarray, same: np.ndarray) -> np.ndarray:
    """Spread samples of one stamp evenly up to the next stamp; those of the last stamp with the usual distance."""
    group = np.cumsum(~same) - 1
    first = np.flatnonzero(~same)
    size = np.diff(np.append(first, len(stamps)))
    length = np.diff(stamps[first])
    usual = float(np.median(length)) if len(length) else 1.0
    length = np.append(np.minimum(length, 2 * usual), usual)
    apart = length / size
    if len(apart) > 2:  # the first and the last stamp may have only some of their samples
        row = float(np.median(apart[1:-1]))
        apart[0], apart[-1] = min(apart[0], row), min(apart[-1], row)
    begin = stamps[first]
    if len(begin) > 1:
        begin[0] = begin[1] - size[0] * apart[0]
    return begin[group] + (np.arange(len(stamps)) - first[group]) * apart[group]


def _moved_to_gaps(kept: np.ndarray, stamps: np.ndarray, same: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Move samples with a repeated stamp by the usual step if a sample is missing after them; drop the others."""
    step = np.diff(stamps)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    room = np.append(step, 0.0) > SKIPPED * usual
    move = same & room & ~np.append(same[1:], False)
    stamps = np.where(move, stamps + usual, stamps)
    stay = ~same | move
    return kept[stay], stamps[stay], int(move.sum())


FEWEST = 8  # least samples of a run
# Largest plausible values of an arm's measurements: SI units, absolute values.
LARGEST = {
    "time": 1e11, "position": 1e4, "velocity": 1e4, "acceleration": 1e6, "effort": 1e6, "current": 1e5,
    "temperature": 1e3, "power": 1e7, "energy": 1e13,
}  # fmt: skip
EPOCH = 1e8  # [s] larger stamps count from 1970, on the same clock in every file


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
    """Seconds per unit of stamps without a named unit: by their size if they count from 1970, else by their step.

    Recorders of arms write 5 to 2000 samples/s, so a step of 0.5 or more is not in seconds; meters write 0.1 to 100.

    Args:
        stamps: (N,) as written; not finite ones are ignored. name: "power.time" for a meter's.
        span: [s] the approximate duration, if known: it decides instead of the step.
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


def named_columns(rules: Mapping[str, Rule], table: Table) -> list[str]:
    """The columns of a table that rules name, to be read in one pass."""
    return [name for rule in rules.values() if rule.has_columns(table) for name in rule.columns]


def read_joints(table: Table, rules: Mapping[str, Rule], robot: Robot, kind: str) -> Joints | None:
    """The joints' samples of a table; None if it has faults, which are then in `table.faults`.

    Args:
        table: the file. rules: the columns of each quantity. robot: the arm. kind: "motion" or "static".

    Raises:
        BadInput: no column is named for a joint's position.
    """
    _check_columns_differ(table, rules, robot)
    table.load(named_columns(rules, table))
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
    held = held_samples(signals["position"][index])
    index = index[~held]
    spike = spikes(time[index], signals["position"][index], robot)
    spiked, index = index[spike], index[~spike]
    if runs_backward(table, rules["time"].columns[0], time[index], index):
        return None
    samples = clean(time[index], np.column_stack([values[index] for values in signals.values()]))
    dropped, index = np.concatenate([spiked, np.delete(index, samples.kept)]), index[samples.kept]
    if held.any():
        said = "positions are held over several rows: taken where they change"
        samples = replace(samples, remarks=(*samples.remarks, said))
    if spiked.size:
        said = f"{len(spiked)} rows dropped: positions jump away and back (first: row "
        samples = replace(samples, remarks=(*samples.remarks, f"{said}{table.row_number(int(spiked[0]))})"))
    kept = {name: values[index] for name, values in signals.items() if np.isfinite(values[index]).all()}
    jumps = leaps(samples.time, kept["position"], robot)
    if jumps.size and kind == "motion":
        said = f"cut at {len(jumps)} row(s) where a position jumps and stays (first: row "
        said += f"{table.row_number(int(index[jumps[0] + 1]))}); is an angle wrapped?"
        gaps = tuple(sorted({*samples.gaps, *jumps.tolist()}))
        samples = replace(samples, gaps=gaps, remarks=(*samples.remarks, said))
    found = Joints(samples.time, kept, samples, index, dropped, table.is_date(rules["time"].columns[0]))
    fault = step_fault(samples.time, kept["position"], kind, robot) or degrees_fault(kept["position"], robot)
    if fault is not None:
        row = table.row_number(int(index[fault[0]]))
        joint = rules[f"{fault[1]}.position"].columns[0] if fault[1] else rules["time"].columns[0]
        table.faults.append(f"{table.path}: row {row}, column {joint}: {fault[2]}")
        return None
    return found


def _check_columns_differ(table: Table, rules: Mapping[str, Rule], robot: Robot) -> None:
    """Add a fault where two joints have the same column of positions."""
    by: dict[tuple[str, ...], str] = {}
    for joint in robot.joints:
        rule = rules.get(f"{joint}.position")
        other = by.setdefault(rule.columns, joint) if rule is not None else joint
        if rule is not None and other != joint:
            table.faults.append(
                f"{table.path}: column {rule.columns[0]} is read as the position of {other} and of {joint}; expected "
                "a column for each joint"
            )


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
