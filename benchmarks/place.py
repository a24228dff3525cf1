"""Placements of a base against a grid: the same job at every placement of a grid, and by the search.

    python benchmarks/place.py [--jobs 2] [--grid 10 10 2] [--starts 1] [--keep rows.jsonl] [--out FILE]

The jobs have poses of the tool with a free turn. At every placement of the grid the cycle is solved roughly: from the
joint positions that the search would choose there, and from those and the motions of the best neighbour before it; the
cheaper one counts. The grid's best three are solved in full: the least of these is what the search is compared with.
Placements at which the search solves a cycle, roughly or in full, are counted against the grid's. Poses are judged by
Pinocchio from the URDF. Differences are compared with the losses, as most of the energy is standby that no placement
changes. Seconds are CPU times. What was kept is not solved again.
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
from energy_opt.front.models import rivals_from
from energy_opt.jobs.file import load_job
from energy_opt.motion import Settings
from energy_opt.placement import PlaceRequest, place
from energy_opt.placement.base_search import Search
from energy_opt.robot import load_robot

CONFIRMED = 3  # placements of the grid that are solved in full
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
        model = rivals_from([MODEL], None, job.robot)[0][0].model

        search = kept(f"{name}: search", partial(searched, job, model, settings))
        axes = [np.linspace(BOX[2 * k], BOX[2 * k + 1], args.grid[k]) for k in range(3)]
        slices = [kept(f"{name}: x = {x:.6g}", partial(sliced, job, model, settings, x, *axes[1:])) for x in axes[0]]
        rough = [at for row in slices for at in row["found"]]
        best = sorted((at for at in rough if at["ends"]), key=lambda at: at["energy"])[:CONFIRMED]
        full = [kept(f"{name}: {at['at']}", partial(confirmed, job, model, settings, at)) for at in best]
        least = min((row for row in full if row["energy"] is not None), key=lambda row: row["energy"])
        most = max(at["energy"] for at in rough if at["ends"])
        row = {"job": name, "grid": len(rough), "least": least["energy"], "losses": least["losses"], "most": most,
               **search, "grid_seconds": sum(row["seconds"] for row in (*slices, *full))}  # fmt: skip
        rows.append(row)
        lines.append([name, len(rough), row["least"], most, row["energy"], row["given"], row["losses"], row["solves"],
                      row["seconds"], row["grid_seconds"]])  # fmt: skip
    header = ["job", "grid", "least [J]", "most [J]", "search [J]", "given [J]", "losses [J]", "solves", "CPU [s]",
              "grid's CPU [s]"]  # fmt: skip
    print(table(header, lines))
    checks = {
        "within 1 % of the losses of the grid's least": all(
            r["energy"] <= r["least"] + 0.01 * r["losses"] for r in rows
        ),
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


def sliced(job: Any, model: Any, settings: Settings, x: float, across: np.ndarray, up: np.ndarray) -> dict[str, Any]:
    """Rough cycles at all placements of the grid with the same x [m]; without `ends` where none was found."""
    begin, search, known = time.process_time(), searching(job, model, settings), {}
    for (j, y), (k, z) in product(enumerate(across), enumerate(up)):
        point = np.array([x, y, z, 0.0])
        found = [search.settled(point, "grid")]
        near = [known[at] for at in ((j - 1, k), (j, k - 1)) if at in known and known[at].plan is not None]
        if near:
            least = min(near, key=lambda at: at.energy)
            ends = search.ends_at(point, least.ends)
            found += [] if ends is None else [search.settled(point, "grid", least, ends)]
        known[j, k] = min(found, key=lambda at: at.energy)
    rows = [
        {"at": at.point.tolist(), "energy": at.energy, "ends": {k: q.tolist() for k, q in at.ends.items()}
         if at.plan is not None else {}} for at in known.values()
    ]  # fmt: skip
    return {"found": rows, "seconds": time.process_time() - begin}


def searching(job: Any, model: Any, settings: Settings) -> Search:
    """A search that only looks where it is asked to."""
    return Search(job, model, PlaceRequest(BOX), settings, CellRequest(), lambda: False, lambda text, share: None)


def confirmed(job: Any, model: Any, settings: Settings, at: dict[str, Any]) -> dict[str, Any]:
    """A placement of the grid solved in full; its energy [J] is None where the job cannot be done."""
    begin = time.process_time()
    ends = {int(k): np.array(q) for k, q in at["ends"].items()}
    found = searching(job, model, settings).solve(np.array(at["at"]), "grid", ends)
    losses = None if found is None else sum(answer.energy.loss for answer in found.plan.answers)
    energy = None if found is None or not found.solved else found.energy
    return {"energy": energy, "losses": losses, "seconds": time.process_time() - begin}


if __name__ == "__main__":
    sys.exit(main())
