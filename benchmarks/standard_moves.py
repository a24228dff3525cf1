"""Standard moves against the continuous optimum: how much of its saving of loss a few joint moves keep.

    python benchmarks/standard_moves.py [--moves 20] [--robots panda ur5] [--vias 2] [--body] [--out numbers.json]

Every move of the suites at 1.5 times its minimum time, default settings, the source model. For each number of via
points from 0 on: the best joint moves with one speed and one acceleration each, blended at the via points, within the
same limits and the same time. `kept` is (scaled - moves) / (scaled - optimum), in loss. With --body the arm keeps clear
of itself, each answer is proven, and moves whose evenly slowed straight line touches something are left out.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import SUITES, cases, finish, robots, table

from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import Infeasible
from energy_opt.motion import Planner, Settings
from energy_opt.power import source_method_2
from energy_opt.profiles import MovesPlanner
from energy_opt.robot import Robot

KEPT = 1 / 3  # of the optimum's saving, with one via point, in the mean over all moves


def measure(robot: Robot, count: int, vias: int, body: bool) -> list[dict[str, Any]]:
    """A row for each move: losses [J], what was saved [%] and the shares kept by 0, 1, ... via points."""
    planner = Planner(robot, source_method_2(robot.name), Settings(compile="always"))
    bodied = Planner(robot, planner.model, planner.settings, cell=load_cell(robot, CellRequest())) if body else planner
    moves = MovesPlanner(bodied)
    rows = []
    for case in cases(robot, planner, count):
        try:
            reference = bodied.solve(case.move)
        except Infeasible as error:
            print(f"{robot.name} {case.name}: left out: {error}", file=sys.stderr)
            continue
        if reference.saving is None:
            print(f"{robot.name} {case.name}: left out: the straight line touches something", file=sys.stderr)
            continue
        row: dict[str, Any] = {
            "robot": robot.name, "move": case.name, "scaled": reference.baseline("scaled").energy.loss,
            "optimum": reference.energy.loss, "saved": reference.saving["loss_percent"],
        }  # fmt: skip
        for k in range(vias + 1):
            begin = time.process_time()
            try:
                found = moves.solve(case.move, reference, k)
                clear = found.certificate.clearance
                row |= {f"proven_{k}": clear is None or clear.proven}
                row |= {f"kept_{k}": found.kept, "kind": found.kind, f"violation_{k}": found.certificate.violation}
            except Infeasible:
                row |= {f"kept_{k}": None, f"violation_{k}": None}
            row[f"seconds_{k}"] = time.process_time() - begin
        rows.append(row)
        print(f"{robot.name} {case.name}: done", file=sys.stderr)
    return rows


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where a bound is not held."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=20, help="moves of each suite at most (20 panda, 10 ur5)")
    parser.add_argument("--robots", nargs="+", choices=list(SUITES), default=list(SUITES))
    parser.add_argument("--vias", type=int, default=2, help="via points at most (2)")
    parser.add_argument("--body", action="store_true", help="the arm keeps clear of itself")
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the numbers")
    args = parser.parse_args(words)
    rows = [row for robot in robots(args.robots) for row in measure(robot, args.moves, args.vias, args.body)]
    kept = [f"kept_{k}" for k in range(args.vias + 1)]
    shown = ("robot", "move", "kind", "scaled", "optimum", "saved", *kept)
    print("\n" + table(shown, [["-" if row.get(key) is None else row[key] for key in shown] for row in rows]))
    for name in dict.fromkeys(row["robot"] for row in rows):
        of_robot = [row for row in rows if row["robot"] == name]
        for k, key in enumerate(kept):
            done = [row[key] for row in of_robot if row[key] is not None]
            seconds = np.mean([row[f"seconds_{k}"] for row in of_robot])
            print(
                f"{name}, {k} via points: {len(done)} of {len(of_robot)} moves, kept {100 * np.mean(done):.1f} % in "
                f"the mean, {100 * min(done):.1f} % at worst; {seconds:.2f} s of processor time a move"
            )
    violations = [row[f"violation_{k}"] or 0.0 for row in rows for k in range(args.vias + 1)]
    proven = all(row.get(f"proven_{k}", True) for row in rows for k in range(args.vias + 1))
    checks = {"every profile within its limits": max(violations) <= 1e-6, "every profile proven clear": proven}
    if args.vias >= 1:
        shares = [row["kept_1"] or 0.0 for row in rows]
        mean = float(np.mean(shares))
        checks[f"one via point keeps {100 * mean:.1f} % in the mean, must be {100 * KEPT:.0f}"] = mean >= KEPT
    return finish({"moves": rows}, checks, args.out)


if __name__ == "__main__":
    sys.exit(main())
