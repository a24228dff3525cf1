"""The front of energy against duration: what do 20 points cost, in cold solves?

    python benchmarks/tradeoff.py

A cold solve builds the problem and solves one reshape from nothing. The front builds once and warm-starts. Both are
measured in one run, in one process, on one move, without compiled functions and as processor time. Exit code 1 beyond
the bound.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from energy_opt.files import to_json
from energy_opt.motion import Move, Planner, Settings
from energy_opt.power import source_method_2
from energy_opt.robot import load_robot
from energy_opt.tradeoff import trace

MUST = 6.0
COLD = 3  # cold solves, of which the median counts

START = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
GOAL = np.array([1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4])


def main() -> int:
    robot, model = load_robot("panda"), source_method_2()
    move = Move(START, GOAL, mode="reshape")
    times = []
    for _ in range(COLD):
        begin = time.process_time()
        Planner(robot, model, Settings(compile="never")).solve(Move(START, GOAL, mode="reshape", duration=2.0))
        times.append(time.process_time() - begin)
    begin = time.process_time()
    front = trace(Planner(robot, model, Settings(compile="never")), move)
    spent = time.process_time() - begin
    cold = float(np.median(times))
    solved = sum(point.status == "solved" for point in front.points)
    ratio = spent / cold
    sys.stdout.write(
        to_json({"cold": cold, "front": spent, "ratio": ratio, "must": MUST, "points": solved, "solves": front.solves})
    )
    return 0 if ratio <= MUST else 1


if __name__ == "__main__":
    sys.exit(main())
