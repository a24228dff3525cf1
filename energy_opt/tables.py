"""Tables of numbers as CSV files."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput, read_each, refuse
from energy_opt.files import finite_number, read_text, replacing

IMPORT = "`energy-opt import` converts logs with other columns"  # advice where columns are missing


def write_table(path: Path, header: Sequence[str], columns: Sequence[np.ndarray]) -> None:
    """Write a table as CSV with full double precision.

    Args:
        path: the file. header: name of each column; characters that would break its line become "_".
        columns: (N,) each.
    """
    with replacing(path) as aside, aside.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow("".join(c if c.isprintable() else "_" for c in name) for name in header)
        table.writerows(np.column_stack(columns).tolist())


def read_table(path: Path) -> dict[str, np.ndarray]:
    """Columns of a CSV file by header; every entry must be a finite number. Columns of text alone are left out.

    Raises:
        BadInput: a line for each fault, with the file, the row (the header is row 1) and the column.
    """
    try:
        records = list(csv.reader(read_text(path).splitlines()))
    except csv.Error as error:
        raise BadInput(f"{path}: not a table: {error}") from None
    if not records or not any(cell.strip() for cell in records[0]):
        raise BadInput(f"{path}: row 1: no header; expected column names such as time, <joint>.position")
    header = [cell.strip() for cell in records[0]]
    mark = next((mark for mark in ";\t|" if mark in header[0] and len(header) == 1), None)
    if mark is not None:
        raise BadInput(f"{path}: row 1: columns are separated by {mark!r}; expected commas, and points in numbers")
    repeated = sorted({name for name in header if header.count(name) > 1})
    refuse(f"{path}: row 1: column {name!r} is given twice" for name in repeated)
    body = [(k, row) for k, row in enumerate(records[1:], start=2) if row]
    if not body:
        raise BadInput(f"{path}: row 2: no data rows below the header")
    wide = len(header)
    refuse(f"{path}: row {k}: {len(row)} cells, the header has {wide}" for k, row in body if len(row) != wide)
    kept = [c for c in range(len(header)) if not all(_is_text(row[c]) for _, row in body)]
    if 0 < len(kept) < len(header):
        header, body = [header[c] for c in kept], [(k, [row[c] for c in kept]) for k, row in body]
    try:
        values = np.array([row for _, row in body], dtype=float)
    except ValueError:
        values = np.empty((0, 0))
    underscored = any("_" in "".join(row) for _, row in body)  # Python and NumPy read 3_0 as 30
    if not values.size or underscored or not np.isfinite(values).all():
        cells = ((k, *cell) for k, row in body for cell in zip(header, row, strict=True))
        read_each(finite_number, ((cell, f"{path}: row {k}, column {name}") for k, name, cell in cells))
    return {name: values[:, c] for c, name in enumerate(header)}


def _is_text(cell: str) -> bool:
    """Is a cell of a table neither empty nor a number?"""
    try:
        float(cell)
    except ValueError:
        return bool(cell.strip())
    return False
