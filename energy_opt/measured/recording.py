"""Convert one [[run]] of a log to runs: read joints and meter, put them on one clock, and cut at gaps.

A recording may have further signals: digital ones, and numbers that the log names.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from energy_opt.measured.clock import activity, delays_of, shows_means
from energy_opt.measured.columns import AUTO, LOGGED, PRESETS, Rule, plain_rules
from energy_opt.measured.joints import FEWEST, Joints, read_joints
from energy_opt.measured.log import LogFile, RunEntry
from energy_opt.measured.meter_clocks import Found
from energy_opt.measured.meter_fits import Meter
from energy_opt.measured.meter_names import energy_column, power_column
from energy_opt.measured.names import time_columns
from energy_opt.measured.readings import Readings, read_meter
from energy_opt.measured.run import JOINT_SIGNALS, Run, cut_at_standstill, pieces
from energy_opt.measured.table import Table
from energy_opt.numerics.stamps import EPOCH
from energy_opt.robot import Robot

DIGIT = re.compile(r"[01]([.,]0*)?")


def further_signals(table: Table, rules: Mapping[str, Rule], samples: np.ndarray) -> dict[str, np.ndarray]:
    """By name the values (N,) of further signals at some samples of a table.

    These are columns that rules or headers call `signal.<name>`, and other columns that hold nothing but 0 and 1. An
    empty cell takes the value before it, as recorders write only changes.
    """
    named = {_name(key): rule.columns[0] for key, rule in rules.items() if key.partition(".")[0] == LOGGED}
    named |= {_name(header): header for header in table.header if header.partition(".")[0] == LOGGED}
    used = {*named.values(), *(column for rule in rules.values() for column in rule.columns)}
    digital = []
    for k, name in enumerate(table.header):
        cells = [row[k].strip() for row in table.layout.sample if k < len(row) and row[k].strip()]
        if name and name not in used and cells and all(DIGIT.fullmatch(cell) for cell in cells):
            digital.append(name)
    table.load(named.values(), sparse=True)
    out = {name: _with_gaps_filled(table.column(column))[samples] for name, column in named.items()}
    faults = list(table.faults)
    table.load(digital, sparse=True)
    table.faults[:] = faults  # ignore faults in columns that the log does not name
    for header in digital:
        values = _with_gaps_filled(table.column(header))[samples]
        if header not in out and set(np.unique(values)) <= {0.0, 1.0}:
            out[header] = values
    return {name: values for name, values in out.items() if np.isfinite(values).all()}


def _name(key: str) -> str:
    """The name of a signal: `gripper` for the key signal.gripper."""
    return key.partition(".")[2] or LOGGED


def _with_gaps_filled(values: np.ndarray) -> np.ndarray:
    """Cells without a number take the value before them; the first ones that after them."""
    there = np.flatnonzero(np.isfinite(values))
    if not there.size:
        return values
    last = np.searchsorted(there, np.arange(len(values)), side="right") - 1
    return np.asarray(values[there[np.maximum(last, 0)]])


HOUR, FARTHEST_ZONE = 3600.0, 14  # [s]; [h] largest distance of a time zone from another
UPTIME = 3600.0  # [s] clocks that begin at a larger stamp do not count from the start of the recording
MOVES_ENOUGH = 0.05  # [rad] least motion of some joint to align the meter's clock
SLOW = 0.09  # [s] a meter slower than this may show means over its own interval


@dataclass
class Recording:
    """Result of reading a [[run]]: its runs, faults, and remarks on the reading.

    `interval`: [s] between readings of a slow meter that may show means; `scores`: log likelihoods of both cases, see
    `clock.shows_means`. `meter`: readings of a meter whose clock may be another one than that of the joints.
    """

    runs: list[Run] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    interval: float = 0.0
    scores: np.ndarray | None = None
    meter: Meter | None = None


def read_recording(log: LogFile, entry: RunEntry, robot: Robot, clock: float, found: Found | None = None) -> Recording:
    """Read one [[run]] of a log.

    Args:
        clock: the set time [s] of its time 0 if the log states none. found: what is known of its meter's clock.
    """
    out = Recording()
    table = Table(log.file(entry.file), log.csv)
    rules = PRESETS[log.preset](robot, table) if log.preset else plain_rules(robot.joints)
    rules = {**rules, **log.rules}
    joints = read_joints(table, rules, robot, entry.kind)
    if joints is None:
        out.faults = list(dict.fromkeys(table.faults))
        return out
    out.remarks += [f"{entry.file}: {word}" for word in (*table.remarks, *joints.stamps.remarks)]
    readings = _readings(log, entry, table, rules, joints, out)
    if readings is None:
        return out
    out.remarks += [f"{entry.power_file or entry.file}: {word}" for word in readings.remarks]
    zero = float(joints.time[0]) if joints.dated or abs(joints.time[0]) >= UPTIME else 0.0
    time = joints.time - zero
    moved, status = _one_clock(log, entry, robot, joints, readings, zero, out, found)
    if moved is None:
        return out
    start = clock if entry.start is None else entry.start
    signals: dict[str, Any] = {name: joints.signals.get(name) for name in JOINT_SIGNALS}
    run = Run(
        entry.file, entry.kind, start, time, power_time=moved.time, power=moved.power, window=moved.window,
        meter=moved.kind, clock=status, lines=joints.index + table.layout.first_row,
        logged=further_signals(table, rules, joints.index), **signals,
    )  # fmt: skip
    if table.faults:
        out.faults += list(dict.fromkeys(table.faults))
        return out
    _cut(log, run, joints.stamps.gaps, out)
    return out


def _readings(
    log: LogFile, entry: RunEntry, table: Table, rules: Mapping[str, Rule], joints: Joints, out: Recording
) -> Readings | None:
    """The meter's readings with its file's stamps; None after faults."""
    if entry.energy is not None:  # one reading over the whole run
        span = float(joints.time[-1] - joints.time[0])
        return Readings(joints.time[-1:], np.array([entry.energy / span]), np.array([span]), "total")
    own = entry.power_file is not None
    source = table
    if entry.power_file is not None:
        source = Table(log.file(entry.power_file), log.csv)
        if log.preset:
            rules = {**rules_of_meter(source), **log.rules}
    named = [rules[name] for name in ("energy", "power") if name in rules]
    if not own and not any(rule.has_columns(source) for rule in named) and {"current", "effort"} & set(joints.signals):
        out.remarks.append(f"{entry.file}: no meter; currents or torques only")
        none = np.zeros(0)
        return Readings(none, none, none, "power", joints.dated)
    if not named:
        rules = {**rules, "power": Rule(("power",))}
    readings = read_meter(source, rules, None if own else joints, log.window)
    if readings is None:
        out.faults += list(dict.fromkeys(source.faults))
    return readings


def rules_of_meter(table: Table) -> dict[str, Rule]:
    """Rules for a meter's own file besides that of a recorder with a preset: from its headers."""
    rules = {}
    stamps, power, energy = time_columns(table.header), power_column(table.header), energy_column(table.header)
    if stamps:
        rules["power.time"] = Rule((stamps[0],), AUTO)
    if power is not None or energy is None:
        rules["power"] = Rule((power or "power",))
    else:
        rules["energy"] = Rule((energy,))
    return rules


