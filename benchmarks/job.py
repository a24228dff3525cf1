"""A job of six moves: against plain ways of running it, against a fine grid of durations, and its time.

    python benchmarks/job.py
    python benchmarks/job.py --random 5

The shipped example (`energy-opt --example job`) with the source paper's model: once as it is, reshaped, and once
retimed. The retimed one is held against a grid: every leg is retimed at durations 0.25 % apart around its own, and the
best sums that fill the cycle are found by dynamic programming. Time is that of the process: the reshaped job against
six single solves of the same moves at the same durations, one planner after the other, each built anew without compiled
functions, as six calls of `optimize` are. Exit code 1 where a bound is missed.

With --random N: N cycles of three to five random moves for each of two robots, with waits, payloads and brakes at
random, in 1.05 to 1.8 times their shortest time; the time shared by first paths alone, and by the reshaped moves.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from common import table

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import example
from energy_opt.errors import Infeasible
from energy_opt.files import to_json
from energy_opt.jobs import reshare
from energy_opt.jobs.file import job_of as job_from
from energy_opt.jobs.file import load_job
from energy_opt.jobs.legs import Job
from energy_opt.jobs.solve_job import JobResult, run_job
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.retime.solve import retime
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot

MUST_RATIO, MUST_GRID = 0.5, 1.001  # six moves in the time of three single solves
STEP, AROUND = 0.0025, 24  # of the cycle: the grid's step as a share of what moves take, and points on either side
SETTINGS = Settings(compile="never")


def job_of(robot: Robot, mode: str) -> Job:
    """The shipped example, every step in that mode."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "job.toml"
        path.write_text(example("job").replace('mode = "reshape"', f'mode = "{mode}"'))
        return load_job(path, lambda _: robot)


def grid(result: JobResult) -> float:
    """J of the best cycle on a grid of durations, waits as in the result."""
    plan, robot = result.plan, result.job.robot
    moving = [(leg, a) for leg, a in zip(plan.legs, plan.answers, strict=True)]
    step = STEP * sum(a.trajectory.duration for _, a in moving) / len(moving)
    best = {0: 0.0}  # by how many steps are used beyond the result's own durations, the least energy
    for leg, answer in moving:
        scorer = result.scorers.of(leg.step)
        found: dict[int, float] = {}
        for k in range(-AROUND, AROUND + 1):
            duration = answer.trajectory.duration + k * step
            try:
                at = retime(robot, scorer.model, leg.path, duration=duration).trajectory
            except Infeasible:
                continue
            found[k] = scorer.energy(at).total
        best = {
            total: min(best[total - k] + e for k, e in found.items() if total - k in best)
            for total in {a + k for a in best for k in found}
        }
    waits = result.energy - sum(a.energy.total for _, a in moving)
    return min(e + waits - plan.rest.power * total * step for total, e in best.items() if total * step <= plan.left)


def single_solves(result: JobResult) -> tuple[float, float]:
    """Seconds of one planner a move, each built anew; and J of these moves."""
    job, seconds, energy = result.job, 0.0, 0.0
    durations = {row: p.trajectory.duration / len(p.steps) for p in result.pieces for row in p.steps}
    for k, step in enumerate(job.steps):
        if step.wait is not None:
            continue
        begin = time.process_time()
        model = result.scorers.of(step).model
        planner = Planner(job.robot, model, SETTINGS, cell=Cell(job.robot, CellRequest()))
        move = Move(step.start, step.goal, "reshape")
        move = replace(move, duration=max(durations[k], 1.05 * planner.minimum_time(move)))
        energy += planner.solve(move).energy.total
        seconds += time.process_time() - begin
    return seconds, energy


def random_job(robot: Robot, rng: np.random.Generator) -> Job:
    """A cycle of random moves, without its time."""
    low, high = np.maximum(robot.limits.lower, -2.5), np.minimum(robot.limits.upper, 2.5)
    count = int(rng.integers(3, 6))
    poses = [(low + high) / 2 + rng.uniform(-0.35, 0.35, robot.n) * (high - low) for _ in range(count)]
    loads, brakes = [2.0 * (rng.random() < 0.5), 0.0], bool(rng.random() < 0.3)
    document: dict[str, Any] = {"format": "energy-opt/job/1", "robot": robot.name, "cycle_time": 0.1, "brakes": brakes}
    steps: list[dict[str, Any]] = []
    for k, pose in enumerate(poses):
        steps += [{"to": pose.tolist(), "payload": loads[k % 2]}, {"wait": float(rng.uniform(0.2, 1.0))}]
    return job_from({**document, "home": poses[-1].tolist(), "step": steps}, Path("job.toml"), lambda _: robot)


def compare(count: int) -> int:
    """Loss and time of random cycles with both ways of sharing their time."""
    rng, rows, changes = np.random.default_rng(11), [], []
    for name in ("panda", "ur5e"):
        robot, model = load_robot(name), source_method_2(name)
        for number in range(count):
            job, slack = random_job(robot, rng), rng.uniform(1.05, 1.8)
            try:
                run_job(job, model, SETTINGS)
            except Infeasible as error:
                if error.limit != "duration" or error.shortest_duration is None:
                    continue  # a pose touches the arm itself
                job = replace(job, cycle_time=job.waiting + slack * (error.shortest_duration - job.waiting))
            found = []
            for rounds in (0, reshare.ROUNDS):
                begin = time.process_time()
                with patch.object(reshare, "ROUNDS", rounds):
                    result = run_job(job, model, SETTINGS)
                found.append((result.energy, time.process_time() - begin, result.plan.answers))
            loss = sum(answer.energy.loss for answer in found[0][2])
            changes.append(100 * (found[1][0] - found[0][0]) / loss)
            rows.append([name, number, slack, found[0][0], found[1][0], changes[-1], found[0][1], found[1][1]])
    print(table(("robot", "cycle", "slack", "first J", "anew J", "% of loss", "first s", "anew s"), rows))
    times = sum(row[-1] for row in rows) / sum(row[-2] for row in rows)
    print(
        f"{len(changes)} cycles: {np.mean(changes):.1f} % of the loss in the mean, {max(changes):.1f} % at worst, in "
        f"{times:.1f} times the time"
    )
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--random", type=int, metavar="N", help="N random cycles of each robot, shared in both ways")
    args = parser.parse_args()
    if args.random:
        return compare(args.random)
    robot, out = load_robot("panda"), {}
    for mode in ("reshape", "retime"):
        job = job_of(robot, mode)
        begin = time.process_time()
        result = run_job(job, source_method_2(), SETTINGS)
        seconds = time.process_time() - begin
        out[mode] = {
            "seconds": seconds,
            "energy": result.energy,
            "lower_bound": result.bound,
            **result.energies,
        }
        if mode == "reshape":
            alone, _ = single_solves(result)
            with patch.object(reshare, "ROUNDS", 0):
                out[mode]["shared_by_first_paths"] = run_job(job, source_method_2(), SETTINGS).energy
            out[mode] |= {"single_solves": alone, "time_ratio": seconds / alone, "must": MUST_RATIO}
        else:
            least = grid(result)
            out[mode] |= {"grid": least, "over_grid": result.energy / least, "must": MUST_GRID}
    sys.stdout.write(to_json(out))
    plain = all(
        row[name] is None or row["energy"] <= row[name]
        for row in out.values()
        for name in ("fastest_then_wait", "evenly_slowed")
    )
    return 0 if plain and out["reshape"]["time_ratio"] <= MUST_RATIO and out["retime"]["over_grid"] <= MUST_GRID else 1


if __name__ == "__main__":
    sys.exit(main())
