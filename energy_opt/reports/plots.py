"""Figures, drawn without a display; the only module that imports matplotlib.

Every function draws on a new `Figure` and returns it; `save` and `png` turn one into a file or into bytes.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from energy_opt.files import replacing
from energy_opt.reports.charts import Chart, Line

DPI = 110
COLOURS = ("#1f5fa8", "#d1691c", "#2e8b57", "#8a3ea8", "#b03030", "#6b6b6b", "#c2a000", "#008b9a", "#e377a2", "#5a3d1e")
GREY = "#7a7a7a"


def new_figure(down: int, columns: int, *, width: float = 10.0, height: float = 3.2) -> tuple[Figure, np.ndarray]:
    """A figure of down x columns axes, (down, columns); `width` in inches, `height` of each line.

    Margins are fixed lengths: matplotlib's own layout engines draw everything twice.
    """
    total = height * down
    left, right, bottom, top, gap_x, gap_y = 0.8, 0.2, 0.5, 0.45, 1.3, 0.75  # [inch]
    figure = Figure(figsize=(width, total), dpi=DPI)
    grid = {
        "left": left / width,
        "right": 1 - right / width,
        "bottom": bottom / total,
        "top": 1 - top / total,
        "wspace": gap_x * columns / (width - left - right - gap_x * (columns - 1)),
        "hspace": gap_y * down / (total - bottom - top - gap_y * (down - 1)),
    }
    return figure, figure.subplots(down, columns, squeeze=False, gridspec_kw=grid)


def png(figure: Figure) -> bytes:
    """The figure as a PNG. Characters that the font does not have are drawn as boxes, without a warning."""
    stream, canvas = io.BytesIO(), FigureCanvasAgg(figure)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from")
        around = figure.get_tightbbox(canvas.get_renderer()).padded(0.1)  # [inch] legends are beside the axes
        figure.savefig(stream, format="png", bbox_inches=around)  # "tight" would draw everything twice
    return stream.getvalue()


def save(figure: Figure, path: Path) -> None:
    """Write the figure as a PNG, whole or not at all."""
    with replacing(Path(path)) as aside:
        aside.write_bytes(png(figure))


def labelled(axes: Axes, x: str, y: str, title: str = "") -> Axes:
    """Axes with labels, a title and a light grid."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title:
        axes.set_title(title, fontsize=10, loc="left")
    axes.grid(True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


STYLES = {"dash": "--", "dots": "o-", "points": "o"}  # matplotlib's formats of a chart's lines; others are plain
MARKS = "*D^v"  # symbols of marked points, in turn


def draw(charts: Sequence[Chart], title: str = "") -> Figure:
    """Charts as one figure, two side by side; a role has one colour in all of them."""
    columns = min(len(charts), 2)
    down = -(-len(charts) // columns)
    figure, grid = new_figure(down, columns, width=5.0 + 2.5 * columns, height=4.4 if down == 1 else 3.2)
    for axes in grid.ravel()[len(charts) :]:
        axes.set_visible(False)
    colours: dict[str, str] = {}
    known: set[frozenset[str]] = set()  # names of the legends that are there already
    for axes, chart in reversed(list(zip(grid.ravel(), charts, strict=False))):
        labelled(axes, chart.x, chart.y, chart.title)
        lines(axes, chart.lines, colours)
        bars(axes, chart.bars, colours)
        for value in chart.levels.values():
            axes.axhline(value, color=GREY, linestyle="--", linewidth=0.8)
        for name, value in chart.edges.items():
            axes.axvline(value, color=GREY, linestyle="--", linewidth=0.9, label=name)
        for k, (name, (x, y)) in enumerate(chart.marks.items()):
            axes.plot([x], [y], MARKS[k % len(MARKS)], color=COLOURS[(k + 5) % len(COLOURS)], markersize=10, label=name)
        names = frozenset(axes.get_legend_handles_labels()[1])
        if len(names) > 1 and names not in known:
            axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)  # it covers nothing
            known.add(names)
    if title:
        figure.suptitle(title, fontsize=11)
    return figure


def lines(axes: Axes, given: Sequence[Line], colours: dict[str, str]) -> None:
    """Draw lines; `colours` has the colour of each role, and gets those of new ones."""
    for line in given:
        colour = colours.setdefault(line.role or line.name, COLOURS[len(colours) % len(COLOURS)])
        axes.plot(
            line.x, line.y, STYLES.get(line.style, "-"), color=colour, linewidth=1.4, markersize=3, label=line.name
        )


def bars(axes: Axes, groups: Mapping[str, Mapping[str, float]], colours: dict[str, str]) -> None:
    """Draw horizontal bars: a group of bars per label, in it a bar per name of `groups`; `colours` as of `lines`."""
    if not groups:
        return
    labels = list(dict.fromkeys(label for values in groups.values() for label in values))
    height = 0.8 / len(groups)
    for k, (name, values) in enumerate(groups.items()):
        at = np.arange(len(labels)) + (k - (len(groups) - 1) / 2) * height
        colour = colours.setdefault(name, COLOURS[len(colours) % len(COLOURS)])
        axes.barh(at, [values.get(x, 0.0) for x in labels], height, color=colour, label=name)
    axes.set_yticks(np.arange(len(labels)), labels, fontsize=8)
    axes.invert_yaxis()
    axes.axvline(0.0, color=GREY, linewidth=0.8)


def loss_maps(maps: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]) -> Figure:
    """Losses as colour, by joint: speeds (S,), torques (T,) and losses (T, S) [W]; each map has its own scale."""
    columns = min(len(maps), 4)
    records = -(-len(maps) // columns)
    figure, grid = new_figure(records, columns, width=3.6 * columns, height=2.8)
    for axes in grid.ravel()[len(maps) :]:
        axes.set_visible(False)
    for axes, (name, (speed, torque, loss)) in zip(grid.ravel(), maps.items(), strict=False):
        labelled(axes, "speed [rad/s]", "torque [N m]", name)
        figure.colorbar(axes.contourf(speed, torque, loss, 16, cmap="viridis"), ax=axes, label="loss [W]")
    return figure


def plot_placements(
    x: np.ndarray, y: np.ndarray, energy: np.ndarray, path: Sequence[tuple[float, float]], given: tuple[float, float]
) -> Figure:
    """Energy (P,) [J] of placements (P,) each [m] as colour, nan where out of reach, and the path of the search."""
    figure, grid = new_figure(1, 1, width=7.0, height=5.5)
    axes = labelled(grid[0, 0], "x [m]", "y [m]", "energy of the cycle by the base's place")
    known = np.isfinite(energy)
    if known.any():
        top = float(np.quantile(energy[known], 0.9))  # a few placements at the edge of reach would hide the others
        dots = axes.scatter(x[known], y[known], c=np.minimum(energy[known], top), s=60, cmap="viridis")
        figure.colorbar(dots, ax=axes, label="estimate [J]")
    axes.plot(x[~known], y[~known], "x", color=GREY, markersize=5, label="out of reach")
    axes.plot(*given, "o", color=COLOURS[5], markerfacecolor="none", markersize=11, label="given")
    if path:
        axes.plot(*np.array(path).T, "o-", color=COLOURS[4], linewidth=1.4, markersize=4, label="search")
        axes.plot(*path[-1], "*", color=COLOURS[4], markersize=15, label="answer")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=8)
    return figure
