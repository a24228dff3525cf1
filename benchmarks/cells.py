"""Moves among things: how many are solved, proven and how fast, beside OMPL, OMPL smoothed, and Drake.

    python benchmarks/cells.py [--problems N] [--rivals] [--solve] [--out numbers.json]

Problems are MotionBenchMaker's, from the folder of shared data beside the checkout, where that is there, and the moves
of benchmarks/suites/cells.toml. Every trajectory, whoever made it, is judged between its samples by the proof of
clearance. Seconds are CPU times of one thread.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from common import finish, table
from drake_rival import Drake
from ompl_rival import plan

from energy_opt.bench.suite import load_suite
from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene_files import read_scene
from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Planner, Settings, Trajectory
from energy_opt.motion.path import JointPath, through
from energy_opt.motion.plan.context import path_of
from energy_opt.motion.timing.toppra import fastest
from energy_opt.motion.ways.room import Room
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot

MBM = Path(__file__).parents[2] / "shared" / "data" / "mbm"
SUITE = Path(__file__).parent / "suites" / "cells.toml"
SLOWER = 1.5  # durations are this multiple of the fastest on the first path
PLANNING = 10.0  # s that a rival's planner has


@dataclass(frozen=True)
class Problem:
    """A move among things; `given` is a planner's free path, where the problem has one."""

    name: str
    robot: Robot
    cell: Cell
    start: np.ndarray
    goal: np.ndarray
    given: JointPath | None = None


def problems(count: int | None) -> Iterator[Problem]:
    """MotionBenchMaker's, then the suite's."""
    robots: dict[str, Robot] = {}
    rows = json.loads((MBM / "problems.json").read_text())["problems"] if MBM.is_dir() else []
    for row in rows[:count]:
        robot = robots.setdefault(row["robot"], load_robot(row["robot"]))
        scene = read_scene(MBM / "scenes" / f"{row['id']}.yaml")
        start, goal = (np.array(row[end], dtype=float) for end in ("start", "goal"))
        given = through(np.array(row["waypoints"]))
        yield Problem(row["id"], robot, Cell(robot, CellRequest(), scene), start, goal, given)
    known: dict[tuple[str, str], Cell] = {}
    tasks = [task for task in load_suite(SUITE).tasks if not task.payload[0]]
    for task in tasks[:count]:
        robot = robots.setdefault(task.robot.name, task.robot.load())
        key = robot.name, task.surroundings.scene
        known.setdefault(key, task.surroundings.cell(robot))
        name = f"{robot.name} {task.move}"
        yield Problem(name, robot, known[key], np.array(task.start), np.array(task.goal))


def judged(cell: Cell, trajectory: Trajectory | None) -> tuple[str, float]:
    """What the proof says of a trajectory, and how deep it touches [mm]."""
    if trajectory is None:
        return "none", 0.0
    found = cell.prove(trajectory.time, trajectory.position, trajectory.velocity, trajectory.acceleration)
    return found.verdict, 1e3 * (found.depth or 0.0)


def timed(problem: Problem, path: JointPath) -> Trajectory | None:
    """The path timed by TOPP-RA; None where that is not possible."""
    try:
        return fastest(problem.robot, source_method_2(problem.robot.name), path).trajectory(problem.robot.joints)
    except Infeasible:
        return None


def from_ends(problem: Problem) -> dict[str, Any]:
    """A first path from start and goal alone."""
    begin = time.process_time()
    try:
        planner = Planner(problem.robot, source_method_2(problem.robot.name), Settings(ways=1), cell=problem.cell)
        move, source, _ = planner.first_path(Move(problem.start, problem.goal))
    except Infeasible as error:
        return {"source": "none", "seconds": time.process_time() - begin, "message": str(error)}
    seconds = time.process_time() - begin
    verdict, depth = judged(problem.cell, timed(problem, path_of(move)))
    return {"source": source.source, "seconds": seconds, "verdict": verdict, "depth": depth}


