"""Figures, drawn without a display; the only module that imports matplotlib.

Every function draws on a new `Figure` and returns it; `save` and `png` turn one into a file or into bytes.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from energy_opt.files import replacing

DPI = 110
COLOURS = ("#1f5fa8", "#d1691c", "#2e8b57", "#8a3ea8", "#b03030", "#6b6b6b", "#c2a000", "#008b9a", "#e377a2", "#5a3d1e")
GREY = "#7a7a7a"


@dataclass(frozen=True)
class Curve:
    """A named curve: x and y, both (N,)."""

    name: str
    x: np.ndarray
    y: np.ndarray


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
    """The figure as a PNG."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", bbox_inches="tight", pad_inches=0.1)  # legends are beside the axes
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


def curves(axes: Axes, lines: Sequence[Curve], *, legend: bool = True) -> None:
    """Draw curves in the order of `COLOURS`."""
    for k, line in enumerate(lines):
        axes.plot(line.x, line.y, color=COLOURS[k % len(COLOURS)], linewidth=1.4, label=line.name)
    if legend and lines:
        legend_beside(axes, 7)


def legend_beside(axes: Axes, size: int = 8) -> None:
    """The legend to the right of the axes, where it covers nothing."""
    axes.legend(fontsize=size, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)


def bars(axes: Axes, groups: Mapping[str, Mapping[str, float]]) -> None:
    """Horizontal bars: one group of bars per label, one bar in it per name of `groups`."""
    labels = list(dict.fromkeys(label for values in groups.values() for label in values))
    height = 0.8 / max(len(groups), 1)
    for k, (name, values) in enumerate(groups.items()):
        at = np.arange(len(labels)) + (k - (len(groups) - 1) / 2) * height
        axes.barh(at, [values.get(x, 0.0) for x in labels], height, color=COLOURS[k % len(COLOURS)], label=name)
    axes.set_yticks(np.arange(len(labels)), labels, fontsize=8)
    axes.invert_yaxis()
    axes.axvline(0.0, color=GREY, linewidth=0.8)
    if len(groups) > 1:
        legend_beside(axes, 7)


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


def _fractions(
    axes: Axes, time: np.ndarray, values: np.ndarray, bounds: np.ndarray, joints: Sequence[str], legend: bool = True
) -> None:
    """Values (N, n) as fractions of their bounds (n,); joints without a bound are left out."""
    bounded = [j for j in range(len(joints)) if np.isfinite(bounds[j])]
    curves(axes, [Curve(joints[j], time, values[:, j] / bounds[j]) for j in bounded], legend=legend)
    for side in (-1.0, 1.0):
        axes.axhline(side, color=GREY, linestyle="--", linewidth=0.8)


def plot_move(
    time: np.ndarray,
    velocity: np.ndarray,
    effort: np.ndarray,
    power: np.ndarray,
    *,
    joints: Sequence[str],
    velocity_limit: np.ndarray,
    effort_limit: np.ndarray,
    baseline: Curve | None = None,
    by_effect: Mapping[str, Mapping[str, float]] | None = None,
    title: str = "",
) -> Figure:
    """One move: velocity and torque against their limits, power against the baseline's, energy by effect.

    Args:
        time: (N,) s; velocity, effort: (N, n) rad/s, N m; power: (N,) W.
        velocity_limit, effort_limit: (n,), inf where there is none.
        baseline: power over time of the move to compare with.
        by_effect: energy by effect [J] of each move that is compared, by the move's name.
    """
    figure, axes = new_figure(2, 2)
    alike = bool((np.isfinite(velocity_limit) == np.isfinite(effort_limit)).all())  # one legend is enough for both
    speed = labelled(axes[0, 0], "time [s]", "velocity / limit")
    _fractions(speed, time, velocity, velocity_limit, joints, legend=not alike)
    _fractions(labelled(axes[0, 1], "time [s]", "torque / limit"), time, effort, effort_limit, joints)
    lines = [Curve("result", time, power)] + ([baseline] if baseline is not None else [])
    groups = by_effect or {}
    # the bars show the same names and colours
    curves(labelled(axes[1, 0], "time [s]", "power [W]"), lines, legend=len(groups) < 2)
    bars(labelled(axes[1, 1], "energy [J]", ""), groups)
    if title:
        figure.suptitle(title, fontsize=11)
    return figure


def plot_tradeoff(
    duration: np.ndarray,
    parts: Mapping[str, np.ndarray],
    marks: Mapping[str, tuple[float, float]],
    *,
    fastest: float | None = None,
    infeasible: Sequence[float] = (),
    title: str = "",
) -> Figure:
    """Energy against duration, split into parts that are stacked, with marked optima.

    Args: duration: (N,) s, rising; points without an answer are left out by the caller. parts: energy (N,) [J] by name,
    stacked in this order; the first may be negative, the others are then stacked on it,
            so that the top is always the total.
        marks: named points (duration [s], energy [J]).
        fastest: shortest feasible duration, s; infeasible: durations marked as such.
    """
    figure, grid = new_figure(1, 1, width=8.0, height=4.6)
    axes = labelled(grid[0, 0], "duration [s]", "energy [J]", title)
    below = np.zeros(len(duration))
    for k, (name, value) in enumerate(parts.items()):
        axes.fill_between(duration, below, below + value, color=COLOURS[k % len(COLOURS)], alpha=0.35, label=name)
        below = below + value
    axes.plot(duration, below, "o-", color="black", markersize=3, label="total")
    if len(infeasible):
        axes.plot(infeasible, np.zeros(len(infeasible)), "x", color=COLOURS[4], label="infeasible")
    for k, (name, (x, y)) in enumerate(marks.items()):
        axes.plot([x], [y], "*D^v"[k % 4], color=COLOURS[(k + 5) % len(COLOURS)], markersize=10, label=name)
    if fastest is not None:
        axes.axvline(fastest, color=GREY, linestyle="--", linewidth=0.9, label="fastest")
    legend_beside(axes)
    return figure
