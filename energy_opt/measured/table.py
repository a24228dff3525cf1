"""Columns of a measured text table: only requested ones are converted, in one pass, with memory linear in them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.measured.layout import DATES, NUMBER, Csv, Layout, date_form, is_number, layout_of, seconds, split, text
from energy_opt.tables import IMPORT

MAX_FAULTS = 5  # most faults named per column; the rest is counted
BLOCK = 1 << 24  # [bytes] parsed at a time; a row must be shorter
NAMED = 12  # most columns that a message names
SHOWN = 40  # most characters shown of a faulty cell
SPARSE = 0.2  # share of empty cells from which a column is assumed to come from a slower source
MISSING = ("", "nan", "NaN", "NAN", "-nan", "null", "NULL", "None", "NA", "N/A", "n/a", "#N/A")
MILLISECONDS = re.compile(r"[\W_]*(milli_?(second|sekunde)?[sn]?|msecs?|ms)[\W_]*")


class Table:
    """A text table with a header; columns are read by name."""

    def __init__(self, path: Path, given: Csv | None = None) -> None:
        self.path = path
        self.layout: Layout = layout_of(path, given)
        self.header = list(self.layout.names)
        self.units = dict(zip(self.header, self.layout.units, strict=False))
        self.by_hand: set[str] = set()  # columns whose unit the user gave
        self.faults: list[str] = []
        self.remarks: list[str] = []
        if self.layout.comments:
            self.remarks.append(f"{self.layout.comments} row(s) that begin with # or % are taken for comments")
        for name in sorted({name for name in self.header if name and self.header.count(name) > 1}):
            self.faults.append(f"{path}: row 1: column {name!r} is given twice")
        self._columns: dict[str, np.ndarray] = {}
        self._parts: dict[str, list[str]] = {}
        self._count: int | None = None
        self._numbers: np.ndarray | None = None
        self._given: np.ndarray | None = None  # (N, columns) cells that are not empty
        self._skipped: list[int] = []
        if not self.layout.sample:
            self.faults.append(f"{path}: row {self.layout.first_row}: no data rows below the header")

    def __contains__(self, name: str) -> bool:
        return name in self.header

    def __len__(self) -> int:
        if self._count is None:
            self.load(self.header[:1])
        return self._count or 0

    def load(self, names: Iterable[str], sparse: bool = False) -> None:
        """Read columns that are not read yet, in one pass; cells that are no numbers are added to `faults`.

        Empty cells are no fault if their share is `SPARSE` or more (a slower source in a common table), if their row is
        one of another source, or if `sparse` is True.
        """
        wanted = [name for name in dict.fromkeys(names) if name in self.header and name not in self._columns]
        if not wanted:
            return
        if not self.layout.sample:
            self._count = 0
            self._columns |= {name: np.empty(0) for name in wanted}
            return
        import pyarrow as pa
        import pyarrow.compute as compute

        at = [self.header.index(name) for name in wanted]
        forms = [self._form(k) for k in at]
        kinds = {f"c{k}": pa.float64() for k in at}
        kinds |= {f"c{j}": pa.string() for k, form in zip(at, forms, strict=True) if form for j in self._with_day(k)}
        try:
            table = self._parse(kinds)
        except pa.ArrowInvalid as error:
            if "conversion error" not in str(error):
                raise self._parse_error(str(error)) from None
            table = self._parse({name: pa.string() for name in kinds})
        self._count = len(table)
        for name, k, form in zip(wanted, at, forms, strict=True):
            cells = table.column(f"c{k}")
            if form is not None:
                parts = self._with_day(k)
                joined = compute.binary_join_element_wise(*(table.column(f"c{j}") for j in parts), " ")
                values, fractions = self._with_fractions(seconds(joined, form))
                self._parts[name] = [*(self.header[j] for j in parts), *fractions]
            elif cells.type == pa.string():
                values = self._converted(cells)
            else:
                values = np.asarray(cells.to_numpy(), dtype=float)
            self._columns[name] = values
            empty = np.asarray(cells.is_null().to_numpy(), dtype=bool)
            bad = np.flatnonzero(~empty & ~np.isfinite(values))
            if not bad.size and not sparse and empty.any() and empty.mean() < SPARSE:
                bad = np.flatnonzero(empty & ~self._of_other_sources(empty))
            if bad.size:
                self._add_cell_faults(name, bad)
            elif len(empty) and empty.all():
                self.fault("every cell is empty", name)

    def _of_other_sources(self, empty: np.ndarray) -> np.ndarray:
        """Which lines (N,) have a reading of another source than a column: one mostly given where `empty`."""
        import pyarrow as pa

        if self._given is None:
            table = self._parse({f"c{k}": pa.string() for k in range(len(self.header))})
            self._given = np.column_stack([np.asarray(cells.is_valid()) for cells in table.columns])
        apart = self._given[empty].sum(axis=0) > self._given[~empty].sum(axis=0)
        return np.asarray(self._given[:, apart].any(axis=1))

    def column(self, name: str) -> np.ndarray:
        """One column (N,) as numbers, nan for empty cells and other text; date-times as seconds."""
        if name not in self.header:
            more = f", ... ({len(self.header)} in all)" if len(self.header) > NAMED else ""
            there = f"there are {', '.join(self.header[:NAMED])}{more}"
            advice = f"state others in [columns] of log.toml, or {IMPORT}"
            self.faults.append(f"{self.path}: row 1: no column {name!r}; {there}; {advice}")
            return np.full(len(self), np.nan)
        self.load([name])
        return self._columns[name]

    def combined(self, names: Iterable[str], how: str) -> np.ndarray:
        """The product, sum or difference of columns, (N,)."""
        operation = {"product": np.multiply, "sum": np.add, "difference": np.subtract}[how]
        return np.asarray(reduce(operation, [self.column(name) for name in names]))

    def row_number(self, index: int) -> int:
        """Row number in the file of a data row; empty lines and lines of another width do not count."""
        if self._numbers is None:
            filled = [k for k, row in enumerate(self._lines()) if row]
            kept = np.delete(np.array(filled, dtype=int), self._skipped)
            self._numbers = kept + self.layout.first_row
        return int(self._numbers[index]) if index < len(self._numbers) else self.layout.first_row + index

    def fault(self, text: str, column: str = "", index: int | None = None) -> None:
        """Add a fault, with the row of the data row `index` and the column that it is about."""
        row = [] if index is None else [f"row {self.row_number(index)}"]
        place = ", ".join([*row, *([f"column {column}"] if column else [])])
        self.faults.append(f"{self.path}: {place}{': ' if place else ''}{text}")

    def is_date(self, name: str) -> bool:
        """Whether a column holds dates or times of day."""
        return name in self.header and self._form(self.header.index(name)) is not None

    def parts_of(self, name: str) -> list[str]:
        """The columns that make up a column that is read: dates may have columns for the day and for milliseconds."""
        return self._parts.get(name, [name])

    def _form(self, k: int) -> re.Pattern[str] | None:
        """The form of dates in column k, with its day's column, by the first cells; None if these are no dates."""
        return date_form(" ".join(self._first(j) for j in self._with_day(k)))

    def _with_day(self, k: int) -> list[int]:
        """Column k; if it holds times of day, the nearest column of days before it."""
        clock = self._first(k)
        if date_form(clock) is not DATES[-1]:
            return [k]
        days = [j for j in range(len(self.header)) if date_form(f"{self._first(j)} {clock}") and self._first(j).strip()]
        return [*sorted(days, key=lambda j: abs(j - k))[:1], k]

    def _first(self, k: int) -> str:
        """The first cell of column k with content."""
        return next((row[k].strip() for row in self.layout.sample if k < len(row) and row[k].strip()), "")

    def _with_fractions(self, time: np.ndarray) -> tuple[np.ndarray, list[str]]:
        """Stamps (N,) [s] in whole seconds plus the milliseconds of a column of their own, which wrap at 1000; and its
        name, if there is such a column.
        """
        for k, name in enumerate(self.header):
            if MILLISECONDS.fullmatch(name.lower()) and is_number(self._first(k)):
                whole = time + self.column(name) / 1000
                there = np.isfinite(whole)
                second, part = time[there], self.column(name)[there]
                fractions = (second % 1 == 0).all() and (part >= 0).all() and (part < 1000).all()
                if fractions and (np.diff(whole[there]) >= 0).all():
                    return whole, [name]
        return time, []

    def _lines(self) -> list[bytes]:
        """The lines of the file from its first data row on, as bytes."""
        return re.split(rb"\r\n|\r|\n", bytes(self.layout.content[self.layout.first :]))

    def _parse(self, kinds: dict[str, Any]) -> Any:
        """Parse the columns of `kinds`; add a fault for every row of another width."""
        import pyarrow as pa
        import pyarrow.csv as arrow

        ragged: list[tuple[int, int]] = []

        def note(row: Any) -> str:
            ragged.append((row.number, row.actual_columns))
            return "skip"

        names = [f"c{k}" for k in range(len(self.header))]
        table = arrow.read_csv(
            pa.BufferReader(pa.py_buffer(self.layout.content)[self.layout.first :]),
            read_options=arrow.ReadOptions(use_threads=False, block_size=BLOCK, column_names=names),
            parse_options=arrow.ParseOptions(delimiter=self.layout.delimiter, invalid_row_handler=note),
            convert_options=arrow.ConvertOptions(
                column_types=kinds,
                include_columns=list(kinds),
                null_values=list(MISSING),
                strings_can_be_null=True,
                quoted_strings_can_be_null=True,
                decimal_point=self.layout.decimal,
                check_utf8=False,
            ),
        )
        if self._count is None:
            self._skipped = [number - 1 for number, _ in ragged]
            self._note_ragged(ragged, len(table) + len(ragged))
            self._lost_lines(len(table) + len(ragged))
        return table

    def _note_ragged(self, wrong: list[tuple[int, int]], count: int) -> None:
        """A remark on a last row that the recorder did not complete; a fault for each other row of another width,
        MAX_FAULTS at most.

        Args:
            wrong: number (from 1) and cells of each. count: number of all lines.
        """
        content, width = self.layout.content, len(self.header)
        ended = content[len(content) - 1 :] in (b"\n", b"\r")
        if wrong and wrong[-1][0] == count and wrong[-1][1] < width and not ended:
            self.remarks.append("the last row is incomplete: left out")
            wrong = wrong[:-1]
        if not wrong:
            return
        filled = [k + self.layout.first_row for k, row in enumerate(self._lines()) if row]
        for number, cells in wrong[:MAX_FAULTS]:
            self.faults.append(
                f"{self.path}: row {filled[number - 1]}: {cells} cells, the header has {len(self.header)}"
            )
        if len(wrong) > MAX_FAULTS:
            self.faults.append(f"{self.path}: {len(wrong) - MAX_FAULTS} more rows of another width than the header")

    def _lost_lines(self, read: int) -> None:
        """Add a fault if lines are missing because a quotation mark is not closed."""
        content = self.layout.content
        if content.find(b'"', self.layout.first) < 0:
            return
        lines = self._lines()
        if read < sum(bool(row.strip()) for row in lines):
            bad = next((k for k, row in enumerate(lines) if row.count(b'"') % 2), 0)
            self.faults.append(f"{self.path}: row {bad + self.layout.first_row}: a quotation mark that does not close")

    def _parse_error(self, reason: str) -> BadInput:
        """The error for a file that cannot be parsed; it names a cell of extreme length, which is the usual cause."""
        lines = self._lines()
        longest = max(range(len(lines)), key=lambda k: len(lines[k]))
        if len(lines[longest]) >= BLOCK // 4:
            cells = lines[longest].split(self.layout.delimiter.encode())
            column = max(range(len(cells)), key=lambda k: len(cells[k]))
            name = self.header[column] if column < len(self.header) else "?"
            return BadInput(
                f"{self.path}: row {longest + self.layout.first_row}, column {name}: a cell of "
                f"{len(cells[column])} characters; the file is damaged"
            )
        return BadInput(f"{self.path}: not a table of text: {' '.join(reason.split())[:200]}")

    def _converted(self, cells: Any) -> np.ndarray:
        """Text cells as numbers, nan for other text."""
        import pyarrow as pa
        import pyarrow.compute as compute

        cells = compute.utf8_trim_whitespace(cells)
        number = "^" + re.sub(r"\((?!\?)", "(?:", NUMBER).replace("[.,]", f"[{self.layout.decimal}]") + "$"
        cells = compute.if_else(compute.match_substring_regex(cells, number), cells, None)
        if self.layout.decimal == ",":
            cells = compute.replace_substring(cells, ",", ".")
        cells = compute.replace_substring_regex(cells, r"^\+", "")
        return np.asarray(compute.cast(cells, pa.float64()).to_numpy(), dtype=float)

    def _add_cell_faults(self, name: str, bad: np.ndarray) -> None:
        """Add faults for the first cells of a column that are no numbers."""
        lines, k = self._lines(), self.header.index(name)
        for row in bad[:MAX_FAULTS]:
            line = lines[self.row_number(int(row)) - self.layout.first_row]
            cells = split(text(line), self.layout.delimiter)
            cell = cells[k] if k < len(cells) else ""
            what = "is not a number" if cell.strip() else "is empty"
            shown = repr(cell if len(cell) <= SHOWN else cell[:SHOWN] + "...")
            self.fault(f"{shown} {what}{'; leave out rows without a reading' if row == bad[0] else ''}", name, int(row))
        if len(bad) > MAX_FAULTS:
            self.fault(f"{len(bad) - MAX_FAULTS} more cells are not numbers", name)
