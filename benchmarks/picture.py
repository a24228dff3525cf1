"""The picture in README: its first command's move at six instants, beside the same move slowed evenly, and their power.

python benchmarks/picture.py docs/panda_reshape.png
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

import energy_opt as eo
from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.reports import plots
from energy_opt.reports.charts import Line
from energy_opt.reports.motion import drawn
from energy_opt.robot.kinematics import Kinematics

START = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
GOAL = [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]
TABLE = 0.0  # [m] height of the table that the arm stands on
INSTANTS = 6
_LIGHT = np.array([0.35, -0.5, 0.79])  # where the light of `film` comes from


def main(path: str) -> None:
    robot, request = eo.load_robot("panda"), CellRequest(floor=TABLE)
    result = eo.optimize(robot, start=START, goal=GOAL, duration=2.0, cell=request)
    print(result)
    for row in result.models:
        print(row)
    slowed = result.baseline("scaled")
    assert slowed is not None and result.status == "solved"
    cell = Cell(robot, request)
    strips, power = {}, []
    for name, trajectory in (("reshaped", result.trajectory), ("slowed evenly", slowed.trajectory)):
        times = np.linspace(0, trajectory.duration, INSTANTS)
        strips[name] = times, triangles_at(cell, trajectory.sample(times)[0])
        power.append(Line(name, trajectory.time, trajectory.power))
    plots.save(film(strips, power=power), Path(path))


def triangles_at(cell: Cell, q: np.ndarray) -> list[np.ndarray]:
    """The arm, with what it carries, at positions q (K, n): triangles (F, 3, 3) [m] in the base frame at each."""
    arm, _ = drawn(cell)
    poses = Kinematics(cell.robot.body.tree())(q)
    out = []
    for k in range(len(q)):
        parts = [s.vertices @ poses.rotation[k, s.joint].T + poses.origin[k, s.joint] for s in arm]
        faces = [s.triangles for s in arm]
        out.append(np.concatenate([points[face] for points, face in zip(parts, faces, strict=True)]))
    return out


def film(
    strips: Mapping[str, tuple[np.ndarray, Sequence[np.ndarray]]],
    *,
    power: Sequence[Line] = (),
    view: tuple[float, float] = (-50.0, 22.0),
    title: str = "",
) -> Figure:
    """An arm at several instants, a row of pictures a motion, and below them power over time.

    Args:
        strips: by the motion's name, the instants (K,) [s] and at each the triangles (F, 3, 3) [m] to draw.
        view: azimuth and elevation from which it is seen, degrees.
    """
    rows, columns = len(strips), max(len(times) for times, _ in strips.values())
    figure = Figure(figsize=(10.0, 2.3 * rows + (2.6 if power else 0.3)), dpi=plots.DPI)
    grid = figure.add_gridspec(
        rows + bool(power), columns, hspace=0.05, wspace=0.0, height_ratios=[1.0] * rows + [0.9] * bool(power)
    )
    away, right, up = _axes_of_view(*np.radians(view))
    flat = [np.concatenate(list(triangles)) @ np.stack([right, up]).T for _, triangles in strips.values()]
    low, high = (f(np.concatenate(flat).reshape(-1, 2), axis=0) for f in (np.min, np.max))
    for row, (name, (times, frames)) in enumerate(strips.items()):
        for column, (time, triangles) in enumerate(zip(times, frames, strict=True)):
            axes = figure.add_subplot(grid[row, column])
            order = np.argsort((triangles @ away).mean(axis=1))
            normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
            normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
            light = 0.45 + 0.55 * np.abs(normal @ _LIGHT)
            shades = np.clip(light[:, None] * np.array(_rgb(plots.COLOURS[row % len(plots.COLOURS)])) + 0.12, 0, 1)
            polygons = triangles @ np.stack([right, up]).T
            axes.add_collection(PolyCollection(polygons[order], facecolors=shades[order], edgecolors="none"))
            axes.set_xlim(low[0], high[0])
            axes.set_ylim(low[1], high[1])
            axes.set_aspect("equal")
            axes.axis("off")
            axes.text(0.5, 0.0, f"{time:.2f} s", transform=axes.transAxes, ha="center", fontsize=8, color=plots.GREY)
            if column == 0:
                axes.text(0.0, 1.0, name, transform=axes.transAxes, fontsize=10, va="top")
    if power:
        axes = plots.labelled(figure.add_subplot(grid[rows, :]), "time [s]", "power [W]")
        plots.lines(axes, power, {})
        axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    figure.subplots_adjust(
        left=0.08, right=0.86 if power else 0.98, top=0.93 if title else 0.98, bottom=0.12 if power else 0.02
    )
    if title:
        figure.suptitle(title, fontsize=11)
    return figure


def _axes_of_view(azimuth: float, elevation: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors towards the viewer, to the right and up in the picture."""
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return towards, right, np.cross(towards, right)


def _rgb(colour: str) -> tuple[float, float, float]:
    r, g, b = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return r, g, b


if __name__ == "__main__":
    main(sys.argv[1])