def _one_clock(
    log: LogFile, entry: RunEntry, robot: Robot, joints: Joints, readings: Readings, zero: float, out: Recording,
    found: Found | None,
) -> tuple[Readings | None, str]:  # fmt: skip
    """The readings on the run's clock, and the origin of that clock: "shared", "stated" or "estimated".

    `zero` [s]: stamp of the joints' file at the run's time 0; `found`: what is known of the meter's clock.
    """
    time, stamps, status = joints.time - zero, readings.time - zero, "shared"
    # stamp of the meter's file that counts as its time 0; both files count from 1970; the clocks are of different kinds
    first, dated, together = 0.0, False, False
    if entry.power_file is not None and len(stamps):
        dated = abs(readings.time[0]) > EPOCH and abs(joints.time[0]) > EPOCH
        first = float(readings.time[0]) if readings.dated or abs(readings.time[0]) >= UPTIME else 0.0
        if entry.power_start is not None:
            stamps, status = readings.time - first + entry.power_start, "stated"
        elif (zone := _zone(joints, readings)) is not None:
            stamps, hours = stamps + zone, (zone / HOUR + 12) % 24 - 12
            said = f"moved by {hours:+g} h, as of another time zone" if hours else "taken for the same day"
            out.remarks.append(f"{entry.power_file}: its times are {said}, to overlap with those of {entry.file}")
        elif not dated and _overlap(stamps, time) < 0.5:
            stamps, together = readings.time - first, first != 0
    seek = entry.power_file is not None and entry.power_start is None and len(stamps) > 1
    interval = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    slow = interval > max(SLOW, 2.5 * float(np.median(np.diff(time)))) and log.window is None
    infer = slow and readings.kind == "power"
    windows = [readings.window, np.full(len(stamps), interval)] if infer else [readings.window]
    overlap = _overlap(stamps, time) if len(stamps) > 1 else 1.0
    which, scores = 0, None
    spans = _spans(len(time), joints.stamps.gaps)
    if (seek or infer) and spans and float(np.ptp(joints.signals["position"], axis=0).max()) > MOVES_ENOUGH:
        motion = activity(robot, time, joints.signals["position"], spans)
        if seek:
            given = overlap >= 0.5 and not together
            out.meter = Meter(motion, stamps, readings.power, tuple(windows), given, dated, readings.loose)
        else:
            scores = delays_of(motion, stamps, windows, readings.power)
            which = int(shows_means(scores, interval)[0])
    if found is not None:
        which, scores = found.window, found.scores
    if seek and overlap < 0.5 and (found is None or found.clock is None):
        if found is None and out.meter is not None:  # a clock may still be found
            return replace(readings, time=stamps[:0], power=readings.power[:0], window=readings.window[:0]), status
        out.faults.append(
            f"{log.file(entry.power_file or '')}: its clock runs from {stamps[0]:g} to {stamps[-1]:g} s, the "
            f"motion's from {time[0]:g} to {time[-1]:g} s: they hardly overlap; both count from the run's time 0, "
            "unless power_start says where the meter's begins"
        )
        return None, status
    if found is not None:
        remark = found.remark(entry.file, stamps, readings.time - first, together)
        out.remarks += [f"{entry.power_file}: {remark}"] if remark else []
        if found.lost:
            readings = replace(readings, time=stamps[:0], power=stamps[:0], window=stamps[:0])
            return readings, status
        if found.clock is not None:
            stamps, status = found.clock.moved(stamps), "estimated"
    window = windows[min(which, len(windows) - 1)]
    if infer:
        out.interval, out.scores = interval, scores
    slack = 0.1 * window + 1e-9
    keep = (stamps - window >= time[0] - slack) & (stamps <= time[-1] + 1e-9)
    if readings.kind == "total":
        keep[:] = True
    span = float(time[-1] - time[0])
    if len(window) and not keep.any() and float(window.min()) > span:
        out.faults.append(
            f"{log.path}: [meter] window = {window.min():g} s, but {entry.file} lasts {span:.3g} s; is the window in s?"
        )
        return None, status
    return replace(readings, time=stamps[keep], power=readings.power[keep], window=window[keep]), status


