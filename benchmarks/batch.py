"""Batches: does a second worker pay, and does memory stay flat?

    python benchmarks/batch.py [--moves 2000] [--reshaped 400]

Speed: the same moves with one and with two workers, alternating, in one run; the ratio of moves per second, start of
the workers included, of the better of each. Where other work fills the cores that ratio means nothing; beside it
stands what the workers' processor time allows on free ones. Memory: that many short moves through one worker; its
resident memory after the first hundred against every later move. Exit code 1 where a bound is not held.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.batches.batch import run_batch
from energy_opt.batches.records import NAME, read_journal
from energy_opt.batches.suite import Suite, load_suite
from energy_opt.files import write_text

SPEEDUP = 1.7
DRIFT = 0.10
WARM_UP = 100  # moves that a worker may take to reach its size

SUITE = """format = "energy-opt/suite/1"
name = "{name}"
robots = ["panda"]
random = {{ count = {count}, seed = 7, range = 0.6 }}
modes = ["{mode}"]
durations = ["1.5x"]
"""


def suite_of(folder: Path, name: str, count: int, mode: str) -> Suite:
    path = folder / f"{name}.toml"
    write_text(path, SUITE.format(name=name, count=count, mode=mode))
    return load_suite(path, compile="never")  # neither ratio is about the compiler


def speedup(folder: Path, moves: int, rounds: int) -> dict[str, Any]:
    """Moves per second with one and two workers."""
    suite = suite_of(folder, "speed", moves, "reshape")
    best, spent = {1: 0.0, 2: 0.0}, {1: np.inf, 2: np.inf}
    for k in range(rounds):
        for jobs in best:
            before = processor_time()
            batch = run_batch(suite, folder / f"speed{k}{jobs}", jobs=jobs)
            best[jobs] = max(best[jobs], batch.summary["run"]["moves_per_second"])
            spent[jobs] = min(spent[jobs], processor_time() - before)
    return {
        "moves": moves,
        "one": best[1],
        "two": best[2],
        "ratio": best[2] / best[1],
        "must": SPEEDUP,
        "ratio_on_free_cores": float(2 * spent[1] / spent[2]),
    }


def processor_time() -> float:
    """Processor time of all workers that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def memory(folder: Path, moves: int, mode: str) -> dict[str, Any]:
    """Resident memory of one worker over many moves, as shares of what it is after the first hundred."""
    out = folder / f"memory_{mode}"
    run_batch(suite_of(folder, out.name, moves, mode), out, jobs=1)
    sizes = np.array([record["worker"]["memory"] for record in read_journal(out / NAME)[1]], dtype=float)
    first = np.median(sizes[WARM_UP : WARM_UP + 20])
    later = sizes[WARM_UP:] / first
    return {
        "mode": mode,
        "moves": len(sizes),
        "megabytes": float(first) / 1e6,
        "least": float(later.min()),
        "most": float(later.max()),
        "must": DRIFT,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=2000, help="retimed moves of the memory run (2000)")
    parser.add_argument("--reshaped", type=int, default=400, help="reshaped moves of the memory run (400)")
    parser.add_argument("--speed-moves", type=int, default=40, help="moves of the speed run (40)")
    parser.add_argument("--rounds", type=int, default=2, help="rounds of the speed run (2)")
    args = parser.parse_args()
    if min(args.moves, args.reshaped) < 2 * WARM_UP:
        parser.error(f"--moves, --reshaped: at least {2 * WARM_UP}")
    held = True
    show({"cores": len(os.sched_getaffinity(0)), "load": os.getloadavg()[0]})
    with tempfile.TemporaryDirectory() as name:
        speed = speedup(Path(name), args.speed_moves, args.rounds)
        show({"speedup": speed})
        held &= speed["ratio"] >= SPEEDUP
        for mode, moves in (("retime", args.moves), ("reshape", args.reshaped)):
            size = memory(Path(name), moves, mode)
            show({"memory": size})
            held &= 1 - DRIFT <= size["least"] <= size["most"] <= 1 + DRIFT
    return 0 if held else 1


def show(found: dict[str, Any]) -> None:
    """Print one measurement as soon as it is made."""
    sys.stdout.write(json.dumps(found) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
