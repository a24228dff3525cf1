"""A small HTML report in one file: headings, text, tables and pictures, with nothing to load from elsewhere."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.files import write_text

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 70em; padding: 0 1em; color: #222; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 1.8em; border-bottom: 1px solid #ccc; }
table { border-collapse: collapse; margin: 0.8em 0; font-variant-numeric: tabular-nums; }
th, td { padding: 0.2em 0.8em; text-align: right; border-bottom: 1px solid #e4e4e4; }
th:first-child, td:first-child { text-align: left; } th { background: #f3f3f3; }
img { max-width: 100%; } pre { background: #f6f6f6; padding: 0.6em; overflow-x: auto; }
.warning { background: #fff4d6; padding: 0.4em 0.8em; border-left: 4px solid #e0a800; }
"""


def shown(value: Any, digits: int = 4) -> str:
    """A value as text: numbers with `digits` significant digits, None and NaN as a dash, lists joined by commas."""
    if value is None or (isinstance(value, (float, np.floating)) and math.isnan(value)):
        return "-"
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return f"{float(value):.{digits}g}"
    if isinstance(value, (list, tuple, np.ndarray)):
        return ", ".join(shown(item, digits) for item in value)
    return str(value)


class Report:
    """A report that grows section by section; every method but `write` and `html` returns the report itself.

    All text is escaped, so names out of users' files cannot become markup.

    >>> Report("A move").table(["effect", "J"], [["copper <loss>", 3.14159]]).html().count("&lt;loss&gt;")
    1
    """

    def __init__(self, title: str) -> None:
        self.title = title
        self._parts: list[str] = []

    def section(self, title: str) -> Report:
        """Begin a section."""
        return self._add(f"<h2>{html.escape(title)}</h2>")

    def text(self, text: str) -> Report:
        """Add a paragraph."""
        return self._add(f"<p>{html.escape(text)}</p>")

    def warning(self, text: str) -> Report:
        """Add a paragraph that stands out."""
        return self._add(f'<p class="warning">{html.escape(text)}</p>')

    def code(self, text: str) -> Report:
        """Add preformatted text."""
        return self._add(f"<pre>{html.escape(text)}</pre>")

    def table(self, header: Sequence[str], rows: Sequence[Sequence[Any]], digits: int = 4) -> Report:
        """Add a table; each cell is written by `shown`."""
        head = "".join(f"<th>{html.escape(str(cell))}</th>" for cell in header)
        body = "".join(
            "<tr>" + "".join(f"<td>{html.escape(shown(cell, digits))}</td>" for cell in row) + "</tr>\n" for row in rows
        )
        return self._add(f"<table>\n<tr>{head}</tr>\n{body}</table>")

    def facts(self, values: Mapping[str, Any], digits: int = 4) -> Report:
        """Add a table of names and values."""
        rows = "".join(
            f"<tr><td>{html.escape(str(name))}</td><td>{html.escape(shown(value, digits))}</td></tr>\n"
            for name, value in values.items()
        )
        return self._add(f"<table>\n{rows}</table>")

    def picture(self, png: bytes, caption: str = "") -> Report:
        """Add a PNG (see `plots.png`), embedded."""
        data = base64.b64encode(png).decode("ascii")
        self._add(f'<img alt="{html.escape(caption)}" src="data:image/png;base64,{data}">')
        return self.text(caption) if caption else self

    def html(self) -> str:
        """The whole document."""
        title = html.escape(self.title)
        head = f'<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{title}</title>'
        body = "\n".join(self._parts)
        return f"{head}\n<style>{_STYLE}</style></head>\n<body>\n<h1>{title}</h1>\n{body}\n</body>\n</html>\n"

    def write(self, path: Path) -> None:
        """Write the document, whole or not at all."""
        write_text(path, self.html())

    def _add(self, part: str) -> Report:
        self._parts.append(part)
        return self
