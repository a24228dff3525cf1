"""How a text table is laid out: encoding, delimiter, decimal sign, header, units below it, first row of data.

Also here: recognition of numbers, also with decimal commas, and of dates and times of day.
"""

from __future__ import annotations

import codecs
import csv
import math
import mmap
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.measured.header import UNITS, known_unit
from energy_opt.schema import Table as Stated

NUMBER = r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?"
_COMMENT = re.compile(rb"(?<![^\r\n])[ \t]*(?:#(?!N/A)|%)[^\r\n]*")  # spreadsheets write #N/A for no value
_NUMBER = re.compile(rf"\s*{NUMBER}\s*")
_CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2}(?:[.,]\d+)?)\s*(?P<half>[AaPp][Mm])?"
_ZONE = r"\s*(?P<zone>[Zz]|[+-]\d{2}:?\d{2})?"
DATES = tuple(
    re.compile(rf"\s*{form}\s*")
    for form in (
        rf"(?P<year>\d{{4}})[-/.:](?P<month>\d{{1,2}})[-/.:](?P<day>\d{{1,2}})[T :_]+{_CLOCK}{_ZONE}",  # ISO 8601
        rf"(?P<day>\d{{1,2}})\.(?P<month>\d{{1,2}})\.(?P<year>\d{{4}})[T ]+{_CLOCK}{_ZONE}",  # 05.10.2021
        rf"(?P<month>\d{{1,2}})/(?P<day>\d{{1,2}})/(?P<year>\d{{4}})[T ]+{_CLOCK}{_ZONE}",  # 10/05/2021
        _CLOCK,
    )
)
DAY = 86400.0  # [s]


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma; an empty cell, nan and inf are none.

    >>> [is_number(x) for x in ("1.5", " 2,5 ", "-1e-3", "nan", "", "3 4")]
    [True, True, True, False, False, False]
    """
    try:
        if math.isfinite(float(cell)) and "_" not in cell:
            return True
    except ValueError:
        pass
    return _NUMBER.fullmatch(cell) is not None  # decimal commas; numbers too large for a float


def _without_comments(content: Any, begin: int) -> tuple[Any, int]:
    """The bytes of a file with empty lines in place of comments from `begin` on, and how many those are."""
    if content.find(b"#", begin) < 0 and content.find(b"%", begin) < 0:
        return content, 0
    data, count = _COMMENT.subn(b"", bytes(content[begin:]))
    return (bytes(content[:begin]) + data, count) if count else (content, 0)


def date_form(cell: str) -> re.Pattern[str] | None:
    """The form of a date or time of day, None for another cell."""
    return next((form for form in DATES if form.fullmatch(cell)), None)


def seconds(cells: Any, form: re.Pattern[str]) -> np.ndarray:
    """Date-times of one form (a text array of pyarrow, N) as seconds (N,): since 1970, or midnight; nan where unread.

    A time of day that runs over midnight goes on counting.
    """
    import pyarrow as pa
    import pyarrow.compute as compute

    pattern = "^" + form.pattern.replace("(?:", "(") + "$"  # RE2 has the same syntax for named groups
    parts = compute.extract_regex(cells, pattern=re.sub(r"\((?!\?P<)", "(?:", pattern))
    fields = {f.name for f in parts.type}

    def number(name: str) -> np.ndarray:
        text = compute.struct_field(parts, name)
        text = compute.replace_substring(compute.if_else(compute.equal(text, ""), "0", text), ",", ".")
        return np.asarray(compute.cast(text, pa.float64()).to_numpy(zero_copy_only=False), dtype=float)

    hour = number("hour")
    if "half" in fields:
        half = compute.utf8_upper(compute.struct_field(parts, "half"))
        late = _mask(compute.equal(half, "PM")), _mask(compute.equal(half, "AM"))
        hour = np.where(late[0], hour % 12 + 12, np.where(late[1], hour % 12, hour))
    out = hour * 3600 + number("minute") * 60 + number("second")
    if "year" not in fields:
        return out + DAY * np.concatenate([[0], np.cumsum(np.diff(out) < -DAY / 2)]) if len(out) else out
    year, month, day = (np.nan_to_num(number(x), nan=1.0).astype(int) for x in ("year", "month", "day"))
    if month.max(initial=1) > 12 >= day.max(initial=1):  # 13/05/2024
        month, day = day, month
    months = (year - 1970) * 12 + np.clip(month, 1, 12) - 1
    days = months.astype("datetime64[M]").astype("datetime64[D]").astype(float) + day - 1
    return out + DAY * days - _zone(compute.struct_field(parts, "zone"))


def _mask(values: Any) -> np.ndarray:
    return np.asarray(values.fill_null(False).to_numpy(zero_copy_only=False), dtype=bool)


def _zone(texts: Any) -> np.ndarray:
    """Seconds that a zone is ahead of UTC, (N,); the few different ones are read one by one."""
    import pyarrow as pa

    coded = (texts.combine_chunks() if isinstance(texts, pa.ChunkedArray) else texts).dictionary_encode()
    if isinstance(coded, pa.ChunkedArray):
        coded = coded.combine_chunks()
    ahead = [0.0]
    for zone in coded.dictionary.to_pylist():
        digits = (zone or "").replace(":", "")[1:]
        sign = -1.0 if (zone or "").startswith("-") else 1.0
        ahead.append(sign * (int(digits[:2]) * 3600 + int(digits[2:]) * 60) if len(digits) == 4 else 0.0)
    index = np.asarray(coded.indices.fill_null(-1).to_numpy(zero_copy_only=False), dtype=int)
    return np.array(ahead)[index + 1]


HEAD = 1 << 18  # [bytes] read to find the layout
SAMPLE = 40  # data lines used to find the layout
DELIMITERS = (",", ";", "\t", "|", " ")
MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
PACKED = {  # first bytes of files that are no tables of text, as patterns
    b"\x1f\x8b": "compressed by gzip; unpack it first",
    rb'\s*(\{\s*"|\[\s*[\[{])': "a JSON file; write its table as CSV first",
    rb"\x93NUMPY|(?s:PK\x03\x04.{26}\w+\.npy)": "a NumPy file; write its arrays as columns of a CSV file first",
    b"PK\x03\x04": "a ZIP archive or an Excel file; unpack it, or save the sheet as CSV",
    b"\xd0\xcf\x11\xe0": "an old Excel file; save the sheet as CSV",
    b"\x89MCAP": "a bag; `energy-opt import` makes tables of it",
    b"SQLite format 3": "a bag or a database; `energy-opt import` makes tables of a bag",
    b"BZh": "compressed by bzip2; unpack it first",
    b"\xfd7zXZ": "compressed by xz; unpack it first",
    b"PAR1": "a Parquet file; write its table as CSV first",
    b"\x89HDF": "an HDF5 or MATLAB file; write its tables as CSV first",
    b"MATLAB 5.0": "a MATLAB file; write its tables as CSV first",
}
UNIT_WORD = re.compile(  # words of a row of units besides those of `header.UNITS`
    r"[\[(<{]?\s*(|-|1|(rad|deg|°|rev|m|mm)\s*[/.]?\s*(s|sec|min)(\^?-?[12]|²|⁻¹|⁻²)?|[mµk]?N\W?m|Ws|kg|K|%|"
    r"bool|int|float|string|text|number|iso|utc|date.*|time|unix|epoch)\s*[\])>}]?",
    re.IGNORECASE,
)


class Csv(Stated):
    """Format of CSV files as stated by a log; None is detected."""

    delimiter: Literal[",", ";", "\t", "|", " "] | None = None
    decimal: Literal[".", ","] | None = None


@dataclass(frozen=True)
class Layout:
    """A text table before its columns are read.

    Attributes:
        names: the header's words. units: the words of a row of units below it, empty where there is none.
        first: where data begin in `content`; first_row: the row (from 1) that is there.
        content: the file's bytes in UTF-8 or another code that has ASCII's delimiters.
        sample: cells of the first data lines. comments: number of lines among the data that were one.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    delimiter: str
    decimal: str
    first: int
    first_row: int
    content: Any
    sample: tuple[tuple[str, ...], ...]
    comments: int


