"""Moves with limits of the tool's speed and acceleration: are they solved, and what bounded steps are worth.

    python benchmarks/tool_limits.py [--moves 8] [--seed 5] [--arms panda ur5e xarm7] [--out numbers.json]

Seeded moves of 20, 50 and 100 % of the way to their goals are reshaped under three sets of limits: by the search as it
is, and by one whose steps may change second derivatives at will (`BEND` in `energy_opt/motion/reshape/sqp.py`).
Processor times of both are of the same run.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from unittest.mock import patch

import numpy as np
from common import finish, table

import energy_opt as eo
from energy_opt.batches.tables import random_moves
from energy_opt.errors import Infeasible
from energy_opt.motion.reshape import sqp

SPEED, ACCELERATION = eo.conditions.ToolSpeed, eo.conditions.ToolAcceleration
LIMITS = {
    "0.4 m/s": [SPEED(0.4)],
    "1.5 m/s^2": [ACCELERATION(1.5)],
    "0.8 m/s, 2.5 m/s^2": [SPEED(0.8), ACCELERATION(2.5)],
}
SHARES = (0.2, 0.5, 1.0)  # of the way to the goal


def moves(robot: eo.Robot, count: int, seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Starts and goals that are free of the arm's own body, the first `count` of those drawn."""
    out: list[tuple[np.ndarray, np.ndarray]] = []
    for k, move in enumerate(random_moves(robot, 3 * count, seed)):
        start, goal = np.array(move.start), np.array(move.goal)
        goal = start + SHARES[k % len(SHARES)] * (goal - start)
        try:
            eo.optimize(robot, start=start, goal=goal, mode="retime")
        except Infeasible:
            continue
        out.append((start, goal))
        if len(out) == count:
            break
    return out


def solved(robot: eo.Robot, start: np.ndarray, goal: np.ndarray, limits: Sequence[object]) -> tuple[float, float]:
    """Energy [J] of a move, nan if it is not solved; and processor time [s]."""
    begin = time.process_time()
    try:
        result = eo.optimize(robot, start=start, goal=goal, conditions=limits)
        energy = result.energy.total if result.status == "solved" else np.nan
    except Infeasible:
        energy = np.nan
    return energy, time.process_time() - begin


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where a move is not solved."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=8, metavar="N", help="moves of each arm (8)")
    parser.add_argument("--seed", type=int, default=5, help="of the moves (5)")
    parser.add_argument("--arms", nargs="+", default=["panda", "ur5e", "xarm7"], help="robots (panda ur5e xarm7)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the numbers")
    args = parser.parse_args(words)
    rows, numbers = [], {}
    for name in args.arms:
        robot = eo.load_robot(name)
        drawn = moves(robot, args.moves, args.seed)
        for label, limits in LIMITS.items():
            solved(robot, *drawn[0], limits)  # builds what all moves share
            found = []
            for start, goal in drawn:
                bounded = solved(robot, start, goal, limits)
                with patch.object(sqp, "BEND", np.inf):
                    found.append((*bounded, *solved(robot, start, goal, limits)))
            energy, seconds, free, free_seconds = np.array(found).T
            more = 100 * (energy / free - 1)
            both = more[np.isfinite(more)]
            count = [int(np.isfinite(x).sum()) for x in (energy, free)]
            changes = both.mean(), both.min(), both.max()
            rows.append((name, label, len(found), *count, *changes, seconds.mean(), free_seconds.mean()))
            numbers[f"{name}, {label}"] = np.array(found).tolist()
            print(table([""] * len(rows[-1]), rows[-1:]).splitlines()[1], flush=True)
    header = ("arm", "limits", "moves", "solved", "free steps", "energy, mean %", "best %", "worst %", "s", "free: s")
    print(table(header, rows))
    return finish({"moves": numbers}, {"all are solved": all(row[2] == row[3] for row in rows)}, args.out)


if __name__ == "__main__":
    sys.exit(main())
