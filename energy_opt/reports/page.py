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
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import write_text

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
        self._charts: list[dict[str, Any]] = []
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

    def warning(self, text: str) -> Report:
        """Add a highlighted paragraph."""
        return self._add(f'<p class="warning">{html.escape(text)}</p>')

    def code(self, text: str) -> Report:
        """Add preformatted text."""
        return self._add(f"<pre>{html.escape(text)}</pre>")

    def numbers(self, values: Mapping[str, str]) -> Report:
        """Add the main numbers as large figures, value (with its unit) by name."""
        cells = "".join(
            f"<div><b>{html.escape(value)}</b><span>{html.escape(name)}</span></div>" for name, value in values.items()
        )
        return self._add(f'<div class="numbers">{cells}</div>')

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

    def facts(self, values: Mapping[str, Any]) -> Report:
        """Add a table of names and values; names without a value are left out."""
        records = "".join(
            f"<tr><td>{html.escape(str(name))}</td><td>{html.escape(shown(value))}</td></tr>\n"
            for name, value in values.items()
            if value is not None
        )
        return self._add(f'<div class="wide"><table class="facts">\n{records}</table></div>') if records else self

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
            self._charts.append(chart.data())
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
        data = json.dumps({"charts": self._charts, "player": self._player}, allow_nan=False)
        held = {"data": packed(data)}
        if self._charts:
            held["plotly"] = plotly()
        if self._player is not None:
            held["three"] = three()
        parts = [f'<script type="application/gzip" id="held-{name}">{text}</script>' for name, text in held.items()]
        own = [asset(name) for name in ("charts.js", "player.js", "page.js")]
        return "\n".join([*parts, *(f"<script>\n{text}</script>" for text in own)]) + "\n"

    def write(self, path: Path) -> None:
        """Write the document, whole or not at all."""
        write_text(path, self.html())

    def _add(self, part: str) -> Report:
        self._parts.append(part)
        return self


MOST_POINTS = 1500  # most points of one line: more than a screen has columns; a page stays small and quick


@dataclass(frozen=True)
class Line:
    """A named line or cloud of points: x and y, both (N,).

    Attributes:
        style: "line", "dash", "dots" (a line with its points), "points" or "faint" (thin and grey, behind the others).
        role: lines of one role share a colour on every plot of a page ("result", "scaled", "measured", a joint's name).
        low, high: (N,) edges of a band around it, if any.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    style: str = "line"
    role: str = ""
    low: np.ndarray | None = None
    high: np.ndarray | None = None


@dataclass(frozen=True)
class Block:
    """A bar along a chart's time: its lane, its name, start and duration [s], and its kind, which has a colour."""

    lane: str
    name: str
    start: float
    duration: float
    kind: str


@dataclass(frozen=True)
class Chart:
    """One pair of axes.

    Attributes:
        x, y: labels with units.
        lines: drawn in this order.
        levels: horizontal lines, value by name, for bounds.
        timed: x is the motion's time [s]: its cursor follows the moving arm, and the arm follows it.
        marks: single points (x, y) by name.
        bars: instead of lines, by group the value of each label.
        stacked: bars of one label stand on each other instead of side by side.
        spread: instead of lines, by name the values (N,) whose spread is shown; each is a point.
        blocks: instead of lines, bars along the time in lanes, as of a Gantt chart.
        waterfall: instead of lines, values by name: the first one, what each next one changes, and what is left.
    """

    title: str
    x: str
    y: str
    lines: Sequence[Line] = ()
    levels: Mapping[str, float] = field(default_factory=dict)
    timed: bool = False
    marks: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    bars: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    stacked: bool = False
    spread: Mapping[str, np.ndarray] = field(default_factory=dict)
    blocks: Sequence[Block] = ()
    waterfall: Sequence[tuple[str, float]] = ()

    @property
    def empty(self) -> bool:
        """True if there is nothing to draw."""
        others = any(self.bars.values()) or self.spread or self.blocks or self.waterfall
        return not (any(len(line.x) for line in self.lines) or others)

    def data(self) -> dict[str, Any]:
        """Data for the page's script."""
        levels = {name: value for name, value in self.levels.items() if np.isfinite(value)}
        own = {"levels": levels, "lines": list(map(_line, self.lines)), "blocks": list(map(asdict, self.blocks))}
        return dict(rounded({**vars(self), **own}))


def _line(line: Line) -> dict[str, Any]:
    """A line for the page's script, thinned to MOST_POINTS."""
    keep = thinned(len(line.x))
    out: dict[str, Any] = {"name": line.name, "style": line.style, "role": line.role or line.name}
    for name in ("x", "y", "low", "high"):
        values = getattr(line, name)
        if values is not None:
            out[name] = np.asarray(values, dtype=float)[keep]
    return out


def thinned(count: int, most: int = MOST_POINTS) -> np.ndarray:
    """Indices (K,) of at most `most` of `count` points, the first and the last among them."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


def rounded(value: Any, digits: int = 6) -> Any:
    """A value for a page's script: numbers at any depth with six significant digits, more than a plot shows.

    A number that is not finite becomes None.
    """
    if isinstance(value, Mapping):
        return {key: rounded(item, digits) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [rounded(item, digits) for item in value]
    if value is None or isinstance(value, (str, bool)):
        return value
    return float(f"{value:.{digits}g}") if math.isfinite(value) else None
