"""Which named numbers of the search matter: each is halved and doubled, and the moves are solved again.

    python benchmarks/sensitivity.py [--modules motion.plan.clear motion.reshape.clear] [--names TRUST] [--every 2]
        [--out numbers.json]

The moves are MotionBenchMaker's problems that have a path, forwards and backwards in turns, and moves of the suites
with nothing but the arm's own body. A share between 0.5 and 1 is not doubled: its distance from 1 is halved. Integers
stay at least 1. Printed are the change of the loss (mean and worst) and of the processor time, against the number as it
is. A number that changes no answer and less than SLOWER_BY of the time in both directions is marked with *: it is not
shown to matter on these moves. --out is read again: measured numbers are kept.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import inspect
import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from cells_work import SLOWER, Workers, problems
from common import cases, finish, table
from stages import moves

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.files import write_json
from energy_opt.motion import Move, Planner
from energy_opt.robot import load_robot

MODULES = (
    "motion.plan.clear", "motion.plan.clearing", "motion.plan.candidates", "motion.reshape.clear",
    "motion.reshape.search", "motion.reshape.starts", "motion.reshape.sqp",
)  # fmt: skip
OWN = {"panda": 8, "ur5": 8}  # moves with the own body alone
SAME = 1e-4  # relative change of a loss below which an answer counts as the same
SLOWER_BY = 3.0  # [%] of the time
ANEW = 4  # numbers after which the moves are solved again with all numbers as they are: the machine's pace changes


def numbers(module: ModuleType) -> dict[str, Any]:
    """The numbers that a module itself names in capitals, by name."""
    out: dict[str, Any] = {}
    for node in ast.parse(inspect.getsource(module)).body:
        if not isinstance(node, ast.Assign):
            continue
        for name in (part.id for part in ast.walk(node.targets[0]) if isinstance(part, ast.Name) and part.id.isupper()):
            value = getattr(module, name)
            values = value if isinstance(value, tuple) else (value,)
            if all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in values):
                out[name] = value
    return out


def changed(value: Any, factor: float) -> Any:
    """A number, or each of several, times a factor; see the module."""
    if isinstance(value, tuple):
        return tuple(changed(x, factor) for x in value)
    if isinstance(value, int):
        return max(1, round(value * factor))
    return 1 - (1 - value) / factor if factor > 1 and 0.5 < value < 1 else value * factor


@contextmanager
def instead(name: str, old: Any, new: Any) -> Iterator[None]:
    """The number's new value wherever the package imported it."""
    holders = [m for m in list(sys.modules.values()) if getattr(m, "__name__", "").startswith("energy_opt")]
    found = [m for m in holders if vars(m).get(name) is old]
    for module in found:
        setattr(module, name, new)
    try:
        yield
    finally:
        for module in found:
            setattr(module, name, old)


def tasks(every: int) -> list[tuple[Planner, Move]]:
    """The moves and their planners; each has been solved once."""
    workers, out = Workers(), list[tuple[Planner, Move]]()
    given = [problem for problem in problems(None) if problem.given is not None]
    for number, problem in enumerate(given[::every]):
        planner = workers.of(problem.robot).around(problem.cell)
        move = moves(problem)[number % 2]
        out.append((planner, replace(move, duration=SLOWER * planner.minimum_time(move))))
    for name, count in OWN.items():
        robot = load_robot(name)
        planner = workers.of(robot).around(Cell(robot, CellRequest()))
        out += [(planner, case.move) for case in cases(robot, planner, count)]
    for planner, move in out:
        planner.solve(move)
    return out


def solved(work: Sequence[tuple[Planner, Move]]) -> list[list[float]]:
    """Loss [J] (infinite where not solved) and processor time [s] of each move."""
    out = []
    for planner, move in work:
        begin = time.process_time()
        result = planner.solve(move)
        loss = result.energy.loss if result.status == "solved" else np.inf
        out.append([loss, time.process_time() - begin])
    return out


def against(found: list[list[float]], whole: list[list[float]]) -> tuple[float, float, float]:
    """Change of the loss in the mean and at worst, and of the time, each in %."""
    (loss, seconds), (least, usual) = np.array(found).T, np.array(whole).T
    more = 100 * (loss / least - 1)
    return float(more.mean()), float(more[np.argmax(np.abs(more))]), 100 * float(seconds.sum() / usual.sum() - 1)


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where a move is not solved with the numbers as they are."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--modules", nargs="+", default=list(MODULES), metavar="MODULE", help="of energy_opt")
    parser.add_argument("--names", nargs="+", metavar="NAME", help="these numbers only")
    parser.add_argument("--every", type=int, default=2, metavar="K", help="every K-th problem among things (2)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="keep the numbers here")
    args = parser.parse_args(words)
    known = json.loads(args.out.read_text()) if args.out and args.out.is_file() else {}
    work, rows, whole, done = tasks(args.every), [], list[list[float]](), 0
    for title in args.modules:
        module = importlib.import_module(f"energy_opt.{title}")
        for name, value in numbers(module).items():
            key = f"{title}.{name}"
            if args.names and name not in args.names:
                continue
            if key not in known:
                whole, turns, done = solved(work) if done % ANEW == 0 else whole, [], done + 1
                for factor in (0.5, 2.0):
                    with instead(name, value, changed(value, factor)):
                        turns.append(against(solved(work), whole))
                known[key] = turns
                if args.out:
                    write_json(args.out, known)
            low, high = known[key]
            idle = all(abs(worst) < 100 * SAME and abs(slower) < SLOWER_BY for _, worst, slower in (low, high))
            rows.append((key, value, *low, *high, "*" if idle else ""))
            print(f"{key} {value}: halved {low}, doubled {high}", flush=True)
    header = ("number", "value", "halved: mean %", "worst %", "time %", "doubled: mean %", "worst %", "time %", "")
    print(table(header, rows))
    lost = sum(not np.isfinite(loss) for loss, _ in solved(work))
    return finish({"numbers": known}, {"all are solved": not lost}, None)


if __name__ == "__main__":
    sys.exit(main())
