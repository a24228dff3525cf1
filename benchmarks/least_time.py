"""Moves in hardly more than their least time, and moves of free duration, which end there if standby power is high.

    python benchmarks/least_time.py [--moves 6] [--seed 3] [--arms panda ur5e xarm7 z1] [--out numbers.json]

Seeded moves without bodies under the source paper's model, each in 1, 1.0005, 1.002 and 1.01 times the least time of
its straight line: loss relative to the last one. Then with free duration and end accelerations: energy relative to
that in the least time. Seconds are CPU times.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from statistics import fmean, median
from typing import Any

from common import finish, table

import energy_opt as eo
from energy_opt.batches.tables import random_moves

TIMES = (1.0, 1.0005, 1.002, 1.01)  # times the least time
MODEL = "source-method-2"


def measured(robot: eo.Robot, start: list[float], goal: list[float]) -> dict[str, Any]:
    """Losses in `TIMES` relative to the last one, energies in J, the answers' kinds, and seconds."""
    move: dict[str, Any] = {"start": start, "goal": goal, "self_collision": False}
    least = eo.optimize(robot, MODEL, mode="retime", objective="time", **move).baseline("toppra").duration
    near, seconds = [], []
    for share in TIMES:
        begin = time.process_time()
        near.append(eo.optimize(robot, MODEL, duration=share * least, **move))
        seconds.append(time.process_time() - begin)
    free = eo.optimize(robot, MODEL, end_acceleration="free", **move)
    row: dict[str, Any] = {"robot": robot.name, "least s": least}
    row |= {f"{s:g}": x.energy.loss / near[-1].energy.loss for s, x in zip(TIMES, near, strict=True)}
    row |= {"chosen": near[0].chosen, "seconds": max(seconds[:-1])}
    return row | {"free s": free.duration / least, "free J": free.energy.total / near[0].energy.total}


def main() -> int:
    """Run and print; 1 where the least time keeps the line, or a free duration costs more than the least time."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moves", type=int, default=6, metavar="N", help="of each arm (6)")
    parser.add_argument("--seed", type=int, default=3, metavar="N")
    parser.add_argument("--arms", nargs="+", default=["panda", "ur5e", "xarm7", "z1"], metavar="ARM")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the numbers as JSON")
    args = parser.parse_args()
    rows = []
    for name in args.arms:
        robot = eo.load_robot(name)
        for move in random_moves(robot, args.moves, args.seed):
            rows.append(measured(robot, list(move.start), list(move.goal)))
    print(table(list(rows[0]), [list(row.values()) for row in rows]))
    for share in TIMES[:-1]:
        losses = [row[f"{share:g}"] for row in rows]
        print(
            f"in {share:g} times the least time: {fmean(losses):.3f} of the loss in the mean, {max(losses):.3f} at most"
        )
    free = [row["free J"] for row in rows]
    print(f"free: {fmean(free):.4f} of the energy in the least time in the mean, {max(free):.4f} at most")
    print(f"{median(row['seconds'] for row in rows):.2f} s for the slowest near the least time, median")
    checks = {
        "every move in its least time is reshaped": all(row["chosen"] == "reshape" for row in rows),
        "no free duration costs 0.1 % more than the least time": max(free) <= 1.001,
    }
    return finish({"rows": rows}, checks, args.out)


if __name__ == "__main__":
    sys.exit(main())
