"""What a recording holds beside the joints and the meter: digital signals, and numbers that the log offers."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from energy_opt.measured.columns import LOGGED, Rule
from energy_opt.measured.table import Table

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
