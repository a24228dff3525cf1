"""A report in one HTML file that opens from disk: text, tables, plots and the moving arm; nothing is loaded.

Plots are plain data; the page's script draws them with hover, zoom and joints that are switched on and off.
"""

from __future__ import annotations

import base64
import gzip
import html
import importlib.util
import io
import json
import math
import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, reduce
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import write_text
from energy_opt.reports.charts import Chart

LEVEL = 5  # gzip level: 6 takes a third longer and saves 0.7 % of a page
ASSETS = Path(__file__).parent / "assets"


def packed(text: str | bytes) -> str:
    """Text as base64 of its gzip; the same bytes for the same text."""
    data = text.encode() if isinstance(text, str) else text
    return base64.b64encode(gzip.compress(data, LEVEL, mtime=0)).decode("ascii")


def asset(name: str) -> str:
    """One of the package's own scripts or styles."""
    return (ASSETS / name).read_text(encoding="utf-8")


@cache
def plotly() -> str:
    """plotly.js, packed."""
    return packed((_folder("plotly") / "package_data" / "plotly.min.js").read_bytes())


@cache
def three() -> str:
    """three.js, packed: the part of trimesh's viewer page before that page's own few lines.

    Raises:
        BadInput: the installed trimesh has another page.
    """
    archive = (_folder("trimesh") / "resources" / "templates" / "viewer.zip").read_bytes()
    with zipfile.ZipFile(io.BytesIO(archive)) as file:
        page = file.read("viewer.html.template").decode("utf-8")
    script = max(re.findall(r"<script[^>]*>(.*?)</script>", page, flags=re.DOTALL), key=len)
    library, found, _ = script.partition("var camera,controls")
    if not found:
        raise BadInput("trimesh: unknown viewer page; install trimesh 4")
    return packed(library)


