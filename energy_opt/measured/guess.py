"""Guesses about a file without a log: robot, meaning and unit of each column. Each guess has an explanation."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import log, prod
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.measured.columns import ARM_POWER, ByHand, given_names, kind_of, named_unit, understood
from energy_opt.measured.header import UNITS, cut
from energy_opt.measured.joint_units import MOST_AMPERES, TOO_FAST, joint_units, units_in_words, without_foreign
from energy_opt.measured.meter_names import energy_column, power_by_file, whole_power
from energy_opt.measured.names import joint_columns, names_joint, time_columns
from energy_opt.measured.plausible import are_degrees
from energy_opt.measured.table import Table
from energy_opt.numerics.stamps import EPOCH, stamp_factor
from energy_opt.power.known import by_name
from energy_opt.robot import Robot, known_robots
from energy_opt.robot.limits import postures

LOOKED_AT = 20_000  # lines used for guesses
FITS = 0.5  # share of the logged torques' size by which those of the file's robot may differ
STANDBY = 100.0  # [W] by which an arm with its controller may draw more than its motors give
SPARE = 2.0  # usual ratio of a motor's largest torque to what holding the arm takes
STILL = 0.2  # [rad or deg] range of a joint that does not move
APART = 0.01  # ratio of sizes that is usual between files in different units only
TIME_UNITS = {1e-3: "ms", 1e-6: "us", 1e-9: "ns"}


@dataclass
class Guess:
    """Entries for [columns] (or a preset), and sentences that explain them."""

    columns: dict[str, Any] = field(default_factory=dict)
    preset: str | None = None
    words: list[str] = field(default_factory=list)
    sure: dict[str, bool] = field(default_factory=dict)  # by column of an angle: is its unit shown, or not clear?
    dated: bool = False
    first: float = 0.0  # [s] stamp of the first and last row, as the file counts
    last: float = 0.0


def is_motion(table: Table) -> bool:
    """True if a file has joint positions of any known robot."""
    given, robots = given_names(table), map(by_name, known_robots())
    return any("position" in joint_columns(table.header, robot, given) for robot in robots)


def guess_robot(table: Table) -> tuple[Robot, str]:
    """The robot of a file of joints, and the reason for the choice.

    Raises:
        BadInput: several are equally likely; the message names them.
    """
    sure, fitting = [], []
    for name in known_robots():
        position = joint_columns(table.header, by_name(name), given_names(table)).get("position", {})
        fitting += [name] if position else []
        sure += [name] if position and all(names_joint(header, j, name) for j, header in position.items()) else []
    fitting = sure or fitting
    most = max((len(by_name(name).joints) for name in fitting), default=0)
    fitting = [name for name in fitting if len(by_name(name).joints) == most]
    words = {word.lower() for word in table.header}
    if any("tau_j" in word or word.startswith("state.q") or "o_t_ee" in word for word in words):
        sure = [name for name in fitting if name == "panda"]
        fitting = sure or fitting
    if any(word.startswith("actual_q") for word in words):
        fitting = [name for name in fitting if name.startswith("ur")] or fitting
    if sure and len(fitting) == 1:
        return by_name(fitting[0]), "by its joints' columns"
    if not fitting:
        raise BadInput(f"{table.path}: no known robot has such columns; name it with --robot")
    errors = {name: _torque_error(table, name) for name in fitting}
    known = {name: error for name, error in errors.items() if error is not None}
    if len(known) == len(fitting) > 1:
        best, second = sorted(known, key=lambda name: known[name])[:2]
        if known[best] < min(FITS, 0.8 * known[second]):
            why = f"its torques fit the file's best ({known[best]:.2g} of their spread, {second}'s next)"
            return by_name(best), why
    raise BadInput(f"{table.path}: the columns fit {', '.join(fitting)}; say which with --robot")


def _torque_error(table: Table, name: str) -> float | None:
    """Rms difference of a robot's static torques from the file's (measured or commanded), over the rms of these."""
    robot = by_name(name)
    plain = {word.replace("target_", "", 1): word for word in table.header if not word.startswith("actual_")}
    effort = joint_columns(list(plain), robot).get("effort")
    position = joint_columns(table.header, robot, given_names(table)).get("position")
    if effort is None or position is None:
        return None
    table.load([*position.values(), *(plain[word] for word in effort.values())])
    q = np.column_stack([table.column(position[joint]) for joint in robot.joints])
    tau = np.column_stack([table.column(plain[effort[joint]]) for joint in robot.joints])
    samples = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(tau).all(axis=1))
    samples = samples[:: max(1, len(samples) // 500)]
    if are_degrees(q[samples], robot):
        q = np.radians(q)
    rest = np.zeros((len(samples), robot.n))
    off = robot.body.torque(q[samples], rest, rest) - tau[samples]
    spread = float(np.sqrt(np.mean(tau[samples] ** 2)))
    return float(np.sqrt(np.mean(off**2))) / spread if spread > 0.5 else None


def guess_joints(table: Table, robot: Robot, hand: ByHand) -> Guess:
    """Columns and units of a file of joints, its own meter included.

    Args:
        table: the file. robot: whose joints these are. hand: columns that the user named, which have priority.

    Raises:
        BadInput: it has no time, or no position for some joint; or either the unit of time or that of the positions is
            another than the guessed one.
    """
    out = Guess()
    header = table.header
    found = joint_columns(header, robot, given_names(table))
    found["position"] = hand.positions(table, found.get("position", {}))
    missing = [joint for joint in robot.joints if joint not in found["position"]]
    if missing:
        raise BadInput(f"{table.path}: no column for the position of {', '.join(missing)}; name it with --joint")
    time = _guess_time(table, out, "time", hand)
    if not hand.joints and "actual_q_0" in header and header.count("timestamp") == 1 and len(robot.joints) == 6:
        out.preset = "ur_rtde"
        if hand.time is None:
            out.columns.clear()
        out.words.append("columns of Universal Robots' RTDE recorder (preset ur_rtde)")
        if not {"actual_robot_voltage", "actual_robot_current"} <= set(header) or hand.power is not None:
            _guess_meter(table, out, hand, robot)
        return out
    _guess_meter(table, out, hand, robot)
    without_foreign(found, table, out.words)
    table.load([*(c for by in found.values() for c in by.values())])
    raw = {s: np.column_stack([table.column(by[j]) for j in robot.joints])[:LOOKED_AT] for s, by in found.items()}
    units = joint_units(table, robot, found, raw, time, out.words, out.sure)
    stamps = out.columns["time"]
    if TOO_FAST in out.words and isinstance(stamps, dict) and out.first < EPOCH:
        column, first = stamps["column"], found["position"][robot.joints[0]]
        if named_unit("time", column, table) is None:
            raise BadInput(
                f"{table.path}: columns {column!r} and {first!r}: the joints are too fast if times are "
                f"{stamps['unit']} and positions rad; name a unit, as by --time {column}:s or --joint JOINT=COLUMN:deg"
            )
    for signal, by in found.items():
        unit = units.get(signal)
        if unit is None:
            continue
        for joint, column in by.items():
            out.columns[f"{joint}.{signal}"] = {"column": column, "unit": unit[joint]} if unit[joint] else column
        sample, last = by[robot.joints[0]], by[robot.joints[-1]]
        alike = sum(cut(name).words == cut(sample).words for name in header) if cut(sample).numbers else 0
        if alike > robot.n and signal == "position":
            out.words.append(f"{alike} columns like {sample}, {robot.n} joints: only those below are taken")
        out.words.append(f"{signal}: {sample} ... {last} [{units_in_words(signal, unit, robot)}]")
    return out


def guess_meter(table: Table, robot: Robot, span: float | None, hand: ByHand) -> Guess:
    """Columns and units of a meter's own file.

    Args:
        table: the file. robot: which the meter measures. span: [s] its approximate duration, if known.
        hand: columns that the user named.

    Raises:
        BadInput: it has neither power nor energy.
    """
    out = Guess()
    _guess_time(table, out, "power.time", hand, span)
    _guess_meter(table, out, hand, robot)
    known, only = {"power", "energy"} & set(out.columns), power_by_file(table.header, table.path.stem)
    if not known and hand.power is None and only is not None:
        _guess_meter(table, out, replace(hand, power=only), robot)
        unit = _unnamed_units("power", table, out).get(only)
        assumed = f"; the unit {unit} is assumed" if unit else ""
        out.words.append(f"{only} is taken for the power, as the file's name says{assumed}")
    elif not known:
        said = understood(table, out.columns)
        likely = power_by_file(table.header, "power")
        said += f"; if this is the power: --power {shlex.quote(likely + ':W')}" if likely else ""
        raise BadInput(f"{table.path}: neither joints' positions nor power nor energy of the whole robot; {said}")
    return out


def _guess_time(table: Table, out: Guess, key: str, hand: ByHand, span: float | None = None) -> np.ndarray:
    """Find the column of stamps: the likeliest name whose values never decrease, and increase overall."""
    named, back = [hand.time] if hand.time in table.header else [], ""
    for name in named or time_columns(table.header):
        stamps = table.column(name)
        at = np.flatnonzero(np.isfinite(stamps))
        values = stamps[at]
        table.faults = [fault for fault in table.faults if f"column {name}:" not in fault]
        falls = np.flatnonzero(np.diff(values) < 0)
        if len(falls) and not back:
            k = int(falls[0])
            back = f"row {table.row_number(int(at[k + 1]))}, column {name}: {values[k + 1]:.14g} comes after "
            back += f"{values[k]:.14g}; expected times that never decrease (a file for each start of a clock)"
        if len(values) < 2 or len(falls) or values[-1] <= values[0]:
            continue
        out.dated = table.is_date(name)
        unit = named_unit("time", name, table)
        factor = 1.0 if out.dated else UNITS["time"][unit] if unit else stamp_factor(values, key, span)
        unit = unit or TIME_UNITS.get(factor)
        out.columns[key] = {"column": name, "unit": unit} if unit and not out.dated else name
        out.first, out.last = float(values[0]) * factor, float(values[-1]) * factor
        out.words.append(f"{key}: {' and '.join(table.parts_of(name))} [{'date' if out.dated else unit or 's'}]")
        return table.column(name)[:LOOKED_AT] * factor
    what = f"--time {named[0]}: its values do not increase" if named else "no column of times that increase"
    raise BadInput(f"{table.path}: {what}; {back or understood(table, out.columns)}")


def _guess_meter(table: Table, out: Guess, hand: ByHand, robot: Robot) -> None:
    """Find the meter's columns: those of the power, else a counter. Units are guessed by size if none is named."""
    (how, columns), energy = whole_power(table.header), energy_column(table.header)
    if hand.power is not None and all(part in table.header for part in hand.power.split("*")):
        columns = hand.power.split("*", 1)
        how = "product" if len(columns) > 1 else "column"
    elif hand.power in table.header:
        how, columns = "column", [hand.power]
    if how not in ("", "product"):
        power = columns[0]
        unit = named_unit("power", power, table)
        mean = float(np.nanmean(np.abs(table.column(power)))) if unit is None else 0.0
        if unit is None and 0 < mean < min(ARM_POWER[0], _largest_power(robot) / UNITS["power"]["kW"]):
            unit = "kW"
        elif unit is None and mean > ARM_POWER[1]:
            unit = "mW"
        if unit not in (None, "W"):
            out.words.append(f"power in {unit}: converted")
        named = {"unit": unit} if unit else {}
        several = {"column": power} if how == "column" else {how: columns}
        out.columns["power"] = {**several, **named} if unit or how != "column" else power
        out.words.append(f"power: {(' + ' if how == 'sum' else ' - ').join(columns)} [{unit or 'W'}]")
    elif how:
        out.columns["power"] = {"product": columns}
        units = [named_unit(kind, name, table) for kind, name in zip(("voltage", "current"), columns, strict=True)]
        factor = prod(UNITS[kind][unit] for kind, unit in zip(("voltage", "current"), units, strict=True) if unit)
        if units[1] is None and float(np.nanmean(np.abs(table.column(columns[1])))) > MOST_AMPERES:
            factor *= UNITS["current"]["mA"]
        unit = min(UNITS["power"], key=lambda known: abs(log(UNITS["power"][known] / factor)))
        out.columns["power"] |= {} if unit == "W" else {"unit": unit}
        out.words.append(f"power: {columns[0]} * {columns[1]} [{unit}]")
    elif energy is not None:
        unit = named_unit("energy", energy, table) or _counter_unit(table.column(energy), out.last - out.first, robot)
        out.columns["energy"] = {"column": energy, "unit": unit}
        out.words.append(f"energy: {energy} [{unit}], a counter")


