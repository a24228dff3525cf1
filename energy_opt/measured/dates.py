"""Cells as numbers: what counts as one, decimal commas, and stamps that are dates or times of day."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

NUMBER = r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?"
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


def date_form(cell: str) -> re.Pattern[str] | None:
    """The form of a date or time of day, None where the cell is none."""
    return next((form for form in DATES if form.fullmatch(cell)), None)


def seconds(cells: Any, form: re.Pattern[str]) -> np.ndarray:
    """Date-times of one form (a text array of pyarrow, N) as seconds (N,): since 1970, or midnight; nan where unread.

    A time of day that runs over midnight goes on counting.
    """
    import pyarrow as pa
    import pyarrow.compute as compute

    pattern = "^" + form.pattern.replace("(?:", "(") + "$"  # RE2 names its groups alike
    parts = compute.extract_regex(cells, pattern=_plain_groups(pattern))
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
    months = (year - 1970) * 12 + np.clip(month, 1, 12) - 1
    days = months.astype("datetime64[M]").astype("datetime64[D]").astype(float) + day - 1
    return out + DAY * days - _zone(compute.struct_field(parts, "zone"))


def _plain_groups(pattern: str) -> str:
    return re.sub(r"\((?!\?P<)", "(?:", pattern)


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
