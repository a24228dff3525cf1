"""Readings of a meter out of a table: power or an energy counter, as means over windows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from energy_opt.measured.columns import Rule
from energy_opt.measured.joints import Joints, quantity, runs_backward
from energy_opt.measured.meter_names import of_battery
from energy_opt.measured.plausible import glitches, update_indices
from energy_opt.measured.table import Table
from energy_opt.numerics.stamps import spread

# Share of the changed readings with the stamp of the one before, above which a clock's steps are coarser than the
# readings; share of the steps with about the same number of readings; largest change of the power from one reading to
# the next, over that from one step to the next: with several channels in turn, it is larger
COARSE, ALIKE, CHANNELS = 0.3, 0.9, 1.5
TICKS = 0.3  # share of samples with an unchanged counter above which only its steps are readings


@dataclass(frozen=True)
class Readings:
    """Readings (M,) [W], stamps (M,) [s] as in the file, and lengths (M,) [s] of the intervals that they average.

    `dated`: stamps are dates or times of day. `loose`: [s] by which stamps may be early or late, as they are rounded.
    """

    time: np.ndarray
    power: np.ndarray
    window: np.ndarray
    kind: str
    dated: bool = False
    remarks: tuple[str, ...] = ()
    loose: float = 0.0


def read_meter(table: Table, rules: Mapping[str, Rule], joints: Joints | None, window: float | None) -> Readings | None:
    """Readings of a table; None if it has faults (then in `table.faults`) or no meter's column.

    Args:
        joints: samples read from the same table; None if the table is the meter's own.
        window: [s] of the meter's mean, None if not stated.
    """
    own = joints is None
    stamps = rules.get("power.time") if own else rules["time"]
    if stamps is None:
        stamps = rules["time"] if rules["time"].has_columns(table) else Rule(("time",))
    energy = "energy" in rules and (rules["energy"].has_columns(table) or not rules["power"].has_columns(table))
    name = "energy" if energy else "power"
    table.load([*stamps.columns, *rules[name].columns])
    time, values = quantity(table, "power.time" if own else "time", stamps), quantity(table, name, rules[name])
    if table.faults:
        return None
    if joints is not None:  # use the cleaned stamps of the joints
        time[joints.index] = joints.time
        time[joints.dropped] = np.nan
    there = np.flatnonzero(np.isfinite(time) & np.isfinite(values))
    if not there.size and len(time):
        names = [" * ".join(rule.columns) for rule in (stamps, rules[name])]
        table.fault(f"columns {names[0]} and {names[1]}: no row that is used has both")
        return None
    time, values = time[there], values[there]
    if own and runs_backward(table, stamps.columns[0], time, there):
        return None
    remarks = list(table.remarks) if own else []
    product = len(rules[name].columns) > 1 and rules[name].combined == "product"
    if product and len(values) and values.mean() < 0 and of_battery(table.header):
        values = -values
        remarks.append("voltage times current is below zero, as of a battery that is discharged: its sign is changed")
    if len(values) and values.max() <= 0 and not (energy and values.any()):
        what = "is never above 0; is its sign reversed?" if values.any() else "is 0 throughout; is the meter connected?"
        table.fault(what, " * ".join(rules[name].columns), int(there[0]))
        return None
    dated = table.is_date(stamps.columns[0])
    if energy:
        return _counter(time, values, dated)
    wild = glitches(values)
    if wild.any():
        first = table.row_number(int(there[np.argmax(wild)]))
        remarks.append(
            f"{int(wild.sum())} readings are left out: the power jumps and returns at once (first: row {first})"
        )
        time, values = time[~wild], values[~wild]
    new = update_indices(values)
    if new is not None:
        beat = float(np.median(np.diff(time[new])))
        remarks.append(f"a reading is repeated in several rows: it is used where it changes, every {beat:.3g} s")
        time, values = time[new], values[new]
    even = _spread(time, values) if own else None
    loose = 1.0 if own and dated and (time % 1 == 0).all() else 0.0  # whole seconds may be cut ones
    if even is not None:
        beat = float(np.median(np.diff(even)))
        remarks.append(f"readings in a row have the same time stamp: spread evenly, one every {beat:.3g} s")
        time, loose = even, beat / 2
    fresh = np.concatenate([[True], np.diff(time) > 0])
    if own and not fresh.all():
        remarks.append(f"{int((~fresh).sum())} readings are left out: they repeat the time stamp of the one before")
    time, values = time[fresh], values[fresh]
    return Readings(time, values, np.full(len(time), window or 0.0), "power", dated, tuple(remarks), loose)


def _spread(time: np.ndarray, power: np.ndarray) -> np.ndarray | None:
    """Stamps (M,) [s] of readings [W] whose clock counts in coarse steps, which have about the same number of readings
    each: on an even clock, else spread within each step. None for other readings, also for those of several channels.
    """
    same = np.append(False, np.diff(time) == 0)
    changed = np.append(False, np.diff(power) != 0)
    first = np.flatnonzero(~same)
    count = np.diff(first)[1:]  # the first and the last step may have fewer
    usual = int(np.median(count)) if len(count) else 0
    if not changed.any() or same[changed].mean() <= COARSE or usual < 1 or np.mean(np.abs(count - usual) <= 1) < ALIKE:
        return None
    if np.abs(np.diff(power)).mean() > CHANNELS * np.abs(power[usual:] - power[:-usual]).mean():
        return None
    step, number = float(np.median(np.diff(time[first]))), np.arange(len(time))
    even = np.polyval(np.polyfit(number, time - time[0], 1), number) + time[0] + step / 2
    if np.abs(even - time - step / 2).max() <= step:
        return np.asarray(even)
    return spread(time.copy(), same) + step / usual / 2


def _counter(time: np.ndarray, energy: np.ndarray, dated: bool) -> Readings:
    """Mean power between readings of a counter [J]; a coarse counter is read only where it steps."""
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
        remarks.append(f"the counter restarts {int(reset.sum())} times: no power is computed there")
    good = ~reset
    return Readings(time[1:][good], (step / span)[good], span[good], "energy", dated, tuple(remarks))
