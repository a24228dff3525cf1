"""What the benchmarks share: the seeded moves, the machine they ran on, tables and files of numbers."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.batches.tables import random_moves
from energy_opt.files import write_json
from energy_opt.motion import Move, Planner
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan import context
from energy_opt.motion.reshape.search import Reshaper
from energy_opt.robot import Robot, load_robot

SUITES = {"panda": 20, "ur5": 10}  # moves of the suites; seed 1, within 60 % of each joint's range
SEED, SLOWER = 1, 1.5  # durations are this multiple of the minimum time
PACKAGES = ("casadi", "pin", "toppra", "numpy", "scipy")


@dataclass(frozen=True)
class Case:
    """A move of a suite at its duration, and the shortest one that TOPP-RA finds [s]."""

    name: str
    move: Move
    fastest: float


def cases(robot: Robot, planner: Planner, count: int | None = None, seed: int = SEED) -> list[Case]:
    """The first `count` moves of the robot's suite, reshaped at 1.5 times the minimum time.

    Another seed gives moves that nothing was ever tuned on.
    """
    total = SUITES.get(robot.name, 10)
    out = []
    for named in random_moves(robot, total, seed)[:count]:
        move = Move(np.array(named.start), np.array(named.goal), "reshape")
        fastest = planner.minimum_time(move)
        timed = Move(move.start, move.goal, "reshape", duration=SLOWER * fastest)
        out.append(Case(named.name, timed, fastest))
    return out


def robots(names: Sequence[str]) -> list[Robot]:
    """Robots by name."""
    return [load_robot(name) for name in names]


def setting() -> dict[str, Any]:
    """Machine and versions, for the record."""
    processor = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text().splitlines()
        named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        processor = named[0] if named else processor
    return {
        "processor": processor,
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in PACKAGES},
    }


class Clock:
    """CPU time spent in some functions, s."""

    def __init__(self) -> None:
        self.seconds, self.depth = 0.0, 0


@contextmanager
def clock(*places: tuple[Any, str]) -> Iterator[Clock]:
    """Adds up, while it is open, the time inside functions: attributes of classes or modules, each time once."""
    found, kept = Clock(), [(owner, name, getattr(owner, name)) for owner, name in places]

    def timed(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            begin = time.process_time()
            found.depth += 1
            try:
                return function(*arguments, **named)
            finally:
                found.depth -= 1
                if not found.depth:  # what one of the functions calls is in its time
                    found.seconds += time.process_time() - begin

        return call

    for owner, name, function in kept:
        setattr(owner, name, timed(function))
    try:
        yield found
    finally:
        for owner, name, function in kept:
            setattr(owner, name, function)


class Kept:
    """Rows of a long benchmark in a file of lines, so that it goes on where it ended; None keeps them in memory."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        there = path is not None and path.is_file()
        self.rows: dict[str, dict[str, Any]] = {}
        for row in map(json.loads, path.read_text().splitlines() if there and path is not None else ()):
            self.rows[row["key"]] = row

    def __call__(self, key: str, find: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """The row of a key; found, printed and kept where it is not there yet."""
        if key not in self.rows:
            row = {"key": key, **find()}
            self.rows[key] = row
            print(json.dumps(row), flush=True)
            if self._path is not None:
                with self._path.open("a") as stream:
                    stream.write(json.dumps(row) + "\n")
        return self.rows[key]


# Reshaping proper: all starts, refinement, and solves that repair limits; and judging: samples, energy, limits.
SEARCH = ((Reshaper, "search"), (Reshaper, "solved"))
JUDGING = ((Scorer, "dense"), (Scorer, "energy_of"), (context, "certificate_of"))


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Rows as aligned text; floats with four significant digits."""
    cells = [list(header)] + [[f"{x:.4g}" if isinstance(x, float) else str(x) for x in row] for row in rows]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    return "\n".join("  ".join(x.rjust(w) for x, w in zip(row, widths, strict=True)) for row in cells)


def finish(document: dict[str, Any], checks: dict[str, bool], out: Path | None) -> int:
    """Print machine and verdicts, write the numbers if asked; the exit code, 1 where a bound is not held."""
    where = setting()
    print("\n" + ", ".join(f"{key} {value}" for key, value in where.items()))
    for name, held in checks.items():
        print(f"{'held' if held else 'MISSED':>6}  {name}")
    if out is not None:
        write_json(out, {**document, "checks": checks, "setting": where})
    sys.stdout.flush()
    return 0 if all(checks.values()) else 1
