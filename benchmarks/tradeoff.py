"""The front of energy against duration: what do 20 points cost, in cold solves?

    python benchmarks/tradeoff.py

A cold solve is `energy-opt optimize` of one Panda reshape in a fresh process; the front is `energy-opt tradeoff` of the
same move in another, both without compiled functions and with all files written. Measured in one run, alternating, as
processor time (other work on the machine does not enter); the median ratio counts. Exit code 1 beyond the bound.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from energy_opt.files import to_json

MUST = 3.0
ROUNDS = 3
MOVE = [
    *("--robot", "panda", "--start=0,-0.785,0,-2.356,0,1.571,0.785", "--goal=1.2,0.3,0.4,-1.2,-0.5,2.2,-0.4"),
    *("--mode", "reshape", "--compile", "never", "--quiet"),
]


def seconds(arguments: list[str]) -> float:
    """Processor time of `energy-opt` with these arguments, in a fresh process."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "energy_opt", *arguments], check=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime + after.ru_stime) - (before.ru_utime + before.ru_stime)


def main() -> int:
    with tempfile.TemporaryDirectory() as name:
        cold, front = [], []
        for _ in range(ROUNDS):
            cold.append(seconds(["optimize", *MOVE, "--duration", "2", "--out", f"{name}/one"]))
            front.append(seconds(["tradeoff", *MOVE, "--out", f"{name}/front"]))
        found = json.loads((Path(name) / "front" / "tradeoff.json").read_text())
    ratio = float(np.median(np.array(front) / np.array(cold)))
    solved = sum(point["status"] == "solved" for point in found["points"])
    document = {"cold": cold, "front": front, "ratio": ratio, "must": MUST, "solved": solved, "solves": found["solves"]}
    sys.stdout.write(to_json(document))
    return 0 if ratio <= MUST and solved == len(found["points"]) == 20 else 1


if __name__ == "__main__":
    sys.exit(main())