def layout_of(path: Path, given: Csv | None = None) -> Layout:
    """Find the layout of a file.

    Raises:
        BadInput: there is no such file, it is empty or no text, or it has no header.
    """
    given = given or Csv()
    content, skip = _content(path)
    head = bytes(content[skip : skip + HEAD])
    text_lines, starts = _lines(head, len(content) > skip + HEAD)
    if not any(row.strip() for row in text_lines):
        raise BadInput(f"{path}: row 1: no header; expected column names such as time, <joint>.position")
    hint = re.match(r"sep=(.)$", text_lines[0].strip())
    delimiter = given.delimiter or (hint.group(1) if hint else _delimiter(text_lines))
    if delimiter == " " and any("  " in row.strip() for row in text_lines):
        content, skip = re.sub(rb"(?m)^[ ]+|[ ]+(?=\r?$)", b"", re.sub(rb"[ ]{2,}", b" ", bytes(content[skip:]))), 0
        text_lines, starts = _lines(content[:HEAD], len(content) > HEAD)
    cells = [split(row, delimiter) for row in text_lines]
    at = _header(path, cells)
    names = tuple(re.sub(r"^[#%]\s*(?=\w)", "", name.strip()) for name in cells[at])
    _no_nul(path, content, delimiter, names)
    remark = [_COMMENT.match(row.encode(errors="replace")) is not None for row in text_lines]
    body = [k for k in range(at + 1, len(text_lines)) if text_lines[k].strip() and not remark[k]]
    units: tuple[str, ...] = ()
    if body and _is_unit_row(cells[body[0]]):
        units = tuple(cell.strip() for cell in cells[body[0]])
        body = body[1:]
    sample = tuple(tuple(cells[k]) for k in body[:SAMPLE])
    more = min((len(row) for row in sample), default=0) - len(names)
    if more > 0 and not any(cell.strip() for row in sample for cell in row[len(names) :]):
        names += ("",) * more  # a delimiter at the end of each row, but not of the header
    numbers = [cell for k in body for cell in cells[k] if is_number(cell)]
    points, commas = (sum(sign in cell for cell in numbers) for sign in ".,")
    decimal = given.decimal or ("," if commas > points else ".")
    first = body[0] if body else len(text_lines)
    begin = skip + starts[first] if first < len(starts) else len(content)
    content, comments = _without_comments(content, begin)
    return Layout(names, units, delimiter, decimal, begin, first + 1, content, sample, comments)


