"""Meaning of a file's columns: headers, units, products of columns.

It comes from a log, from a preset of a known recorder (Universal Robots' RTDE, Franka's state, `sensor_msgs/JointState`
out of bags), or from the user if the headers are unclear.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from energy_opt.errors import BadInput, suggest
from energy_opt.measured.header import UNITS, known_unit, no_unit
from energy_opt.measured.meter_names import power_column
from energy_opt.measured.names import joint_columns
from energy_opt.measured.run import JOINT_SIGNALS
from energy_opt.measured.stated_units import is_known, stated_unit
from energy_opt.measured.table import Table
from energy_opt.robot import Robot

COMBINED = ("column", "product", "sum", "difference")  # how a quantity is made of columns
WHOLE = ("time", "power", "energy", "power.time")  # quantities that belong to no joint
ARM_POWER = (5.0, 20_000.0)  # [W] range of the mean power of an arm with its controller
LOGGED = "signal"  # signal.<name>: further recorded signals, digital (0 and 1) or numbers


@dataclass(frozen=True)
class Rule:
    """A quantity is the product of some columns (or their sum, or difference), times a factor to SI units.

    A factor of None means SI units, unless the file's row of units or the header names another.
    """

    columns: tuple[str, ...]
    factor: float | None = None
    combined: str = "product"

    def has_columns(self, table: Table) -> bool:
        """Whether a table has all its columns."""
        return all(name in table for name in self.columns)


def kind_of(quantity: str) -> str:
    """The kind of a quantity's unit: "time", "power", "energy" or a joint signal."""
    if quantity in WHOLE:
        return "time" if quantity.endswith("time") else quantity
    return quantity.rpartition(".")[2]


def named_unit(kind: str, column: str, table: Table, joint: str = "") -> str | None:
    """The unit named by the row of units or by the header itself; None for none.

    Another one than those of the kind is added to the table's faults, unless the kind is "time": stamps show theirs.
    """
    stated = stated_unit(kind, column, table.units.get(column, ""), joint)
    unit = known_unit(kind, stated)
    if unit is None and stated and kind != "time":
        hand = "give it as COLUMN:UNIT, or as unit in log.toml"
        table.fault(f"{no_unit(kind, stated)}; if the header means another, {hand}", repr(column))
    return unit


def factor_of(quantity: str, rule: Rule, table: Table) -> float:
    """Factor to SI units: from the log, else from the file's row of units or the headers, else 1.

    Args:
        quantity: as log.toml names it. rule: its columns; those of a product are voltage and current. table: the file.
    """
    if rule.factor is not None:
        return rule.factor
    product = len(rule.columns) > 1 and rule.combined == "product"
    kind, joint, out = kind_of(quantity), quantity.rpartition(".")[0], 1.0
    for column in rule.columns if product else rule.columns[:1]:
        if product:
            current = stated_unit("current", column, table.units.get(column, ""))
            kind = "current" if known_unit("current", current) else "voltage"
        unit = named_unit(kind, column, table, joint)
        out *= UNITS[kind][unit] if unit else 1.0
    return out


def rule_from(quantity: str, value: Any, where: str) -> Rule:
    """A rule from an entry of the [columns] table.

    Args:
        quantity: the entry's key. value: a header, or a table with one of COMBINED, and unit. where: the log's name.

    Raises:
        BadInput: an unknown quantity, key or unit, or no header.
    """
    if quantity == LOGGED or quantity.startswith(LOGGED + "."):
        return _signal(quantity, value, where)
    kind = kind_of(quantity)
    if kind not in UNITS or ("." not in quantity and quantity not in WHOLE):
        raise BadInput(
            f"{where}: columns: unknown quantity {quantity!r}; expected {', '.join(WHOLE)}, {LOGGED}.<name> or "
            f"<joint>.<signal> with a signal of {', '.join(JOINT_SIGNALS)}"
        )
    if isinstance(value, str) and value:
        return Rule((value,))
    if not isinstance(value, dict):
        raise BadInput(
            f'{where}: columns.{quantity} = {value!r}; expected a header or {{ column = "...", unit = "..." }}'
        )
    keys = (*COMBINED, "unit")
    unknown = next((key for key in value if key not in keys), None)
    if unknown is not None:
        hint = suggest(unknown, keys)
        raise BadInput(f"{where}: columns.{quantity}: unknown key {unknown!r}; expected {', '.join(keys)}{hint}")
    how = [key for key in COMBINED if key in value]
    if len(how) != 1:
        raise BadInput(f"{where}: columns.{quantity}: expected one of {', '.join(COMBINED)}")
    combined = how[0].replace("column", "product")
    names = [value["column"]] if "column" in value else value[combined]
    if not isinstance(names, list) or not names or not all(isinstance(name, str) and name for name in names):
        raise BadInput(
            f"{where}: columns.{quantity}: column is a header, product, sum and difference are lists of headers"
        )
    if "unit" not in value:
        return Rule(tuple(names), None, combined)
    unit = known_unit(kind, value["unit"]) if isinstance(value["unit"], str) else None
    if unit is None:
        raise BadInput(f"{where}: columns.{quantity}: {no_unit(kind, str(value['unit']))}")
    return Rule(tuple(names), UNITS[kind][unit], combined)


