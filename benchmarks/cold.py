"""A first answer from cold: the command line with an empty cache, against importing the libraries it stands on.

    python benchmarks/cold.py [--repeats 5] [--out numbers.json]

`energy-opt optimize` of the README's move in a fresh process, nothing compiled, with everything that it writes; and
`python -c "import casadi, pinocchio, toppra"`. They take turns, wall time, medians. One unmeasured run of each comes
first, so that files are in the system's memory for both.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from common import finish, table

MUST = 4.0
IMPORTS = ("-c", "import casadi, pinocchio, toppra")
MOVE = ("-m", "energy_opt", "optimize", "--robot", "panda", "--start", "0,-0.785,0,-2.356,0,1.571,0.785",
        "--goal", "1.2,0.3,0.4,-1.2,-0.5,2.2,-0.4", "--duration", "2", "--mode", "reshape")  # fmt: skip


def run(words: Sequence[str], folder: Path) -> tuple[float, float]:
    """Wall and CPU time [s] of a fresh interpreter whose cache is in `folder`."""
    environment = {**os.environ, "ENERGY_OPT_CACHE": str(folder / "cache")}
    before, begin = os.times(), time.perf_counter()
    subprocess.run([sys.executable, *words], check=True, env=environment, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - begin, os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return wall, cpu


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where the bound is not held."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", "--moves", type=int, default=5, help="runs of each that are measured (5)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the numbers")
    args = parser.parse_args(words)
    runs: dict[str, list[tuple[float, float]]] = {"imports": [], "optimize": []}
    for _ in range(args.repeats + 1):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            runs["imports"].append(run(IMPORTS, folder))
            runs["optimize"].append(run((*MOVE, "--out", str(folder / "out")), folder))
    measured = {name: np.array(values[1:]) for name, values in runs.items()}
    median = {name: np.median(values, axis=0).tolist() for name, values in measured.items()}
    ratio = float(np.median(measured["optimize"][:, 0] / measured["imports"][:, 0]))
    print(table(("what", "wall s", "CPU s"), [[name, *values] for name, values in median.items()]))
    document = {"ratio": ratio, "must": MUST, **{name: values.tolist() for name, values in measured.items()}}
    return finish(document, {f"cold: {ratio:.2f} times the imports, at most {MUST:.0f}": ratio <= MUST}, args.out)


if __name__ == "__main__":
    sys.exit(main())
