"""Which column of a file holds what: headers, units, products of columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from energy_opt.errors import BadInput, near
from energy_opt.measured.run import JOINT_SIGNALS
from energy_opt.measured.table import Table
from energy_opt.measured.units import UNITS, known_unit

WHOLE = ("time", "power", "energy", "power.time")  # quantities that belong to no joint
LOGGED = "signal"  # signal.<name>: what else is recorded, 0 and 1 or a number


@dataclass(frozen=True)
class Rule:
    """A quantity is the product of some columns, times a factor to SI units.

    A factor of None is SI's own, unless the file has a row of units that says otherwise.
    """

    columns: tuple[str, ...]
    factor: float | None = None

    def there(self, table: Table) -> bool:
        """Whether a table has all its columns."""
        return all(name in table for name in self.columns)


def kind_of(quantity: str) -> str:
    """The kind of a quantity's unit: "time", "power", "energy" or a joint signal."""
    if quantity in WHOLE:
        return "time" if quantity.endswith("time") else quantity
    return quantity.rpartition(".")[2]


def factor_of(quantity: str, rule: Rule, table: Table) -> float:
    """The factor to SI: what the log says, else the file's row of units, else 1."""
    if rule.factor is not None:
        return rule.factor
    kind = kind_of(quantity)
    unit = known_unit(kind, table.units.get(rule.columns[0], "")) if len(rule.columns) == 1 else None
    return UNITS[kind][unit] if unit else 1.0


def rule_from(quantity: str, value: Any, where: str) -> Rule:
    """A rule from an entry of the [columns] table: a header, or a table with column or product, and unit."""
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
    only(value, ("column", "product", "unit"), f"{where}: columns.{quantity}")
    if ("column" in value) == ("product" in value):
        raise BadInput(f"{where}: columns.{quantity}: expected either column or product")
    names = [value["column"]] if "column" in value else value["product"]
    if not isinstance(names, list) or not names or not all(isinstance(name, str) and name for name in names):
        raise BadInput(f"{where}: columns.{quantity}: column is a header, product a list of headers")
    if "unit" not in value:
        return Rule(tuple(names))
    unit = known_unit(kind, value["unit"]) if isinstance(value["unit"], str) else None
    if unit is None:
        raise BadInput(f"{where}: columns.{quantity}: unit {value['unit']!r}; known: {', '.join(UNITS[kind])}")
    return Rule(tuple(names), UNITS[kind][unit])


def _signal(quantity: str, value: Any, where: str) -> Rule:
    """The rule of a further signal: a header, or a table with a column."""
    column = value.get("column") if isinstance(value, dict) and set(value) == {"column"} else value
    name = quantity.partition(".")[2] or "signal"
    if not isinstance(column, str) or not column or not name.replace("_", "").replace("-", "").isalnum():
        raise BadInput(
            f"{where}: columns.{quantity} = {value!r}; expected a header, and a name of letters, digits, _ and -"
        )
    return Rule((column,))


def only(table: Mapping[str, Any], keys: Sequence[str], where: str) -> None:
    """Refuse keys that are not known, with the one that is near.

    Raises:
        BadInput: names the first unknown key.
    """
    for key in table:
        if key not in keys:
            raise BadInput(f"{where}: unknown key {key!r}; expected {', '.join(keys)}{near(key, keys)}")


def plain_rules(joints: Sequence[str]) -> dict[str, Rule]:
    """CONTRACT's own headers: every quantity in the column of its name."""
    names = ["time", "power", *(f"{joint}.{signal}" for joint in joints for signal in JOINT_SIGNALS)]
    return {name: Rule((name,)) for name in names}
