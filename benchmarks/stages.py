"""What each stage of the search beside bodies costs and wins, on MotionBenchMaker's problems that have a path.

    python benchmarks/stages.py [--without STAGE ...] [--problems N] [--robot panda] [--out numbers.json]

Each problem is solved forwards and backwards; backwards it is another problem, which was used once: to reject a single
first step. Stages are

    half     searches from half-way between the best curve and the best optimum without bodies
    second   second trials from curves that are above the best by up to 30 %, and searches from those within 10 %
    steps    a second first step for trials from the first path
    deep     early ends of trials in which bodies do not come apart

Printed are, without each stage, processor time of all problems and loss, both against the whole search.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from cells_work import SLOWER, Problem, Workers, problems
from common import finish, table

from energy_opt.motion import Move
from energy_opt.motion.path import through
from energy_opt.motion.plan import clear
from energy_opt.motion.plan.clearing import Clearing
from energy_opt.motion.reshape import clear as search

POINTS = 200  # of a path that is passed backwards
TRIALS = Clearing.best_of


def once(self: Clearing, trials_from: Sequence[tuple[Any, float]]) -> None:
    """Trials without those from first paths with a bold step."""
    first = {id(curve) for curve in self.curves}
    TRIALS(self, [(c, trust) for c, trust in trials_from if id(c) not in first or trust == clear.TRUST])


WITHOUT = {
    "half": lambda: patch.object(Clearing, "_half_way", lambda *_: None),
    "second": lambda: patch.object(clear, "HOPES", (1.0, 1.0)),
    "steps": lambda: patch.object(Clearing, "best_of", once),
    "deep": lambda: patch.object(search, "STUCK", np.inf),
}


@contextmanager
def whole():
    """The search as it is."""
    yield


def moves(problem: Problem) -> tuple[Move, Move]:
    """A problem's move along its path, forwards and backwards."""
    assert problem.given is not None
    back = through(problem.given(np.linspace(1, 0, POINTS)))
    return Move(problem.start, problem.goal, path=problem.given), Move(problem.goal, problem.start, path=back)


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where a solve fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--without", nargs="+", choices=list(WITHOUT), default=list(WITHOUT), help="stages (all)")
    parser.add_argument("--problems", type=int, metavar="N", help="the first N (all)")
    parser.add_argument("--robot", help="its problems only")
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the numbers")
    args = parser.parse_args(words)
    workers, found, failed = Workers(), {}, 0
    for problem in problems(args.problems):
        if problem.given is None or args.robot not in (None, problem.robot.name):
            continue
        planner = workers.of(problem.robot).around(problem.cell)
        for way, move in zip(("forwards", "backwards"), moves(problem), strict=True):
            move = replace(move, duration=SLOWER * planner.minimum_time(move))
            planner.solve(move)  # what is kept of a move is there for all
            for name in ("whole", *args.without):
                with WITHOUT.get(name, whole)():
                    begin = time.process_time()
                    result = planner.solve(move)
                    found[name, way, problem.name] = time.process_time() - begin, result.energy.loss
                failed += result.status != "solved"
            losses = [f"{name} {found[name, way, problem.name][1]:.4g} J" for name in ("whole", *args.without)]
            print(f"{problem.name} {way}: {', '.join(losses)}", flush=True)
    rows = []
    for name in args.without:
        for way in ("forwards", "backwards"):
            with_, left = (
                np.array([x for (n, w, _), x in found.items() if (n, w) == (m, way)]) for m in ("whole", name)
            )
            more = 100 * (left[:, 1] / with_[:, 1] - 1)
            share = 100 * (left[:, 0].sum() / with_[:, 0].sum() - 1)
            rows.append((name, way, len(more), share, more.mean(), more.max(), more.min()))
    print(table(("without", "way", "problems", "time %", "loss, mean %", "worst %", "best %"), rows))
    return finish({"rows": rows}, {"all are solved": not failed}, args.out)


if __name__ == "__main__":
    sys.exit(main())