def _signal(quantity: str, value: Any, where: str) -> Rule:
    """The rule of a further signal: a header, or a table with a column."""
    column = value.get("column") if isinstance(value, dict) and set(value) == {"column"} else value
    name = quantity.partition(".")[2] or "signal"
    if not isinstance(column, str) or not column or not name.replace("_", "").replace("-", "").isalnum():
        raise BadInput(
            f"{where}: columns.{quantity} = {value!r}; expected a header, and a name of letters, digits, _ and -"
        )
    return Rule((column,))


def plain_rules(joints: Sequence[str]) -> dict[str, Rule]:
    """Rules for the package's own headers: every quantity in the column of its name."""
    names = ["time", "power", *(f"{joint}.{signal}" for joint in joints for signal in JOINT_SIGNALS)]
    return {name: Rule((name,)) for name in names}


# Columns in which a recorder states the payload set on the arm: mass [kg], centre of mass [m].
PAYLOAD = {"ur_rtde": ("payload", "payload_cog_0", "payload_cog_1", "payload_cog_2")}
AUTO = float("nan")  # factor of a time whose unit is found from the stamps


def ur_rtde(robot: Robot, table: Table) -> dict[str, Rule]:
    """Universal Robots' RTDE recorder: joints by number, arm power as supply voltage times current."""
    rules = {"time": Rule(("timestamp",)), "power": Rule(("actual_robot_voltage", "actual_robot_current"))}
    for k, joint in enumerate(robot.joints):
        rules[f"{joint}.position"] = Rule((f"actual_q_{k}",))
        rules[f"{joint}.velocity"] = Rule((f"actual_qd_{k}",))
        rules[f"{joint}.current"] = Rule((f"actual_current_{k}",))
        rules[f"{joint}.temperature"] = Rule((f"joint_temperatures_{k}",))
    return rules


def franka_state(robot: Robot, table: Table) -> dict[str, Rule]:
    """Franka's state: libfranka's log (`state.q[0]`, time in ms) or a bag's `FrankaState` (`field.q0`, `.../q[0]`).

    Position `q`, velocity `dq` and link-side torque `tau_J`, with any prefix and any form of numbering.

    Raises:
        BadInput: there are more joints in the file than `joints`.
    """
    rules = _stamps(table)
    for signal, stem in (("position", "q"), ("velocity", "dq"), ("effort", "tau_J")):
        pattern = re.compile(rf"(?:.*[./ ]|){stem}[\[._/ ]?(\d)\]?")
        found = {int(m.group(1)): name for name in table.header if (m := pattern.fullmatch(name))}
        if len(found) > robot.n:
            raise BadInput(
                f"{table.path}: row 1: {stem} of {len(found)} joints; the log's robot has {robot.n}: "
                f"{', '.join(robot.joints)}"
            )
        for k, joint in enumerate(robot.joints):
            rules[f"{joint}.{signal}"] = Rule((found.get(k, f"{stem}[{k}]"),), 1.0)
    return rules


def joint_state(robot: Robot, table: Table) -> dict[str, Rule]:
    """`sensor_msgs/JointState` as a bag's or plotter's export writes it: by name, or by number in the order of `name`.

    `/joint_states/elbow_joint/position`, `/joint_states/position/elbow_joint`, `field.position2` with `field.name2`,
    `/joint_states/position[2]`, `position_2`. Numbers without names mean the robot's own order.
    """
    rules = _stamps(table)
    found = joint_columns(table.header, robot, given_names(table))
    for signal in ("position", "velocity", "effort"):
        for joint, name in found.get(signal, {}).items():
            rules[f"{joint}.{signal}"] = Rule((name,))
    if "position" not in found:
        raise BadInput(
            f"{table.path}: row 1: no positions of {', '.join(robot.joints)} among {', '.join(table.header[:12])}"
            + (" ..." if len(table.header) > 12 else "")
        )
    return rules


def given_names(table: Table) -> dict[int, str]:
    """Joint names by number, if a message's array `name` is exported with its positions."""
    if not table.layout.sample:
        return {}
    out = {}
    for k, header in enumerate(table.header):
        match = re.fullmatch(r"(?:.*[./ ]|)name[\[._/ ]?(\d+)\]?", header)
        if match and k < len(table.layout.sample[0]):
            out[int(match.group(1))] = table.layout.sample[0][k].strip().strip('"')
    return out


