"""What two parts of the search win for hurried moves under laws with kinks, and what they cost.

    python benchmarks/restarts.py [--moves 10] [--seed 77] [--arms ur5e panda ur10e] [--model careful]
        [--out numbers.json]

Seeded moves without bodies, each in a free duration and in 1.03 times that. Without `restarts`, a search that did not
converge is not begun again with wide kinks. Without `sides`, steps of free duration that break a derivative's bound on
the side where it is not linearised are shortened, not corrected. Printed are, without each of them and without both,
the energy above the least of all four in percent of it, and processor time relative to the whole search.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from common import finish, robots, table

import energy_opt as eo
from energy_opt.batches.tables import random_moves
from energy_opt.motion import Move
from energy_opt.motion.reshape import search
from energy_opt.motion.reshape.model import Model

PARTS = {
    "restarts": lambda: patch.object(search, "WIDER", ()),
    "sides": lambda: patch.object(Model, "crossed", lambda self, point, *_: np.zeros(len(point.linear), dtype=bool)),
}
LONGER = 1.03  # times the free duration
WITHOUT: dict[str, tuple[str, ...]] = {"": (), "restarts": ("restarts",), "sides": ("sides",), "both": tuple(PARTS)}


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
                for parts in WITHOUT.values():
                    with ExitStack() as stack:
                        for part in parts:
                            stack.enter_context(PARTS[part]())
                        begin = time.process_time()
                        result = planner.solve(move)
                        took.append(time.process_time() - begin)
                    found.append(result.energy.total)
                    failed += result.status != "solved"
                energies.append(found)
                seconds.append(took)
    least = np.min(energies, axis=1, keepdims=True)
    above, spent = 100 * (np.array(energies) / least - 1), np.sum(seconds, axis=0)
    header = ("without", "moves", "energy above the least, mean %", "worst %", "time")
    rows = [
        (name or "none", len(above), above[:, k].mean(), above[:, k].max(), spent[k] / spent[0])
        for k, name in enumerate(WITHOUT)
    ]
    print(table(header, rows))
    return finish({"rows": rows}, {"all are solved": not failed}, args.out)


if __name__ == "__main__":
    sys.exit(main())