def _largest_power(robot: Robot) -> float:
    """Power [W] that an arm with its controller does not exceed on average, by its limits, else by its weight."""
    q = postures(robot.limits)
    holding = float(np.abs(robot.body.torque(q, np.zeros_like(q), np.zeros_like(q))).max())
    efforts = np.where(np.isfinite(robot.limits.effort), robot.limits.effort, SPARE * holding)
    motors = float(efforts @ robot.limits.velocity)
    return motors + STANDBY if 0 < motors < np.inf else ARM_POWER[1]


def _counter_unit(values: np.ndarray, seconds: float, robot: Robot) -> str:
    """Unit in which a counter's mean power is plausible for an arm."""
    values = values[np.isfinite(values)]
    rise = float(values[-1] - values[0]) / max(seconds, 1e-9) if len(values) else 0.0
    most = min(ARM_POWER[1] / 4, _largest_power(robot))
    fitting = (u for u in ("J", "Wh", "kWh", "mJ") if ARM_POWER[0] < rise * UNITS["energy"][u] < most)
    return next(fitting, "J")


def in_one_unit(guesses: Mapping[Table, Guess], again: Callable[[Table], Guess]) -> dict[Table, Guess]:
    """The guesses with one unit for each column that no file names a unit for.

    It is the smallest of the units guessed, unless a file's values speak against it: small values, as of an arm near
    zero or at rest, show no unit.

    Args:
        guesses: by file. again: guesses once more; units that are named in the table have priority.
    """
    anew: set[Table] = set()
    words = []
    for kind in ("position", "current", "power"):
        units = {table: _unnamed_units(kind, table, guess) for table, guess in guesses.items()}
        smallest: dict[str, Table] = {}
        for table, by in units.items():
            for column, unit in by.items():
                other = smallest.setdefault(column, table)
                if UNITS[kind][unit] < UNITS[kind][units[other][column]]:
                    smallest[column] = table
        differing = [(t, c) for t, by in units.items() for c, unit in by.items() if unit != units[smallest[c]][c]]
        if differing and not any(_shows_unit(kind, table, smallest[c], c) for table, c in differing):
            shown = {column: units[table][column] for column, table in smallest.items()}
            first = differing[0][1]
            words.append(f"{kind}: {shown[first]} in all files, as {smallest[first].path.name} shows")
            for table, by in units.items():
                table.units |= {column: shown[column] for column in by}
                anew |= {table} if by else set()
    out = {table: again(table) if table in anew else guess for table, guess in guesses.items()}
    next(iter(out.values()), Guess()).words.extend(words)
    return out


