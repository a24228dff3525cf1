"""What it wins, and costs, to let single joints rest before and after their moves under dry friction.

    python benchmarks/rests.py [--moves N] [--out numbers.json]

Moves of three arms with a payload, under the model `careful`, in 1.01, 1.5 and 3 times the free duration: random
ones ("any"), and ones in which the second joint has to move by only 2 mrad beside the first ("small"). Each is solved
without such rests, and with three values of the least share of the loss for which a joint is tried (`standing.WORTH`).
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

from energy_opt.effects import Payload
from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Planner
from energy_opt.motion.plan import standing
from energy_opt.power import load_model
from energy_opt.robot import Robot, load_robot

ROBOTS, SLOWER = ("ur5e", "ur10e", "panda"), (1.01, 1.5, 3.0)
MASS, CENTRE = 3.0, [0.0, 0.0, 0.05]  # [kg], [m]
SHARES = (np.inf, standing.WORTH / 2, standing.WORTH, standing.WORTH * 2)  # the first: without
WIDE, SWING, SMALL = 0.3, 1.0, 0.002  # share of a joint's range about its middle; [rad]


def ends(robot: Robot, rng: np.random.Generator, small: bool) -> tuple[np.ndarray, np.ndarray]:
    """A random start and goal (n,) [rad]; `small`: they differ by `SWING` and `SMALL` in the first two joints."""
    low, high = np.maximum(robot.limits.lower, -2.5), np.minimum(robot.limits.upper, 2.5)
    start, goal = ((low + high) / 2 + WIDE * rng.uniform(-1, 1, robot.n) * (high - low) for _ in range(2))
    if small:
        goal = start + np.append(np.copysign([SWING, SMALL], goal[:2] - start[:2]), np.zeros(robot.n - 2))
    return start, goal


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where a move takes more energy with rests."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=6, metavar="N", help="of each robot and kind")
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the numbers")
    args = parser.parse_args(words)
    rng, found = np.random.default_rng(5), {}
    for name in ROBOTS:
        robot = load_robot(name)
        planner = Planner(robot, load_model("careful", robot).replaced(Payload(mass=MASS, com=CENTRE)))
        for number in range(args.moves):
            for kind in ("any", "small"):
                try:
                    move = Move(*ends(robot, rng, kind == "small"))
                    free = planner.solve(move).duration
                except Infeasible:
                    continue
                for slower in SLOWER:
                    timed = Move(move.start, move.goal, duration=slower * free)
                    planner.solve(timed)  # what is kept of a move is there for all
                    for share in SHARES:
                        with patch.object(standing, "WORTH", share):
                            begin = time.process_time()
                            energy = planner.solve(timed).energy
                        spent = time.process_time() - begin
                        found[name, number, kind, slower, share] = spent, energy.loss, energy.total
    rows, kept = [], True
    for kind in ("any", "small"):
        for slower in SLOWER:
            for share in SHARES[1:]:
                pairs = np.array(
                    [
                        [values, found[*key[:4], share]]
                        for key, values in found.items()
                        if key[2:] == (kind, slower, np.inf)
                    ]
                )
                less = 100 * (1 - pairs[:, 1, 1] / pairs[:, 0, 1])
                cpu = 100 * (pairs[:, 1, 0].sum() / pairs[:, 0, 0].sum() - 1)
                rows.append((kind, slower, share, len(pairs), less.mean(), less.max(), less.min(), cpu))
                kept &= bool((pairs[:, 1, 2] <= pairs[:, 0, 2] + 1e-9).all())
    titles = ("moves", "duration", "share", "count", "less loss %", "best %", "worst %", "CPU %")
    print(table(titles, rows))
    return finish({"rows": rows}, {"none takes more energy": kept}, args.out)


if __name__ == "__main__":
    sys.exit(main())
