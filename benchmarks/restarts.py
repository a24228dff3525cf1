"""What searches that begin again win for hurried moves under laws with kinks, and what they cost.

    python benchmarks/restarts.py [--moves 10] [--seed 77] [--arms ur5e panda ur10e] [--model careful]
        [--out numbers.json]

Seeded moves without bodies, each in a free duration and in 1.03 times that: with and without searches that begin again
with wide kinks where they did not converge. Printed are the energy above the lesser of both in percent of it, and
processor time relative to the whole search.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from common import finish, robots, table

import energy_opt as eo
from energy_opt.batches.tables import random_moves
from energy_opt.motion import Move
from energy_opt.motion.reshape import search

LONGER = 1.03  # times the free duration


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where a solve fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=10, metavar="N", help="of each arm (10)")
    parser.add_argument("--seed", type=int, default=77, metavar="N")
    parser.add_argument("--arms", nargs="+", default=["ur5e", "panda", "ur10e"], metavar="ARM")
    parser.add_argument("--model", default="careful")
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the numbers")
    args = parser.parse_args(words)
    energies, seconds, failed = [], [], 0
    for robot in robots(args.arms):
        planner = eo.Planner(robot, eo.load_model(args.model, robot))
        for named in random_moves(robot, args.moves, args.seed):
            free = Move(np.array(named.start), np.array(named.goal))
            first = planner.solve(free)  # what is built once is there for all
            for move in (free, replace(free, duration=LONGER * first.trajectory.duration)):
                found, took = [], []
                for again in (True, False):
                    with nullcontext() if again else patch.object(search, "WIDER", ()):
                        begin = time.process_time()
                        result = planner.solve(move)
                        took.append(time.process_time() - begin)
                    found.append(result.energy.total)
                    failed += result.status != "solved"
                energies.append(found)
                seconds.append(took)
    least = np.min(energies, axis=1, keepdims=True)
    above, spent = 100 * (np.array(energies) / least - 1), np.sum(seconds, axis=0)
    header = ("searches", "moves", "energy above the lesser, mean %", "worst %", "time")
    rows = [
        (name, len(above), above[:, k].mean(), above[:, k].max(), spent[k] / spent[0])
        for k, name in enumerate(("begin again", "end"))
    ]
    print(table(header, rows))
    return finish({"rows": rows}, {"all are solved": not failed}, args.out)


if __name__ == "__main__":
    sys.exit(main())
