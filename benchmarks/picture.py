"""The picture in README: its first command's move at six instants, beside the same move slowed evenly, and their power.

python benchmarks/picture.py docs/panda_reshape.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import energy_opt as eo
from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.reports import plots
from energy_opt.reports.solids import triangles_at

START = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
GOAL = [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]
TABLE = 0.0  # [m] height of the table that the arm stands on
INSTANTS = 6


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
        power.append(plots.Curve(name, trajectory.time, trajectory.power))
    plots.save(plots.film(strips, power=power), Path(path))


if __name__ == "__main__":
    main(sys.argv[1])
