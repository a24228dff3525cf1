"""Reshaping against the plain CasADi script of the same problem (plain.py): time and energy, side by side.

    python benchmarks/reshape.py [--moves 4] [--robots panda ur5] [--out numbers.json]

Both get the same control points, knots, Gauss nodes, limits and duration. The plain script's time is its one solve,
without building the problem. Ours is given twice: the reshaping alone (all starts, refinement, solves that mend
limits), and the whole answer (TOPP-RA, baselines, least-energy retiming, certificates and scores too), with compiled
node functions from a warm cache and without a compiler. Times are CPU times of all threads, so that a busy machine does
not blur them. Starts end when no better answer is to be expected, so it is the time per start that is held to a bound.
Energies are those of the exact laws on a dense grid for both.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import JUDGING, SEARCH, SUITES, Case, cases, clock, finish, robots, table
from plain import plain

from energy_opt.motion import Planner, Settings
from energy_opt.motion.reshape.layout import Shape
from energy_opt.motion.reshape.level import Curve
from energy_opt.motion.reshape.search import trajectory_of
from energy_opt.numerics.bspline import Basis
from energy_opt.power import source_method_2
from energy_opt.robot import Robot

MUST = {"compiled": 60.0, "virtual machine": 10.0}
STARTS = 6  # so many starts were tried always when these bounds were set; now as many as a move needs
JUDGED, BESIDE = 0.25, 1.7  # share of the whole answer that is judging; the whole, in times of the search for the curve
WORSE = 0.001  # of the total
POLICIES = {"compiled": "always", "virtual machine": "never"}
HEADER = ("robot", "move", "T s", "plain s", "reshape s", "whole s", "VM s", "VM whole s", "ratio", "whole", "VM",
          "plain J", "ours J", "worse %", "plain breaks")  # fmt: skip


def measure(planner: Planner, case: Case, repeats: int) -> dict[str, float]:
    """Seconds of reshaping, per start, of judging and of the whole answer, of the quickest of `repeats`; its energy."""
    found = []
    for _ in range(repeats):
        with clock(*SEARCH) as search, clock(*JUDGING) as judging:
            begin = time.process_time()
            answer = planner.solve(case.move)
            found.append((time.process_time() - begin, search.seconds, judging.seconds))
    whole, search_seconds, judging_seconds = min(found)
    return {
        "reshape": search_seconds,
        "starts": answer.solver.starts,
        "start": search_seconds / max(answer.solver.starts, 1),
        "judging": judging_seconds / whole,
        "beside": whole / search_seconds,
        "whole": whole,
        "energy": answer.energy.total,
        "loss": answer.energy.loss,
        "solved": answer.status == "solved",
    }


def compare(robot: Robot, count: int, tolerance: float, repeats: int) -> list[dict[str, Any]]:
    """Every move of the robot's suite by both."""
    model = source_method_2(robot.name)
    planners = {name: Planner(robot, model, Settings(compile=policy)) for name, policy in POLICIES.items()}
    planner = planners["compiled"]
    moves = cases(robot, planner, count)
    for other in planners.values():
        other.solve(moves[0].move)  # builds and compiles; not counted
    shape = Shape(robot.n, Basis(planner.settings.controls))
    rows = []
    for case in moves:
        move = case.move
        assert move.duration is not None
        ours = {name: measure(other, case, repeats) for name, other in planners.items()}
        theirs = plain(robot, model, move.start, move.goal, move.duration, shape.basis, shape.per_span, tolerance)
        curve = Curve(shape, theirs.points, move.duration, np.zeros(0))
        trajectory = trajectory_of(curve, robot.joints)
        scored = planner.score(trajectory)
        rows.append({
            "robot": robot.name, "move": case.name, "duration": move.duration, "ours": ours,
            "plain": {
                "solve": theirs.solve_seconds, "build": theirs.build_seconds, "iterations": theirs.iterations,
                "status": theirs.status, "energy": scored.total, "loss": scored.loss,
                "violation": planner.certify(trajectory).violation,
            },
        })  # fmt: skip
        print(f"{robot.name} {case.name}: done", file=sys.stderr)
    return rows


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Medians of the moves' ratios, and how much worse our energy is in the mean and at worst (of the total)."""
    out = {
        f"{name}, {part}": float(np.median([row["plain"]["solve"] / row["ours"][name][part] for row in rows]))
        for name in POLICIES
        for part in ("start", "reshape", "whole")
    }
    for part in ("starts", "judging", "beside"):
        out[part] = float(np.median([row["ours"]["compiled"][part] for row in rows]))
    worse = [row["ours"]["compiled"]["energy"] / row["plain"]["energy"] - 1 for row in rows]
    return {**out, "worse, mean": float(np.mean(worse)), "worse, worst": max(worse), "moves": len(rows)}


def line(row: dict[str, Any]) -> list[object]:
    """A row of the table."""
    fast, slow, other = row["ours"]["compiled"], row["ours"]["virtual machine"], row["plain"]
    return [
        row["robot"], row["move"], row["duration"], other["solve"], fast["reshape"], fast["whole"], slow["reshape"],
        slow["whole"], other["solve"] / fast["reshape"], other["solve"] / fast["whole"],
        other["solve"] / slow["reshape"], other["energy"], fast["energy"],
        100 * (fast["energy"] / other["energy"] - 1), max(other["violation"], 0.0),
    ]  # fmt: skip


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where a bound is not held."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=20, help="moves of each suite at most (20 panda, 10 ur5)")
    parser.add_argument("--robots", nargs="+", choices=list(SUITES), default=list(SUITES))
    parser.add_argument("--tolerance", type=float, default=1e-6, help="of the plain script's IPOPT (1e-6)")
    parser.add_argument("--repeats", type=int, default=2, help="of our own solves, the quickest counts (2)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the numbers")
    args = parser.parse_args(words)
    rows, found, checks = [], {}, {}
    for robot in robots(args.robots):
        of_robot = compare(robot, args.moves, args.tolerance, args.repeats)
        rows += of_robot
        found[robot.name] = summary(of_robot)
        for name, must in MUST.items():
            ratio = found[robot.name][f"{name}, start"] / STARTS
            checks[f"{robot.name}: {name} {ratio:.0f} times faster at {STARTS} starts, must be {must:.0f}"] = (
                ratio >= must
            )
        share, beside = found[robot.name]["judging"], found[robot.name]["beside"]
        checks[f"{robot.name}: judging takes {share:.2f} of the whole answer, at most {JUDGED}"] = share <= JUDGED
        checks[f"{robot.name}: the whole takes {beside:.2f} times the search, at most {BESIDE}"] = beside <= BESIDE
        worst = found[robot.name]["worse, worst"]
        checks[f"{robot.name}: energy {100 * worst:+.3f} % at worst, at most {100 * WORSE} %"] = worst <= WORSE
    print("\n" + table(HEADER, [line(row) for row in rows]))
    print("\n" + table(("robot", *next(iter(found.values()))), [[name, *x.values()] for name, x in found.items()]))
    return finish({"summary": found, "moves": rows, "tolerance": args.tolerance}, checks, args.out)


if __name__ == "__main__":
    sys.exit(main())
