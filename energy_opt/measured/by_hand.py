"""Columns that a user names because their headers say too little, and headers as messages quote them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from energy_opt.errors import BadInput, near
from energy_opt.measured.table import Table
from energy_opt.measured.units import known_unit
from energy_opt.robot import Robot

QUOTED = 12  # headers that a message quotes
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

    def within(self, tables: Sequence[Table], robot: Robot | None) -> ByHand:
        """The same without units, which go to the tables.

        Raises:
            BadInput: no file has such a column, or the robot no such joint.
        """
        for joint in self.joints:
            if robot is None:
                raise BadInput("--joint needs --robot: whose joints are they?")
            if joint not in robot.joints:
                hint = near(joint, robot.joints)
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
        """Position columns by joint: those found, and in their place those named that this table has."""
        return {**found, **{joint: column for joint, column in self.joints.items() if column in table.header}}


def _column(tables: Sequence[Table], option: str, kind: str, word: str) -> str:
    """The header that a word names; its unit goes to the tables that have it."""
    column, _, unit = word.rpartition(":")
    known = known_unit(kind, unit) if column else None
    for name, named in ((word, None), (column, known)):
        having = [table for table in tables if name and name in table.header]
        if having and (name == word or known is not None):
            for table in having:
                table.units |= {} if named is None else {name: named}
            return name
    headers = list(dict.fromkeys(name for table in tables for name in table.header))
    if column in headers:
        raise BadInput(f"{option} {word}: {unit!r} is no unit of {kind}")
    raise BadInput(f"{option} {word}: no such column{near(word, headers)}; there are {quoted(headers)}")


def quoted(headers: Iterable[str]) -> str:
    """Headers between quotes, the first of many."""
    names = list(headers)
    more = f" and {len(names) - QUOTED} more" if len(names) > QUOTED else ""
    return ", ".join(repr(name) for name in names[:QUOTED]) + more


def understood(table: Table, columns: Mapping[str, object]) -> str:
    """What was understood of a table's headers, and what was not.

    Args:
        columns: entries of [columns]: a header, {"column": header} or {"product": [header, header]}.
    """
    used: dict[str, str] = {}
    for key, entry in columns.items():
        rule = entry if isinstance(entry, dict) else {"column": entry}
        product = rule.get("product")
        names = product if isinstance(product, list) else [rule.get("column")]
        used |= {str(name): key for name in names}
    unknown = [name for name in table.header if name and name not in used]
    known = ", ".join(f"{name!r} as {key}" for name, key in list(used.items())[:QUOTED])
    left = f"; not understood: {quoted(unknown)}; {HINT}" if unknown else ""
    return f"{table.path.name}: understood: {known or 'nothing'}{left}"
