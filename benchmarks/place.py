"""Placements of a base against a grid: the same job solved at every placement of a grid, and by the search.

    python benchmarks/place.py [--jobs 2] [--grid 10 10 2] [--starts 1] [--keep rows.jsonl] [--out FILE]

The jobs have poses of the tool with a free turn; at every placement of the grid their joint positions are chosen as the
search chooses them, and the whole cycle is solved. The search's own solves are counted against the grid's. The answer's
poses are judged by Pinocchio from the URDF. Seconds are CPU times. A placement that was kept is not solved again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from common import finish, table
from poses import placed

from energy_opt.cell.request import CellRequest
from energy_opt.errors import Infeasible
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
pose = [0.45, 0.2, 0.1, 3.14159265, 0, 0]
free = ["rz"]
[[step]]
pose = [-0.2, 0.5, 0.2, 3.14159265, 0, 0]
free = ["rz"]
payload = 1.0
""",
    "panda, two poses": """
format = "energy-opt/job/1"
robot = "panda"
cycle_time = 4.0
[[step]]
pose = [0.5, 0.2, 0.2, 3.14159265, 0, 0]
free = ["rz"]
[[step]]
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
    kept: dict[str, Any] = {}
    if args.keep is not None and args.keep.is_file():
        kept = {row["key"]: row for row in map(json.loads, args.keep.read_text().splitlines())}
    settings, lines, rows = Settings(starts=args.starts), [], []
    for name, text in list(JOBS.items())[: args.jobs]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "job.toml"
            path.write_text(text)
            job = load_job(path, load_robot)
        model = rivals_from([MODEL], None, job.robot, None)[0][0].model

        def keep(key: str, found: dict[str, Any]) -> dict[str, Any]:
            row = {"key": key, **found}
            kept[key] = row
            print(json.dumps(row), flush=True)
            if args.keep is not None:
                with args.keep.open("a") as stream:
                    stream.write(json.dumps(row) + "\n")
            return row

        key = f"{name}: search"
        if key not in kept:
            begin = time.process_time()
            found = place(job, model, PlaceRequest(BOX), settings=settings)
            document = found.document()
            keep(key, {
                "base": document["base"], "energy": document["energy_total"], "solves": document["solves"],
                "given": document["given"]["energy_total"], "seconds": time.process_time() - begin,
                "missed": missed(job, found.place, document["goals"]), "status": document["status"],
            })  # fmt: skip
        grid = []
        axes = [np.linspace(BOX[2 * k], BOX[2 * k + 1], args.grid[k]) for k in range(3)]
        for x, y, z in product(*axes):
            key = f"{name}: {x:.6g} {y:.6g} {z:.6g}"
            if key not in kept:
                begin = time.process_time()
                base = (float(x), float(y), float(z), 0.0, 0.0, 0.0)
                try:
                    energy = place_at(job, model, settings, base)
                except Infeasible:
                    energy = None
                keep(key, {"energy": energy, "seconds": time.process_time() - begin})
            grid.append(kept[key])
        search = kept[f"{name}: search"]
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


def place_at(job: Any, model: Any, settings: Settings, base: tuple[float, ...]) -> float:
    """Energy of the job [J] at one placement."""
    box = PlaceRequest((base[0], base[0], base[1], base[1], base[2], base[2]))
    search = Search(job, model, box, settings, CellRequest(), lambda: False, lambda text, share: None)
    found = search.solve(np.array([*base[:3], base[5]]), "grid")
    if found is None:
        raise Infeasible("not at this placement")
    return found.energy


if __name__ == "__main__":
    sys.exit(main())
