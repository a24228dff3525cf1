"""The meter's side of a recording: power, a counter of energy or a run's total, as means over windows.

What a recording holds beside the joints and the meter: digital signals, and numbers that the log offers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.measured.columns import LOGGED, Rule
from energy_opt.measured.joints import Joints, backward, held, quantity
from energy_opt.measured.table import Table

TICKS = 0.3  # share of samples in which a counter stays the same, from which only its steps are readings


@dataclass(frozen=True)
class Readings:
    """Readings (M,) [W], their stamps (M,) as the file counts them [s], how far back each mean reaches (M,) [s]."""

    time: np.ndarray
    power: np.ndarray
    window: np.ndarray
    kind: str
    dated: bool = False
    remarks: tuple[str, ...] = ()

    def some(self, which: np.ndarray) -> Readings:
        """Some of the readings."""
        return replace(self, time=self.time[which], power=self.power[which], window=self.window[which])


def read_meter(table: Table, rules: Mapping[str, Rule], joints: Joints | None, window: float | None) -> Readings | None:
    """Readings of a table; None where it has faults (they stand in `table.faults`) or no meter's column.

    Args:
        joints: what was read of the same table; None where the table is the meter's own.
        window: of the meter's mean, where the log states one, s.
    """
    own = joints is None
    stamps = time_rule(table, rules) if own else rules["time"]
    energy = "energy" in rules and (rules["energy"].there(table) or not rules["power"].there(table))
    name = "energy" if energy else "power"
    table.load([*stamps.columns, *rules[name].columns])
    time, values = quantity(table, "power.time" if own else "time", stamps), quantity(table, name, rules[name])
    if table.faults:
        return None
    if joints is not None:  # samples go as those of the joints do
        time[joints.index] = joints.time
        time[joints.dropped] = np.nan
    there = np.flatnonzero(np.isfinite(time) & np.isfinite(values))
    if not there.size and len(time):
        names = [" * ".join(rule.columns) for rule in (stamps, rules[name])]
        table.faults.append(f"{table.path}: columns {names[0]} and {names[1]}: no row that is used has both")
        return None
    back = backward(time[there]) if own else None
    if back is not None:
        table.faults.append(
            f"{table.path}: row {table.row_number(int(there[back]))}, column {stamps.columns[0]}: time "
            f"{time[there[back]]:.10g} s does not come after {time[there[back - 1]]:.10g} s"
        )
        return None
    time, values = time[there], values[there]
    if len(values) and not values.any():
        table.faults.append(
            f"{table.path}: row {table.row_number(int(there[0]))}, column {' * '.join(rules[name].columns)}: "
            f"is 0 throughout; is the meter connected?"
        )
        return None
    dated = table.is_date(stamps.columns[0])
    if energy:
        return _counter(time, values, dated)
    remarks = []
    new = held(values)
    if new is not None:
        beat = float(np.median(np.diff(time[new])))
        remarks.append(f"a reading is held over several rows: taken where it changes, every {beat:.3g} s")
        time, values = time[new], values[new]
    fresh = np.concatenate([[True], np.diff(time) > 0])
    if own and not fresh.all():
        remarks.append(f"{int((~fresh).sum())} readings with the stamp of the one before dropped")
    time, values = time[fresh], values[fresh]
    return Readings(time, values, np.full(len(time), window or 0.0), "power", dated, tuple(remarks))


def time_rule(table: Table, rules: Mapping[str, Rule]) -> Rule:
    """Where the meter's own file has its stamps."""
    if "power.time" in rules:
        return rules["power.time"]
    return rules["time"] if rules["time"].there(table) else Rule(("time",))


def _counter(time: np.ndarray, energy: np.ndarray, dated: bool) -> Readings:
    """Mean power between readings of a counter [J]; a counter that ticks coarsely is read where it ticks."""
    remarks = []
    fresh = np.concatenate([[True], np.diff(time) > 0])
    time, energy = time[fresh], energy[fresh]
    still = np.diff(energy) == 0
    if len(still) and still.mean() > TICKS:
        at = np.concatenate([[False], ~still])
        time, energy = time[at], energy[at]
        remarks.append(f"the counter stays the same in {100 * still.mean():.0f} % of rows: read where it steps")
    span, step = np.diff(time), np.diff(energy)
    reset = step < -0.5 * np.maximum(np.abs(energy[:-1]), 1e-9)
    if reset.any():
        remarks.append(f"the counter begins anew {int(reset.sum())} times: left out there")
    good = ~reset
    return Readings(time[1:][good], (step / span)[good], span[good], "energy", dated, tuple(remarks))


def total(time: np.ndarray, energy: float) -> Readings:
    """One reading over a whole run, from its total energy [J]."""
    span = float(time[-1] - time[0])
    return Readings(time[-1:], np.array([energy / span]), np.array([span]), "total")


DIGIT = re.compile(r"[01]([.,]0*)?")


def further_signals(table: Table, rules: Mapping[str, Rule], samples: np.ndarray) -> dict[str, np.ndarray]:
    """By name the values (N,) of further signals at some samples of a table.

    These are columns that rules or headers call `signal.<name>`, and other columns that hold nothing but 0 and 1. An
    empty cell has the value before it, as recorders write what changes.
    """
    named = {_name(key): rule.columns[0] for key, rule in rules.items() if key.partition(".")[0] == LOGGED}
    named |= {_name(header): header for header in table.header if header.partition(".")[0] == LOGGED}
    used = {*named.values(), *(column for rule in rules.values() for column in rule.columns)}
    digital = [name for k, name in enumerate(table.header) if name and name not in used and _binary(table, k)]
    table.load(named.values(), sparse=True)
    out = {name: _filled(table.column(column))[samples] for name, column in named.items()}
    faults = list(table.faults)
    table.load(digital, sparse=True)
    table.faults[:] = faults  # a column that nobody asked for may be damaged
    for header in digital:
        values = _filled(table.column(header))[samples]
        if header not in out and set(np.unique(values)) <= {0.0, 1.0}:
            out[header] = values
    return {name: values for name, values in out.items() if np.isfinite(values).all()}


def _name(key: str) -> str:
    """signal.gripper is called gripper, and signal signal."""
    return key.partition(".")[2] or LOGGED


def _binary(table: Table, k: int) -> bool:
    cells = [row[k].strip() for row in table.layout.sample if k < len(row) and row[k].strip()]
    return bool(cells) and all(DIGIT.fullmatch(cell) for cell in cells)


def _filled(values: np.ndarray) -> np.ndarray:
    """Cells without a number take the value before them; the first ones that after them."""
    there = np.flatnonzero(np.isfinite(values))
    if not there.size:
        return values
    last = np.searchsorted(there, np.arange(len(values)), side="right") - 1
    return np.asarray(values[there[np.maximum(last, 0)]])