def _unnamed_units(kind: str, table: Table, guess: Guess) -> dict[str, str]:
    """The guessed unit of each column of a kind for which the file names none."""
    out = {}
    for key, entry in guess.columns.items():
        rule = {"column": entry} if isinstance(entry, str) else entry
        if (
            kind_of(key) == kind
            and "column" in rule
            and named_unit(kind, rule["column"], table, key.rpartition(".")[0]) is None
        ):
            out[rule["column"]] = rule.get("unit", next(iter(UNITS[kind])))
    return out


def _shows_unit(kind: str, table: Table, other: Table, column: str) -> bool:
    """Whether a column's values show that its unit is not the smaller one of another file: angles that move, or sizes
    that differ as those of units do.
    """
    values, others = (t.column(column)[:LOOKED_AT] for t in (table, other))
    if kind == "position":
        return float(np.nanmax(values) - np.nanmin(values)) > STILL
    return float(np.nanmean(np.abs(values))) < APART * float(np.nanmean(np.abs(others)))


def same_columns(guesses: Mapping[str, Guess]) -> None:
    """Refuse files whose columns differ: a log describes all its files alike.

    Raises:
        BadInput: names two files and a column.
    """
    items = list(guesses.items())
    for name, guess in items[1:]:
        first_name, first = items[0]
        for key in sorted({*guess.columns, *first.columns, "preset"}):
            a = first.preset if key == "preset" else first.columns.get(key)
            b = guess.preset if key == "preset" else guess.columns.get(key)
            if a != b:
                raise BadInput(
                    f"{name}: {key} is {_in_words(b)}, in {first_name} it is {_in_words(a)}; "
                    "import them into sets of their own"
                )


def _in_words(column: Any) -> str:
    """A column of a log, or a preset, as a message names it."""
    if isinstance(column, Mapping) and "column" in column:
        return f"column {column['column']!r}" + (f" in {column['unit']}" if "unit" in column else "")
    return "absent" if column is None else repr(column)
