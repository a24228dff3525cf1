"""Placements of a base against a grid: the same job solved at every placement of a grid, and by the search.

    python benchmarks/place.py [--jobs 2] [--grid 10 10 2] [--starts 1] [--keep rows.jsonl] [--out FILE]

The jobs have poses of the tool with a free turn; at every placement of the grid their joint positions are chosen as the
search chooses them, and the whole cycle is solved. The search's own solves are counted against the grid's. The answer's
poses are judged by Pinocchio from the URDF. Seconds are CPU times. A placement that was kept is not solved again.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from common import Kept, finish, table
from poses import placed

from energy_opt.cell.request import CellRequest
from energy_opt.front.rivals import rivals_from
from energy_opt.jobs import load_job
from energy_opt.motion import Settings
from energy_opt.placement import PlaceRequest, place
from energy_opt.placement.search import Search
from energy_opt.robot import load_robot

MODEL = "source-method-2"
BOX = (-0.2, 0.2, -0.2, 0.2, 0.0, 0.1)
JOBS = {
    "ur5e, two poses": """
format = "energy-opt/job/1"
robot = "ur5e"
cycle_time = 3.0
[[step]]
min_duration = 1.5
max_duration = 1.5
pose = [0.45, 0.2, 0.1, 3.14159265, 0, 0]
free = ["rz"]
[[step]]
min_duration = 1.5
max_duration = 1.5
pose = [-0.2, 0.5, 0.2, 3.14159265, 0, 0]
free = ["rz"]
payload = 1.0
""",
    "panda, two poses": """
format = "energy-opt/job/1"
robot = "panda"
cycle_time = 4.0
[[step]]
min_duration = 2.0
max_duration = 2.0
pose = [0.5, 0.2, 0.2, 3.14159265, 0, 0]
free = ["rz"]
[[step]]
min_duration = 2.0
max_duration = 2.0
pose = [0.3, -0.4, 0.3, 3.14159265, 0, 0]
free = ["rz"]
payload = 1.0
""",
}


def missed(job: Any, base: tuple[float, ...], goals: list[dict[str, Any]]) -> float:
    """The largest distance [m] by which the tool misses the job's poses, which stand in the scene's frame."""
    at = CellRequest(base=base).base_pose
    off = []
    for goal in goals:
        pose = job.steps[goal["step"] - 1].pose
        off.append(np.linalg.norm((at @ placed(job.robot, goal["goal"]))[:3, 3] - pose.matrix[:3, 3]))
    return float(max(off))


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--jobs", type=int, default=len(JOBS))
    parser.add_argument("--grid", type=int, nargs=3, default=(10, 10, 2))
    parser.add_argument("--starts", type=int, default=1)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    kept, settings, lines, rows = Kept(args.keep), Settings(starts=args.starts), [], []
    for name, text in list(JOBS.items())[: args.jobs]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "job.toml"
            path.write_text(text)
            job = load_job(path, load_robot)
        model = rivals_from([MODEL], None, job.robot, None)[0][0].model

        search = kept(f"{name}: search", partial(searched, job, model, settings))
        axes = [np.linspace(BOX[2 * k], BOX[2 * k + 1], args.grid[k]) for k in range(3)]
        grid = [
            kept(f"{name}: {x:.6g} {y:.6g} {z:.6g}", partial(placed_at, job, model, settings, (x, y, z)))
            for x, y, z in product(*axes)
        ]
        known = [row["energy"] for row in grid if row["energy"] is not None]
        row = {"job": name, "grid": len(grid), "least": min(known), "most": max(known), **search,
               "grid_seconds": sum(row["seconds"] for row in grid)}  # fmt: skip
        rows.append(row)
        lines.append([name, len(grid), row["least"], row["most"], row["energy"], row["given"], row["solves"],
                      row["seconds"], row["grid_seconds"]])  # fmt: skip
    header = ["job", "grid", "least [J]", "most [J]", "search [J]", "given [J]", "solves", "CPU [s]", "grid's CPU [s]"]
    print(table(header, lines))
    checks = {
        "within 1 % of the grid's least": all(r["energy"] <= 1.01 * r["least"] for r in rows),
        "poses kept to 2 um by Pinocchio": all(r["missed"] < 2e-6 and r["status"] == "solved" for r in rows),
        "at most 5 % of the grid's solves": all(r["solves"] <= 0.05 * r["grid"] for r in rows),
    }
    return finish({"rows": rows}, checks, args.out)


def searched(job: Any, model: Any, settings: Settings) -> dict[str, Any]:
    """The row of the search."""
    begin = time.process_time()
    found = place(job, model, PlaceRequest(BOX), settings=settings)
    document = found.document()
    return {
        "base": document["base"], "energy": document["energy_total"], "solves": document["solves"],
        "given": document["given"]["energy_total"], "seconds": time.process_time() - begin,
        "missed": missed(job, found.place, document["goals"]), "status": document["status"],
    }  # fmt: skip


def placed_at(job: Any, model: Any, settings: Settings, at: tuple[float, float, float]) -> dict[str, Any]:
    """The row of one placement x, y, z [m] of the base; its energy [J] is None where the job cannot be done."""
    begin = time.process_time()
    box = PlaceRequest((at[0], at[0], at[1], at[1], at[2], at[2]))
    search = Search(job, model, box, settings, CellRequest(), lambda: False, lambda text, share: None)
    found = search.solve(np.array([*at, 0.0]), "grid")
    return {"energy": None if found is None else found.energy, "seconds": time.process_time() - begin}


if __name__ == "__main__":
    sys.exit(main())