def _content(path: Path) -> tuple[Any, int]:
    """The file's bytes, memory-mapped if possible, as UTF-8, and the length of a byte order mark to skip."""
    try:
        with Path(path).open("rb") as stream:
            empty = not stream.read(1)
            content: Any = b"" if empty else mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}") from None
    start = bytes(content[:256])
    packed = next((what for mark, what in PACKED.items() if re.match(mark, start)), None)
    if packed is not None:
        raise BadInput(f"{path}: not a table of text: {packed}")
    code = next((name for mark, name in MARKS if start.startswith(mark)), None)
    if code is None and len(start) >= 8:  # UTF-16 without a mark has a NUL in every second byte of ASCII text
        even, odd = start[::2].count(0), start[1::2].count(0)
        if max(even, odd) > 0.4 * len(start) / 2 and min(even, odd) == 0:
            code = "utf-16-be" if even > odd else "utf-16-le"
    skip = len(codecs.BOM_UTF8) if code == "utf-8-sig" else 0
    if code is not None and not skip:
        try:
            return bytes(content).decode(code).encode(), 0
        except UnicodeDecodeError:
            raise BadInput(f"{path}: begins as {code.upper()} text, but a later part is not") from None
    if len(content) and int(np.frombuffer(content, np.uint8).max()) > 127:
        raw = bytes(content)
        try:
            raw.decode()
        except UnicodeDecodeError:
            return text(raw[skip:]).encode(), 0
    return content, skip


