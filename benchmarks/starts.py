"""When starts may end: what rules take and miss on the coarse problems of the suites' moves, against 32 full starts.

    python benchmarks/starts.py [--moves 20] [--seeds 1 2]

A rule: `fewest` starts at least, of which three found the least cost; a start is given up where a few more steps like
its last one would leave it above `hopeless` times the least cost so far. Printed are starts and iterations a move, and
how many moves it leaves with a coarse optimum that is more than 1 % above the best of 32 starts.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from common import SEED, SUITES, cases, finish, robots, table

from energy_opt.motion import Planner, Settings
from energy_opt.motion.plan.candidates import task_of
from energy_opt.motion.plan.context import path_of
from energy_opt.motion.reshape import starts as rule
from energy_opt.motion.reshape import task as descent
from energy_opt.motion.reshape.search import WIDE
from energy_opt.motion.reshape.starts import Optima
from energy_opt.motion.reshape.task import Line, Task
from energy_opt.power import source_method_2

STARTS, MISSED = 32, 0.01
USED = rule.FEWEST, descent.HOPELESS


def problems(count: int, seeds: Sequence[int]) -> Iterator[tuple[descent.Level, Task, Line]]:
    """The coarse problem of each move, and what starts are bent from."""
    for robot in robots(list(SUITES)):
        planner = Planner(robot, source_method_2(robot.name), Settings(compile="always"))
        for seed in seeds:
            for case in cases(robot, planner, max(1, count * SUITES[robot.name] // 20), seed):
                context, duration = planner.context(case.move), case.move.duration
                assert duration is not None
                task = task_of(context, case.move, duration, duration)
                yield (
                    context.reshaper("energy").coarse(0),
                    descent.replace(task, width=WIDE),
                    Line.along(path_of(case.move), duration),
                )


def found(level: descent.Level, task: Task, line: Line, fewest: int, hopeless: float) -> Optima:
    """What the starts of a rule lead to."""
    rule.FEWEST, descent.HOPELESS = fewest, hopeless
    return rule.search(level, task, line, STARTS, 0, lambda: False)


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where the rule in use misses more than one move in twenty."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=20, help="moves of the panda, half as many of the ur5 (20)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[SEED, 2], help="of the moves")
    args = parser.parse_args(words)
    moves = list(problems(args.moves, args.seeds))
    best = np.array([min(found(*move, STARTS, np.inf).costs) for move in moves])
    rows, missed = [], {}
    for fewest, hopeless in product((8, 10, 12), (np.inf, 1.1, 1.05, 1.0)):
        answers = [found(*move, fewest, hopeless) for move in moves]
        above = np.array([min(answer.costs) for answer in answers]) / best - 1
        missed[fewest, hopeless] = int((above > MISSED).sum())
        counts = (float(np.mean([getattr(x, name) for x in answers])) for name in ("starts", "iterations"))
        rows.append((fewest, hopeless, *counts, missed[fewest, hopeless], 100 * above.max()))
    print(table(("fewest", "hopeless", "starts", "iterations", "missed", "worst %"), rows))
    return finish({"rows": rows}, {f"missed {missed[USED]} of {len(moves)}": missed[USED] <= len(moves) / 20}, None)


if __name__ == "__main__":
    sys.exit(main())
