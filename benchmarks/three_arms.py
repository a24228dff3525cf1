"""A cell of two Pandas and a UR10e over one table: planned, timed, and judged by Pinocchio and coal alone.

    python benchmarks/three_arms.py [--out FOLDER] [--starts 2]

Every arm has six moves, a payload, a zone over the middle of the table that one arm at a time may be in, and brakes to
wait in. Printed are the levers, the proof between the arms under 20 ms of lateness, the time, and what the judge finds.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import tomli_w
from cell_judge import faults_of_cell

LONGEST = 600.0  # [s] of CPU


def steps(payload: float) -> list[dict]:
    """Six moves: to the middle, down, up with a payload, to one side, to the other without it, and home."""
    return [
        {"name": "to the middle", "to": "above", "zone": "middle"},
        {"name": "down", "to": "middle", "zone": "middle"},
        {"name": "grip", "wait": 0.4, "zone": "middle"},
        {"name": "lift", "to": "above", "payload": payload, "zone": "middle"},
        {"name": "to the left", "to": "left"},
        {"name": "release", "wait": 0.3},
        {"name": "to the right", "to": "right", "payload": 0.0},
        {"name": "home", "to": "rest"},
    ]


def cell() -> dict:
    """The job file."""
    panda = {
        "middle": [0.0, 0.35, 0.0, -1.9, 0.0, 2.25, 0.785],
        "above": [0.0, 0.05, 0.0, -1.9, 0.0, 1.95, 0.785],
        "left": [0.9, 0.3, 0.0, -1.9, 0.0, 2.2, 0.785],
        "right": [-0.9, 0.3, 0.0, -1.9, 0.0, 2.2, 0.785],
        "rest": [0.0, -0.6, 0.0, -2.3, 0.0, 1.7, 0.785],
    }
    ur = {
        "middle": [0.0, -1.25, 1.9, -2.2, -1.57, 0.0],
        "above": [0.0, -1.6, 1.9, -1.87, -1.57, 0.0],
        "left": [1.1, -1.5, 2.0, -2.07, -1.57, 0.0],
        "right": [-1.1, -1.5, 2.0, -2.07, -1.57, 0.0],
        "rest": [0.0, -2.0, 2.2, -1.77, -1.57, 0.0],
    }
    pi = float(np.pi)
    return {
        "format": "energy-opt/job/2",
        "cycle_time": 14.0,
        "jitter": 0.02,
        "mode": [{"name": "brakes", "power": 70.0, "least": 1.5, "enter": [0.3, 30.0], "leave": [0.5, 50.0]}],
        "robot": [
            {"name": "a", "robot": "panda", "base": [0.0] * 6, "poses": panda, "step": steps(1.5)},
            {"name": "b", "robot": "panda", "base": [1.1, 0.0, 0.0, 0.0, 0.0, pi], "poses": panda, "step": steps(1.5)},
            {"name": "c", "robot": "ur10e", "base": [0.55, 1.0, 0.0, 0.0, 0.0, -pi / 2], "poses": ur,
             "step": steps(4.0)},
        ],
    }  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "three_arms")
    parser.add_argument("--starts", type=int, default=2)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    asked = cell()
    file, out = args.out / "cell.toml", args.out / "out"
    file.write_bytes(tomli_w.dumps(asked).encode())
    options = ["--starts", str(args.starts), "--floor", "-0.01", "--force", "--cycles-per-year", "500000"]
    begin = time.monotonic()
    command = [sys.executable, "-m", "energy_opt", "job", file, "--out", out, *options, "--price", "0.25"]
    done = subprocess.run([*command, "--write", "urscript", "--write", "franka", "--quiet"], check=False)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = used.ru_utime + used.ru_stime
    print(f"exit {done.returncode}; {seconds:.0f} s of CPU, {time.monotonic() - begin:.0f} s by the clock")
    if done.returncode:
        return 1
    found = json.loads((out / "job.json").read_text())
    first = found["levers"][0]["energy_total"]
    for lever in found["levers"]:
        print(f"{lever['name']:<8} {lever['energy_total']:>9.1f} J  {100 * (1 - lever['energy_total'] / first):5.1f} %")
    print(f"bound {found['bound']:.1f} J; clearance {found['clearance']['verdict']}, "
          f"{found['clearance']['lower_bound']:.4f} m at least; around {found['around']}")  # fmt: skip
    print("files", {row["file"]: row["valid"] for row in found["written"]})
    faults = faults_of_cell(asked, out)
    print("judge:", faults or "nothing touches")
    good = found["clearance"]["verdict"] == "proven" and not faults and all(row["valid"] for row in found["written"])
    return 0 if good and seconds < LONGEST else 1


if __name__ == "__main__":
    sys.exit(main())
