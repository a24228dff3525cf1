"""Plots as plain data; the page's script draws them with hover, zoom and joints that are switched on and off."""

from __future__ import annotations

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
        return {
            "title": self.title,
            "x": self.x,
            "y": self.y,
            "timed": self.timed,
            "stacked": self.stacked,
            "levels": {name: rounded(value) for name, value in self.levels.items() if np.isfinite(value)},
            "marks": {name: [rounded(value) for value in point] for name, point in self.marks.items()},
            "bars": {
                group: {label: rounded(value) for label, value in values.items()} for group, values in self.bars.items()
            },
            "spread": {name: [rounded(value) for value in values] for name, values in self.spread.items()},
            "lines": [_line(line) for line in self.lines],
            "blocks": [{**asdict(b), "start": rounded(b.start), "duration": rounded(b.duration)} for b in self.blocks],
            "waterfall": [[name, rounded(value)] for name, value in self.waterfall],
        }


def _line(line: Line) -> dict[str, Any]:
    """A line for the page's script, thinned to MOST_POINTS."""
    keep = thinned(len(line.x))
    out: dict[str, Any] = {"name": line.name, "style": line.style, "role": line.role or line.name}
    for name in ("x", "y", "low", "high"):
        values = getattr(line, name)
        if values is not None:
            out[name] = [rounded(value) for value in np.asarray(values, dtype=float)[keep]]
    return out


def thinned(count: int, most: int = MOST_POINTS) -> np.ndarray:
    """Indices of at most `most` of `count` points, the first and the last among them."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


def rounded(value: float, digits: int = 6) -> float | None:
    """Six significant digits, more than a plot shows; None if not finite."""
    return float(f"{value:.{digits}g}") if np.isfinite(value) else None