def answered(planner: Planner, problem: Problem, given: JointPath | None) -> dict[str, Any]:
    """The whole answer at 1.5 times TOPP-RA's duration on the first path: what it saves, and what judges say of it.

    `work` is the figure that cuRobo calls energy, the integral of sum |tau v|, against that of the path slowed evenly.
    """
    planner.set_cell(problem.cell)
    move = Move(problem.start, problem.goal, path=given)
    begin = time.process_time()
    try:
        move = replace(move, duration=SLOWER * planner.minimum_time(move))
        result = planner.solve(move)
    except Infeasible as error:
        return {"status": "infeasible", "total_seconds": time.process_time() - begin, "message": str(error)}
    scaled = result.baseline("scaled")
    row: dict[str, Any] = {"status": result.status, "total_seconds": time.process_time() - begin}
    row["judged"], _ = judged(problem.cell, result.trajectory)
    if scaled is not None:
        row |= {"loss": result.energy.loss, "loss_scaled": scaled.energy.loss}
        row["saved_percent"] = 100 * (1 - result.energy.loss / scaled.energy.loss)
        row["work"], row["work_scaled"] = (absolute_work(planner, t) for t in (result.trajectory, scaled.trajectory))
    return row


def absolute_work(planner: Planner, trajectory: Trajectory) -> float:
    """Integral of sum |tau v| over a trajectory, J."""
    filled = planner.scorer.filled(trajectory)
    assert filled.effort is not None
    return float(np.trapezoid(np.abs(filled.effort * filled.velocity).sum(axis=1), filled.time))


def proof_seconds(problem: Problem) -> float | None:
    """CPU time of the proof of a free motion, the least of three."""
    trajectory = None if problem.given is None else timed(problem, problem.given)
    if trajectory is None or judged(problem.cell, trajectory)[0] != "proven":
        return None
    found = []
    for _ in range(3):
        begin = time.process_time()
        judged(problem.cell, trajectory)
        found.append(time.process_time() - begin)
    return min(found)


def rivals(problem: Problem, seed: int) -> dict[str, Any]:
    """What OMPL, OMPL smoothed and Drake (from OMPL's path) come to."""
    ends, limits = np.stack([problem.start, problem.goal]), problem.robot.limits
    room = Room(problem.cell, ends, kept=0.0)
    lower, upper = np.maximum(limits.lower, -2 * np.pi), np.minimum(limits.upper, 2 * np.pi)
    found = plan(problem.start, problem.goal, lower, upper, room.clear, seed, PLANNING)
    out: dict[str, Any] = {"ompl_seconds": found.seconds}
    for name, points in (("ompl", found.simplified), ("smoothed", found.smoothed)):
        trajectory = None if points is None else timed(problem, through(points))
        out[name], out[f"{name}_depth"] = judged(problem.cell, trajectory)
    first = problem.given or (None if found.simplified is None else through(found.simplified))
    out["drake"], out["drake_depth"] = "none", 0.0
    if first is not None:
        answer = Drake(problem.cell).solve(problem.start, problem.goal, first)
        out["drake"], out["drake_depth"] = judged(problem.cell, answer.trajectory)
        out["drake_seconds"] = answer.seconds
    return out


