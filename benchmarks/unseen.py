"""Unseen scenes: MotionBenchMaker's with their objects moved at random, judged by many poses that share no code.

    python benchmarks/unseen.py [--scenes 6] [--seed 1] [--solver ipopt] [--model source-method-2]
        [--clearance 0.002] [--short]

Each object of a scene is moved by up to 4 cm along every axis of the base. Where an end touches something then, another
draw is taken. Each move is answered from start and goal alone at 1.5 times the least time on its first path. Seconds
are CPU times of one thread. `--short` solves each move again with searches that end as early as they once did (30
iterations, or a change of 4e-4), and prints how much more loss that takes.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from statistics import fmean, median
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml
from cells_work import MBM, SLOWER, judged, problems, seen
from common import finish, table

import energy_opt as eo
from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene_files import read_scene
from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Planner
from energy_opt.motion.plan import clear
from energy_opt.power import source_method_2

SHORT = {"ITERATIONS": 30, "DONE": 4e-4}  # of searches beside bodies
FAR, DRAWS = 0.04, 20  # [m] that objects are moved by at most; draws until both ends are free


def moved(scene: Path, shift: np.random.Generator, out: Path) -> Path:
    """The scene with every object moved."""
    document = yaml.safe_load(scene.read_text())
    for thing in document["world"]["collision_objects"]:
        by = shift.uniform(-FAR, FAR, 3)
        poses = [thing["pose"]] if "pose" in thing else []
        poses = poses or [*thing.get("primitive_poses", []), *thing.get("mesh_poses", [])]
        for pose in poses:
            at = pose["position"]
            if isinstance(at, dict):
                pose["position"] = {axis: float(at[axis] + d) for axis, d in zip("xyz", by, strict=True)}
            else:
                pose["position"] = [float(x + d) for x, d in zip(at, by, strict=True)]
    out.write_text(yaml.safe_dump(document))
    return out


def main() -> int:
    """Run and print; 1 where an answer touches something."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=6, metavar="N", help="above 17, each is drawn again (6)")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    parser.add_argument("--solver", default="ipopt")
    parser.add_argument("--model", help="power model (the mean of source-method-2 and careful, the default)")
    parser.add_argument("--clearance", type=float, default=0.002, metavar="M", help="smallest distance (0.002 m)")
    parser.add_argument("--short", action="store_true", help="also solve with short searches")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the numbers as JSON")
    args = parser.parse_args()
    rng, rows, planners = np.random.default_rng(args.seed), list[dict[str, Any]](), dict[str, Planner]()
    known = [problem for problem in problems(None) if problem.kind == "mbm"]
    with tempfile.TemporaryDirectory() as folder:
        for number in range(args.scenes):
            if number % len(known) == 0:
                order = rng.permutation(len(known))
            problem = known[order[number % len(known)]]
            robot, ends = problem.robot, (problem.start, problem.goal)
            planner = planners.setdefault(robot.name, Planner(robot, source_method_2(robot.name)))
            for _ in range(DRAWS):
                scene = moved(MBM / "scenes" / f"{problem.name}.yaml", rng, Path(folder) / "scene.yaml")
                cell = Cell(robot, CellRequest(clearance=args.clearance), read_scene(scene))
                if all(cell.touching(q) is None for q in ends):
                    break
            else:
                continue
            row: dict[str, Any] = {"scene": problem.name}
            try:
                duration = SLOWER * planner.around(cell).minimum_time(Move(*ends))
                asked: dict[str, Any] = {"start": ends[0], "goal": ends[1], "scene": str(scene), "duration": duration}
                asked |= {"solver": args.solver, "model": args.model or (), "clearance": args.clearance}
                begin = time.process_time()
                result = eo.optimize(robot, **asked)
            except Infeasible as error:
                rows.append({**row, "status": f"infeasible: {error}"[:60], "touching": 0})
                continue
            row |= {"seconds": time.process_time() - begin, "status": result.status, "chosen": result.chosen}
            row |= {"verdict": judged(cell, result.trajectory)[0], "touching": seen(robot, scene, result.trajectory)}
            row["saved"] = (result.saving or {}).get("loss_percent")
            if args.short:
                with patch.multiple(clear, **SHORT), suppress(Infeasible):
                    row["short: loss %"] = 100 * (eo.optimize(robot, **asked).energy.loss / result.energy.loss - 1)
            rows.append(row)
            print(row, flush=True)
    columns = ("scene", "status", "chosen", "seconds", "saved", "verdict", "touching", *["short: loss %"] * args.short)
    print(table(list(columns), [[row.get(name, "-") for name in columns] for row in rows]))
    solved = [row for row in rows if row["status"] == "solved"]
    if solved:
        print(f"{len(solved)} of {len(rows)} solved; {median(row['seconds'] for row in solved):.2f} s median")
    if solved and args.short:
        more = [row["short: loss %"] for row in solved if "short: loss %" in row]
        print(f"short searches solve {len(more)} of these, with {fmean(more):+.2f} % loss in the mean,")
        print(f"  {min(more):+.2f} to {max(more):+.2f} %")
    checks = {"no answer called solved touches anything": all(r["touching"] == 0 for r in solved)}
    checks["every answer called solved is proven"] = all(row["verdict"] == "proven" for row in solved)
    return finish({"rows": rows}, checks, args.out)


if __name__ == "__main__":
    sys.exit(main())
