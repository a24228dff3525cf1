"""Retiming against TOPP-RA itself, on the same straight paths and the same grid of 200 intervals.

    python benchmarks/retime.py [--moves N] [--repeats 3] [--kinks] [--out numbers.json]

TOPP-RA as its users call it: the library's own velocity, acceleration and torque constraints (inverse dynamics by
Pinocchio), and its trajectory. Retiming as the planner calls it, from a TOPP-RA timing that is there already, with
everything else included: coefficients of the dynamics, the program, limits, energy, bound, and rows. The
program is built at the first move, which is not measured. CPU time, best of the repeats, in turns; medians over moves.
Exit code 1 where the bound is not held (--kinks has none).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import toppra.algorithm as algorithm
import toppra.constraint as constraint
from common import SEED, SLOWER, SUITES, finish, table
from toppra import SplineInterpolator

from energy_opt.batches.tables import random_moves
from energy_opt.effects import PsuLoss, Regeneration
from energy_opt.motion.path import straight
from energy_opt.motion.retime.solve import GLOBAL_GAP, retime
from energy_opt.motion.timing.toppra import INTERVALS, fastest
from energy_opt.numerics.bspline import greville
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot

MUST = 2.0


def library(robot: Robot, start: np.ndarray, goal: np.ndarray, grid: np.ndarray) -> float:
    """TOPP-RA's own duration of the straight path, s."""
    bounds = robot.limits
    limits = [
        constraint.JointVelocityConstraint(np.stack([-bounds.velocity, bounds.velocity], axis=1)),
        constraint.JointTorqueConstraint(
            lambda q, v, a: robot.body.torque(q, v, a)[0],
            np.stack([-bounds.effort, bounds.effort], axis=1),
            np.zeros(robot.n),
        ),
    ]
    if np.isfinite(bounds.acceleration).all():
        a = bounds.acceleration
        limits.append(constraint.JointAccelerationConstraint(np.stack([-a, a], axis=1)))
    path = SplineInterpolator([0, 1], np.stack([start, goal]))
    solver = algorithm.TOPPRA(
        limits, path, gridpoints=grid, parametrizer="ParametrizeConstAccel", solver_wrapper="seidel"
    )
    return float(solver.compute_trajectory(0, 0).duration)


def seconds(work: Callable[[], object]) -> float:
    """CPU time of one call."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where the bound is not held."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, help="the first N moves of each suite only")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each, of which the best counts (3)")
    parser.add_argument(
        "--kinks", action="store_true", help="of braking power 30 %% comes back, and the supply loses power"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the numbers")
    args = parser.parse_args(words)
    document, checks, rows = {}, {}, []
    for name, total in SUITES.items():
        robot, model = load_robot(name), source_method_2(name)
        if args.kinks:
            model = model.replaced(Regeneration(efficiency=0.3)).replaced(PsuLoss(affine=0.05, quadratic=1e-4))
        grid = greville(np.linspace(0, 1, INTERVALS))
        measured = []
        for number, move in enumerate(random_moves(robot, total, SEED)[: args.moves]):
            start, goal = np.array(move.start), np.array(move.goal)
            path = straight(start, goal)
            shortest = fastest(robot, model, path)
            tasks = {
                "toppra": lambda s=start, g=goal, r=robot, at=grid: library(r, s, g, at),
                "start": lambda p=path, r=robot, m=model: fastest(r, m, p),
                "free": lambda p=path, r=robot, m=model, t=shortest: retime(r, m, p, shortest=t),
                "exact": lambda p=path, r=robot, m=model, t=shortest: retime(
                    r, m, p, shortest=t, duration=SLOWER * t.duration
                ),
            }
            if number == 0:  # everything is built once
                for task in tasks.values():
                    task()
            turns = [{task: seconds(work) for task, work in tasks.items()} for _ in range(args.repeats)]
            found = retime(robot, model, path, shortest=shortest, duration=SLOWER * shortest.duration)
            best = {task: min(turn[task] for turn in turns) for task in tasks}
            measured.append({**best, "gap": found.gap, "move": move.name})
        columns = {task: np.array([row[task] for row in measured]) for task in ("toppra", "start", "free", "exact")}
        ratios = {task: float(np.median(columns[task] / columns["toppra"])) for task in ("free", "exact")}
        rows.append([name, *(1e3 * float(np.median(x)) for x in columns.values()), *ratios.values()])
        proved = sum(100 * row["gap"] <= GLOBAL_GAP for row in measured)
        rows[-1].append(f"{proved}/{len(measured)}")
        document[name] = {"ratios": ratios, "moves": measured}
        for task, text in (("free", "free duration"), ("exact", f"{SLOWER} x the minimum time")):
            checks[f"{name}, {text}: {ratios[task]:.2f} times TOPP-RA, at most {MUST:.0f}"] = ratios[task] <= MUST
    header = ("robot", "TOPP-RA ms", "start ms", "free ms", "1.5x ms", "free ratio", "1.5x ratio", "proved at 1.5x")
    print(table(header, rows))
    return finish({"must": MUST, **document}, {} if args.kinks else checks, args.out)


if __name__ == "__main__":
    sys.exit(main())