def summary(real: list[dict[str, Any]], rows: list[dict[str, Any]]) -> dict[str, bool]:
    """Print what whole answers come to, and hold it against what must be."""
    checks = {}
    answers = [(row.get(f"{kind}_status"), row.get(f"{kind}_judged")) for row in rows for kind in ("given", "ends")]
    checks["no result called solved touches anything"] = all(
        j == "proven" for status, j in answers if status == "solved"
    )
    for kind, share in (("given", 0.97), ("ends", 0.95)):
        asked = [row for row in real if f"{kind}_status" in row]
        solved = [row for row in asked if row[f"{kind}_status"] == "solved"]
        if not asked:
            continue
        seconds = [row[f"{kind}_total_seconds"] for row in asked]
        print(
            f"{kind}: {len(solved)} of {len(asked)} solved, {median(seconds):.2f} s median, {max(seconds):.2f} s worst"
        )
        checks[f"{kind}: {100 * share:.0f} % are solved"] = len(solved) >= share * len(asked)
        saved = [row for row in asked if f"{kind}_saved_percent" in row]
        mean = float(np.mean([row[f"{kind}_saved_percent"] for row in saved]))
        sums = {
            key: sum(row[f"{kind}_{key}"] for row in saved) for key in ("loss", "loss_scaled", "work", "work_scaled")
        }
        pooled, work = 100 * (1 - sums["loss"] / sums["loss_scaled"]), 100 * (1 - sums["work"] / sums["work_scaled"])
        print(f"  loss saved {mean:.1f} % in the mean, {pooled:.1f} % pooled; of sum |tau v| dt {work:.1f} %")
        if kind == "given":
            checks["loss saved: mean 58 %, pooled 60 %"] = mean >= 58 and pooled >= 60
        else:
            quick = sum(row[f"{kind}_total_seconds"] <= 10 for row in solved)
            checks["ends: 85 % are solved within 10 s"] = quick >= 0.85 * len(asked)
    return checks


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print; 1 where something that must hold does not."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, metavar="N", help="the first N of each kind (all)")
    parser.add_argument("--rivals", action="store_true", help="OMPL and Drake too (pip install ompl drake)")
    parser.add_argument("--solve", action="store_true", help="whole answers too, with the given path and without")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the numbers as JSON")
    args = parser.parse_args(arguments)
    rows: list[dict[str, Any]] = []
    planners: dict[str, Planner] = {}
    for problem in problems(args.problems):
        row = {"problem": problem.name, "kind": "mbm" if problem.given is not None else "suite", **from_ends(problem)}
        row["proof_seconds"] = proof_seconds(problem)
        if args.solve:
            robot = problem.robot
            settings = Settings(compile="always", seed=args.seed)
            planner = planners.setdefault(robot.name, Planner(robot, source_method_2(robot.name), settings))
            for kind, given in (("given", problem.given), ("ends", None)):
                if kind == "ends" or given is not None:
                    row |= {f"{kind}_{key}": value for key, value in answered(planner, problem, given).items()}
        rows.append({**row, **(rivals(problem, args.seed) if args.rivals else {})})
        print(".", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    words = ("kind", "message", "loss", "work", "_message")
    header = [key for key in dict.fromkeys(key for row in rows for key in row) if not any(w in key for w in words)]
    print(table(header, [[row.get(key, "") if row.get(key) is not None else "-" for key in header] for row in rows]))
    real = [row for row in rows if row["kind"] == "mbm"] or rows
    found = [row for row in real if row["source"] != "none"]
    proofs = [row["proof_seconds"] for row in rows if row["proof_seconds"] is not None]
    print(f"\nfirst paths from start and goal alone: {len(found)} of {len(real)}, ", end="")
    print(f"median {median(row['seconds'] for row in real):.2f} s, worst {max(row['seconds'] for row in real):.2f} s")
    for name in ("ompl", "smoothed", "drake") if args.rivals else ():
        verdicts = [row[name] for row in rows]
        deep = max(row[f"{name}_depth"] for row in rows)
        print(
            f"{name}: {verdicts.count('proven')} proven, {verdicts.count('colliding')} touch (to {deep:.1f} mm), ",
            end="",
        )
        print(f"{verdicts.count('undecided')} nearer than asked for, {verdicts.count('none')} without an answer")
    checks = {
        "95 % of first paths are found": len(found) >= 0.95 * len(real),
        "85 % within 10 s": sum(row["seconds"] <= 10 for row in found) >= 0.85 * len(real),
        "every first path is proven as timed": all(row["verdict"] == "proven" for row in found),
        "a free motion is proven within 30 ms (median)": not proofs or median(proofs) <= 0.030,
    }
    if args.solve:
        checks |= summary(real, rows)
    return finish({"rows": rows}, checks, args.out)


if __name__ == "__main__":
    sys.exit(main())
