"""Which column of a file holds what: headers, units, products of columns, and presets of known recorders."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from energy_opt.errors import BadInput

SIGNALS = ("position", "velocity", "acceleration", "effort", "temperature")

# Factors to SI, by the kind of quantity.
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "position": {"rad": 1.0, "deg": math.pi / 180, "rev": 2 * math.pi, "m": 1.0, "mm": 1e-3},
    "velocity": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": math.pi / 30, "m/s": 1.0},
    "acceleration": {"rad/s^2": 1.0, "deg/s^2": math.pi / 180, "m/s^2": 1.0},
    "effort": {"N m": 1.0, "Nm": 1.0, "mN m": 1e-3, "N": 1.0},
    "temperature": {"degC": 1.0},
    "power": {"W": 1.0, "mW": 1e-3, "kW": 1e3},
}


@dataclass(frozen=True)
class Rule:
    """A quantity is the product of some columns, times a factor to SI units."""

    columns: tuple[str, ...]
    factor: float = 1.0


def kind_of(quantity: str) -> str:
    """The kind of a quantity's unit: "time", "power" or a joint signal."""
    if quantity in ("time", "power", "power.time"):
        return "time" if quantity.endswith("time") else "power"
    return quantity.rpartition(".")[2]


def rule_from(quantity: str, value: Any, where: str) -> Rule:
    """A rule from an entry of the [columns] table: a header, or a table with column or product, and unit."""
    kind = kind_of(quantity)
    if kind not in UNITS or ("." not in quantity and quantity not in ("time", "power")):
        raise BadInput(
            f"{where}: columns: unknown quantity {quantity!r}; expected time, power, power.time or <joint>.<signal> "
            f"with a signal of {', '.join(SIGNALS)}"
        )
    if isinstance(value, str):
        return Rule((value,))
    if not isinstance(value, dict):
        raise BadInput(
            f'{where}: columns.{quantity} = {value!r}; expected a header or {{ column = "...", unit = "..." }}'
        )
    unknown = sorted(set(value) - {"column", "product", "unit"})
    if unknown:
        raise BadInput(f"{where}: columns.{quantity}: unknown key {unknown[0]!r}; expected column, product, unit")
    if ("column" in value) == ("product" in value):
        raise BadInput(f"{where}: columns.{quantity}: expected either column or product")
    names = [value["column"]] if "column" in value else value["product"]
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise BadInput(f"{where}: columns.{quantity}: column is a header, product a list of headers")
    standard = next(iter(UNITS[kind]))
    unit = value.get("unit", standard)
    if unit not in UNITS[kind]:
        raise BadInput(f"{where}: columns.{quantity}: unit {unit!r}; known: {', '.join(UNITS[kind])}")
    return Rule(tuple(names), UNITS[kind][unit])


def plain_rules(joints: Sequence[str]) -> dict[str, Rule]:
    """CONTRACT's own headers: every quantity in the column of its name."""
    names = ["time", "power", *(f"{joint}.{signal}" for joint in joints for signal in SIGNALS)]
    return {name: Rule((name,)) for name in names}


def ur_rtde(joints: Sequence[str]) -> dict[str, Rule]:
    """Universal Robots' RTDE recorder: joints by number, arm power as supply voltage times current."""
    rules = {
        "time": Rule(("timestamp",)),
        "power": Rule(("actual_robot_voltage", "actual_robot_current")),
    }
    for k, joint in enumerate(joints):
        rules[f"{joint}.position"] = Rule((f"actual_q_{k}",))
        rules[f"{joint}.velocity"] = Rule((f"actual_qd_{k}",))
        rules[f"{joint}.temperature"] = Rule((f"joint_temperatures_{k}",))
    return rules


PRESETS = {"ur_rtde": ur_rtde}

# Columns in which a recorder states the payload that the arm was told of: mass [kg], centre of mass [m].
PAYLOAD = {"ur_rtde": ("payload", "payload_cog_0", "payload_cog_1", "payload_cog_2")}


def build_rules(joints: Sequence[str], preset: str | None, given: Mapping[str, Rule]) -> dict[str, Rule]:
    """The rules of a set: plain headers or a preset, overlaid by what the log file gives."""
    rules = PRESETS[preset](joints) if preset else plain_rules(joints)
    return {**rules, **given}