def _no_nul(path: Path, content: Any, delimiter: str, names: Sequence[str]) -> None:
    """Refuse NUL bytes: they come from a crash or a full disc while the file was written."""
    at = content.find(b"\0")
    if at >= 0:
        before = bytes(content[:at])
        row, column = before.count(b"\n") + 1, before[before.rfind(b"\n") + 1 :].count(delimiter.encode())
        name = names[column] if column < len(names) else "?"
        raise BadInput(f"{path}: row {row}, column {name}: a NUL byte; the file is damaged or no text")


def text(raw: bytes) -> str:
    """Decode UTF-8, else Windows' Western code with undefined bytes replaced."""
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _lines(head: bytes, cut: bool) -> tuple[list[str], list[int]]:
    """Lines of the head and where each begins; an incomplete last one is left out."""
    text_lines, starts = [], []
    for match in re.finditer(rb"([^\r\n]*)(\r\n|\r|\n|$)", head):
        if match.start() == len(head) or (cut and match.end() == len(head)):
            break
        text_lines.append(match.group(1))
        starts.append(match.start())
    if not text_lines and head:
        text_lines, starts = [head], [0]
    return text(b"\n".join(text_lines)).split("\n") if text_lines else [], starts


def split(row: str, delimiter: str) -> list[str]:
    """The cells of a row; quotation marks hold delimiters."""
    if '"' not in row:
        return row.split(delimiter)
    try:
        return next(csv.reader([row], delimiter=delimiter, skipinitialspace=True), [""])
    except csv.Error:  # a cell larger than the csv module allows
        return row.split(delimiter)


def _is_value(cell: str) -> bool:
    return is_number(cell) or date_form(cell) is not None


def _delimiter(lines: Sequence[str]) -> str:
    """The delimiter that gives most numbers, weighted by the share of cells that are numbers."""
    body = [row for row in lines if row.strip()]
    body = body[1:][-SAMPLE:] or body
    best, score = ",", -1.0
    for delimiter in DELIMITERS:
        parts = [[cell for cell in split(row, delimiter) if delimiter != " " or cell] for row in body]
        counts = [len(cells) for cells in parts]
        usual = max(set(counts), key=counts.count)
        if usual < 2:
            continue
        cells = [cell for row in parts if len(row) == usual for cell in row if cell.strip()]
        numbers = sum(map(_is_value, cells))
        value = numbers**2 / max(len(cells), 1) * counts.count(usual) / len(counts)
        if value > score * (1 + 1e-9):
            best, score = delimiter, value
    return best


def _header(path: Path, cells: Sequence[Sequence[str]]) -> int:
    """The row of the header: the last row of words before the numbers begin, as wide as they are."""
    filled = [k for k, row in enumerate(cells) if any(cell.strip() for cell in row)]
    values = [sum(map(_is_value, row)) for row in cells]
    widths = [len(cells[k]) for k in filled if 2 * values[k] >= len(cells[k])] or [len(cells[filled[0]])]
    width = max(set(widths), key=widths.count)
    notes = [k for k in filled if len(cells[k]) == 1 or cells[k][0].strip().startswith("sep=")]
    words = [k for k in filled if values[k] == 0 and k not in notes and not _is_unit_row(cells[k])]
    wide = [k for k in words if len(cells[k]) == width and sum(bool(c.strip()) for c in cells[k]) > width // 2]
    found = next(iter(wide), next(iter(words), None))
    first = next((k for k in filled if 2 * values[k] > len(cells[k])), None)
    if found is None or (first is not None and found > first):
        row = filled[0]
        if values[row] == 0 or (first is not None and first > row) or values[row] < len(cells[row]) / 2:
            return row
        raise BadInput(
            f"{path}: row {row + 1}: no header, numbers from the first row on; "
            "expected column names such as time, <joint>.position"
        )
    return found


def _is_unit_row(row: Sequence[str]) -> bool:
    """Whether most cells of a row are units and none is a number."""
    words = [cell for cell in row if cell.strip()]
    if not words or any(map(_is_value, words)):
        return False
    return sum(map(_is_unit, words)) > 0.6 * len(words)


def _is_unit(cell: str) -> bool:
    return UNIT_WORD.fullmatch(cell.strip()) is not None or any(known_unit(kind, cell) for kind in UNITS)
