"""Charts as plain data, which a page's script and `plots` draw."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

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
        edges: vertical lines, x by name.
        timed: x is the motion's time [s]: its cursor follows the moving arm, and the arm follows it.
        marks: single points (x, y) by name.
        bars: instead of lines, by group the value of each label.
        stacked: bars of one label stand on each other instead of side by side.
        spread: instead of lines, by name the values (N,) whose spread is shown; each is a point.
        blocks: instead of lines, bars along the time in lanes, as of a Gantt chart.
        waterfall: instead of lines, values by name: the first one, what each next one changes, and what is left.
        pictured: it is also in the PNG beside the page, where lines, levels, edges, marks and bars are drawn.
    """

    title: str
    x: str
    y: str
    lines: Sequence[Line] = ()
    levels: Mapping[str, float] = field(default_factory=dict)
    edges: Mapping[str, float] = field(default_factory=dict)
    timed: bool = False
    marks: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    bars: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    stacked: bool = False
    spread: Mapping[str, np.ndarray] = field(default_factory=dict)
    blocks: Sequence[Block] = ()
    waterfall: Sequence[tuple[str, float]] = ()
    pictured: bool = False

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