def _stamps(table: Table) -> dict[str, Rule]:
    """Rules for time and, if there is one, power."""
    names = ("__time", "time", "Time", "timestamp", "rosbagTimestamp", "_time", "t")
    bare = {re.sub(r"^[%#]\s*", "", name): name for name in table.header}
    name, power = next((bare[n] for n in names if n in bare), "time"), power_column(table.header)
    return {"time": Rule((name,), AUTO)} | ({} if power is None else {"power": Rule((power,))})


PRESETS: Mapping[str, Callable[[Robot, Table], dict[str, Rule]]] = {
    reader.__name__: reader for reader in (ur_rtde, franka_state, joint_state)
}


QUOTED = 12  # most headers that a message quotes
HINT = "name columns with --time COLUMN, --power COLUMN, --joint JOINT=COLUMN"


@dataclass(frozen=True)
class ByHand:
    """Columns named by hand, each as COLUMN or COLUMN:UNIT.

    Attributes:
        time: the stamps. power: the whole robot's power; COLUMN*COLUMN is voltage times current.
        joints: the column of each joint's position, by the joint's name.
    """

    time: str | None = None
    power: str | None = None
    joints: Mapping[str, str] = field(default_factory=dict)

    def with_units_moved(self, tables: Sequence[Table], robot: Robot | None) -> ByHand:
        """Move the units to the tables, and return the columns without units.

        Raises:
            BadInput: no file has such a column, or the robot no such joint.
        """
        for joint in self.joints:
            if robot is None:
                raise BadInput("--joint needs --robot: the arm that has these joints")
            if joint not in robot.joints:
                hint = suggest(joint, robot.joints)
                raise BadInput(f"--joint {joint}: no such joint{hint}; the robot's are {', '.join(robot.joints)}")
        time = None if self.time is None else _column(tables, "--time", "time", self.time)
        power = self.power
        if power is not None and not any(power in table.header for table in tables) and "*" in power:
            kinds = zip(power.split("*", 1), ("voltage", "current"), strict=True)
            power = "*".join(_column(tables, "--power", kind, part.strip()) for part, kind in kinds)
        elif power is not None:
            power = _column(tables, "--power", "power", power)
        joints = {j: _column(tables, f"--joint {j}", "position", word) for j, word in self.joints.items()}
        return replace(self, time=time, power=power, joints=joints)

    def positions(self, table: Table, found: Mapping[str, str]) -> dict[str, str]:
        """Position columns by joint: columns named by hand, if this table has them, replace those found."""
        return {**found, **{joint: column for joint, column in self.joints.items() if column in table.header}}


def _column(tables: Sequence[Table], option: str, kind: str, word: str) -> str:
    """The header that a word of the user names; its unit is set in the tables that have it."""
    column, _, unit = word.rpartition(":")
    known = known_unit(kind, unit) if column else None
    for name, named in ((word, None), (column, known)):
        having = [table for table in tables if name and name in table.header]
        if having and (name == word or known is not None):
            for table in having:
                table.units |= {} if named is None else {name: named}
                table.by_hand |= set() if named is None else {name}
            return name
    headers = list(dict.fromkeys(name for table in tables for name in table.header))
    if column in headers:
        raise BadInput(f"{option} {word}: {no_unit(kind, unit)}")
    raise BadInput(f"{option} {word}: no such column{suggest(word, headers)}; there are {quoted(headers)}")


def quoted(headers: Iterable[str]) -> str:
    """Headers in quotation marks, at most `QUOTED` of them, and which of their units are not known."""
    names = list(headers)
    more = f" and {len(names) - QUOTED} more" if len(names) > QUOTED else ""
    units = {unit: name for name in reversed(names) if (unit := stated_unit("position", name)) and not is_known(unit)}
    odd = "".join(f"; unit {unit!r} of {name!r} is not known" for unit, name in reversed(units.items()))
    return ", ".join(repr(name) for name in names[:QUOTED]) + more + odd


def understood(table: Table, columns: Mapping[str, object]) -> str:
    """Sentence on which headers of a table were understood, and which not.

    Args:
        columns: entries of [columns]: a header, or a table with one of COMBINED.
    """
    used: dict[str, str] = {}
    for key, entry in columns.items():
        rule = entry if isinstance(entry, dict) else {"column": entry}
        several = next((names for names in rule.values() if isinstance(names, list)), None)
        names = several or [rule.get("column")]
        used |= {part: key for name in names for part in table.parts_of(str(name))}
    unknown = [name for name in table.header if name and name not in used]
    known = ", ".join(f"{name!r} as {key}" for name, key in list(used.items())[:QUOTED])
    left = f"; not understood: {quoted(unknown)}; {HINT}" if unknown else ""
    return f"{table.path.name}: understood: {known or 'nothing'}{left}"