def _zone(joints: Joints, readings: Readings) -> float | None:
    """Time [s] by which a meter's dates or times of day are moved to overlap with those of the joints: hours of another
    time zone, else quarters of hours, and days if one of both states no day. None if it is not clear, or 0.
    """
    dates = [abs(time[0]) > EPOCH for time in (joints.time, readings.time)]
    if not (dates[0] or joints.dated) or not (dates[1] or readings.dated):
        return None
    for unit in (HOUR, HOUR / 4):
        first, last = (joints.time[0] - readings.time[-1]) / unit, (joints.time[-1] - readings.time[0]) / unit
        moves = [float(x) * unit for x in np.arange(np.ceil(first), last)]
        moves = [x for x in moves if _overlap(readings.time + x, joints.time) >= 0.5]
        if moves:
            far = dates[0] == dates[1] and abs(moves[0]) > FARTHEST_ZONE * HOUR
            return None if far or len(moves) > 1 or not moves[0] else moves[0]
    return None


def _overlap(stamps: np.ndarray, time: np.ndarray) -> float:
    """Share of the motion that the stamps of a meter cover, or share of these within the motion if they span less."""
    shared = min(time[-1], stamps[-1]) - max(time[0], stamps[0])
    return float(shared / max(min(np.ptp(time), np.ptp(stamps)), 1e-9))


def _spans(count: int, gaps: Sequence[int]) -> list[tuple[int, int]]:
    """First and last of the `count` samples of each piece between gaps, which follow the samples `gaps`."""
    return [(a + 1, b) for a, b in pairwise([-1, *gaps, count - 1]) if b - a >= FEWEST]


def _cut(log: LogFile, run: Run, gaps: tuple[int, ...], out: Recording) -> None:
    """Cut a run after the samples `gaps` and, if the log says so, at standstill; runs and remarks go to `out`."""
    parts = [run]
    if gaps and run.meter != "total":
        parts = pieces(
            run, _spans(len(run.time), gaps), strict=True
        )  # readings whose window reaches into a gap are left out
        short = len(gaps) + 1 - len(parts)
        if short:
            out.remarks.append(f"{run.file}: {short} piece(s) between gaps with fewer than {FEWEST} rows left out")
    if log.standstill and run.meter != "total":
        parts = [piece for part in parts for piece in cut_at_standstill(part)]
    if len(parts) == 1 and not log.standstill:
        out.runs = [replace(parts[0], file=run.file)]
    else:
        out.runs = [replace(part, file=f"{run.file}#{k}") for k, part in enumerate(parts, start=1)]
