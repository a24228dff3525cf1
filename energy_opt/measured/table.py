"""Columns of a measured CSV file: only those asked for are read, so that text columns beside them do no harm."""

from __future__ import annotations

import contextlib
import csv
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import read_text

MAX_FAULTS = 5  # named per column; the rest is counted


class Table:
    """A CSV file as text cells, converted column by column."""

    def __init__(self, path: Path) -> None:
        rows = list(csv.reader(read_text(path).splitlines()))
        if not rows or not any(cell.strip() for cell in rows[0]):
            raise BadInput(f"{path}: row 1: no header; expected column names such as time, <joint>.position")
        self.path = path
        self.header = [cell.strip() for cell in rows[0]]
        self.faults: list[str] = []
        for name in sorted({name for name in self.header if name and self.header.count(name) > 1}):
            self.faults.append(f"{path}: row 1: column {name!r} stands there twice")
        self.rows = [(k, row) for k, row in enumerate(rows[1:], start=2) if row]
        if not self.rows:
            self.faults.append(f"{path}: row 2: no data rows below the header")
        ragged = [(k, len(row)) for k, row in self.rows if len(row) != len(self.header)]
        for k, cells in ragged[:MAX_FAULTS]:
            self.faults.append(f"{path}: row {k}: {cells} cells, the header has {len(self.header)}")

    def __contains__(self, name: str) -> bool:
        return name in self.header

    def column(self, name: str) -> np.ndarray:
        """One column (N,) as numbers; cells that are none become nan and are added to `faults`."""
        if name not in self.header:
            self.faults.append(f"{self.path}: row 1: no column {name!r}; there are {', '.join(self._shown())}")
            return np.full(len(self.rows), np.nan)
        at = self.header.index(name)
        out = np.full(len(self.rows), np.nan)
        bad = 0
        for k, (number, row) in enumerate(self.rows):
            cell = row[at] if at < len(row) else ""
            with contextlib.suppress(ValueError):
                out[k] = float(cell)
            if not math.isfinite(out[k]):
                bad += 1
                if bad <= MAX_FAULTS:
                    what = "is not a number" if cell.strip() else "is empty"
                    self.faults.append(f"{self.path}: row {number}, column {name}: {cell!r} {what}")
        if bad > MAX_FAULTS:
            self.faults.append(f"{self.path}: column {name}: {bad - MAX_FAULTS} more cells are not numbers")
        return out

    def product(self, names: Iterable[str]) -> np.ndarray:
        """The product of columns, (N,)."""
        out = np.ones(len(self.rows))
        for name in names:
            out = out * self.column(name)
        return out

    def row_number(self, index: int) -> int:
        """The row in the file of a data row."""
        return self.rows[index][0]

    def _shown(self, most: int = 12) -> list[str]:
        return self.header[:most] + ([f"... ({len(self.header)} in all)"] if len(self.header) > most else [])