def _folder(package: str) -> Path:
    """Folder of a package, without importing it."""
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise BadInput(f"reports need {package}: pip install {package}")
    return Path(next(iter(spec.submodule_search_locations)))


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
        self._charts: list[Chart] = []
        self._player: dict[str, Any] | None = None

    def section(self, title: str) -> Report:
        """Begin a section."""
        return self._add(f"<h2>{html.escape(title)}</h2>")

    def headline(self, text: str) -> Report:
        """Add the main sentence of the report."""
        return self._add(f'<p class="headline">{html.escape(text)}</p>')

    def text(self, text: str) -> Report:
        """Add a paragraph."""
        return self._add(f"<p>{html.escape(text)}</p>")

    def warning(self, *texts: str) -> Report:
        """Add a highlighted paragraph for each text."""
        for text in texts:
            self._add(f'<p class="warning">{html.escape(text)}</p>')
        return self

    def code(self, text: str) -> Report:
        """Add preformatted text."""
        return self._add(f"<pre>{html.escape(text)}</pre>")

    def numbers(self, values: Mapping[str, str]) -> Report:
        """Add the main numbers as large figures, value (with its unit) by name; nothing without numbers."""
        cells = "".join(
            f"<div><b>{html.escape(value)}</b><span>{html.escape(name)}</span></div>" for name, value in values.items()
        )
        return self._add(f'<div class="numbers">{cells}</div>') if cells else self

    def table(self, header: Sequence[str], records: Sequence[Sequence[Any]], digits: int = 4) -> Report:
        """Add a table; each cell is written by `shown`; a table or a column without a value is left out."""
        kept = [k for k in range(len(header)) if any(row[k] is not None and row[k] != "" for row in records)]
        if not kept:
            return self
        header, records = [header[k] for k in kept], [[row[k] for k in kept] for row in records]
        head = "".join(f"<th>{html.escape(str(cell))}</th>" for cell in header)
        body = "".join(
            "<tr>" + "".join(f"<td>{html.escape(shown(cell, digits))}</td>" for cell in row) + "</tr>\n"
            for row in records
        )
        return self._add(f'<div class="wide"><table>\n<tr>{head}</tr>\n{body}</table></div>')

    def records(self, given: Iterable[Mapping[str, Any]], columns: Mapping[str, str], digits: int = 4) -> Report:
        """Add a table of records.

        Args:
            given: the records. columns: for the head of each column the records' key; `a.b` is key b in the table of a.
            digits: significant ones of numbers.
        """

        def cell(row: Any, key: str) -> Any:
            return reduce(lambda found, part: found.get(part), key.split("."), row)

        return self.table(list(columns), [[cell(row, key) for key in columns.values()] for row in given], digits)

    def facts(self, values: Mapping[str, Any]) -> Report:
        """Add a table of names and values; names without a value are left out."""
        records = "".join(
            f"<tr><td>{html.escape(str(name))}</td><td>{html.escape(shown(value))}</td></tr>\n"
            for name, value in values.items()
            if value is not None
        )
        return self._add(f'<div class="wide"><table class="facts">\n{records}</table></div>') if records else self

    def models(self, title: str, models: Sequence[Mapping[str, Any]] | None, columns: Mapping[str, str]) -> Report:
        """Add a section with a table of energies under further models, if there are any.

        Args:
            models: a record for each, with its name. columns: the record's keys by the heads of their columns.
        """
        if not models:
            return self
        return self.section(title).records(models, {"model": "name", **columns})

    def command(self, request: Mapping[str, Any] | None) -> Report:
        """Add the command line that a request holds, if one does."""
        words = (request or {}).get("command")
        return self.section("Command").code(words) if words else self

    def picture(self, png: bytes, caption: str = "") -> Report:
        """Add a PNG (see `plots.png`), embedded."""
        data = base64.b64encode(png).decode("ascii")
        self._add(f'<img alt="{html.escape(caption)}" src="data:image/png;base64,{data}">')
        return self.text(caption) if caption else self

    def charts(self, *charts: Chart) -> Report:
        """Add plots, side by side where the page is wide enough; those without data are left out."""
        drawn = [chart for chart in charts if not chart.empty]
        places = []
        for chart in drawn:
            places.append(
                f'<figure class="chart" data-chart="{len(self._charts)}"><figcaption>{html.escape(chart.title)}'
                "</figcaption></figure>"
            )
            self._charts.append(chart)
        return self._add(f'<div class="charts">{"".join(places)}</div>') if drawn else self

    def player(self, motion: Mapping[str, Any] | None) -> Report:
        """Add the moving arm (see `motion.player`); the page has room for one."""
        if motion is None:
            return self
        self._player = dict(motion)
        return self._add('<div class="player" id="player"></div>')

    def html(self) -> str:
        """The whole document."""
        title = html.escape(self.title)
        head = (
            '<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{title}</title>\n<style>{asset('page.css')}</style></head>"
        )
        body = "\n".join(self._parts)
        return f"{head}\n<body>\n<h1>{title}</h1>\n{body}\n{self._scripts()}</body>\n</html>\n"

    def _scripts(self) -> str:
        """Packed data and libraries, and the page's own script; empty if there is nothing to draw."""
        if not self._charts and self._player is None:
            return ""
        data = json.dumps({"charts": [chart.data() for chart in self._charts], "player": self._player}, allow_nan=False)
        held = {"data": packed(data)}
        if self._charts:
            held["plotly"] = plotly()
        if self._player is not None:
            held["three"] = three()
        parts = [f'<script type="application/gzip" id="held-{name}">{text}</script>' for name, text in held.items()]
        own = [asset(name) for name in ("charts.js", "player.js", "page.js")]
        return "\n".join([*parts, *(f"<script>\n{text}</script>" for text in own)]) + "\n"

    def write(self, path: Path, plot: Path | None = None) -> None:
        """Write the document, whole or not at all.

        Args:
            plot: the file of a PNG with the charts that are `pictured`, if there are any; None: none is written.
        """
        write_text(path, self.html())
        pictured = [chart for chart in self._charts if chart.pictured]
        if plot is not None and pictured:
            from energy_opt.reports import plots  # slow to import

            plots.save(plots.draw(pictured, self.title), plot)

    def _add(self, part: str) -> Report:
        self._parts.append(part)
        return self
