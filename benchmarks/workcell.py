"""Seeded cells of 2 to 12 robots known by curves: energy, bound, gap and time; each schedule is checked independently.

    python benchmarks/workcell.py [--cells 20] [--seed 1] [--out FILE.json]

A cell is made from a schedule that is possible (so that one exists): lags between robots are drawn around it, moves get
fitted-looking curves a/d + b + c d, waits three modes, some moves of different robots share a zone.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import tomli_w

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from cell_checker import faults_of_schedule

from energy_opt.power import PowerModel
from energy_opt.robot import Robot
from energy_opt.workcell.cell_files import document
from energy_opt.workcell.file import load_workcell
from energy_opt.workcell.solve_cell import run_workcell


def cell(rng: np.random.Generator, robots: int) -> dict:
    """A job file of `robots` robots."""
    cycle = float(rng.uniform(30, 90))
    tables, starts = [], []
    zone_free = 0.0
    for r in range(robots):
        count = int(rng.integers(2, 7))
        shares = rng.dirichlet(np.ones(2 * count)) * cycle * 0.8
        slack, steps, clock = cycle * 0.2, [], float(rng.uniform(0, cycle))
        begins = []
        for k in range(count):
            move, stay = shares[2 * k], shares[2 * k + 1]
            begins.append(clock)
            power = float(rng.uniform(500, 1500))
            peak = move * rng.uniform(0.8, 2.0)  # where the curve is lowest
            steps.append(
                {
                    "name": f"move {k}",
                    "duration": [0.6 * move, 10 * move],
                    "curve": [[-1, power * peak**2], [0, float(rng.uniform(-1, 1) * power)], [1, power]],
                }
            )
            last = k == count - 1
            span = [0.0, cycle] if last else [stay, stay]
            steps.append({"name": f"stay {k}", "wait": span, **({} if last else {"modes": ["motors"]})})
            clock += move + (stay + slack if last else stay)
        if r < 4 and zone_free + shares[0] < cycle:
            steps[0]["zone"] = "fixture"
            zone_free += shares[0]
        motors = float(rng.uniform(500, 900))
        modes = [
            {"name": "motors", "power": motors},
            {"name": "brakes", "power": 0.38 * motors, "least": 2.0, "enter": [0.3, 100.0], "leave": [0.5, 200.0]},
            {"name": "bus off", "power": 0.26 * motors, "least": 15.0},
        ]
        tables.append({"name": f"r{r}", "mode": modes, "step": steps})
        starts.append(begins)
    lags = []
    for r in range(1, robots):
        before = int(rng.integers(0, r))
        one, two = (int(rng.integers(0, len(starts[x]))) for x in (before, r))
        behind = starts[r][two] - starts[before][one]
        height = int(np.ceil(max(0.0, -behind) / cycle))
        lags.append(
            {
                "from": f"r{before}.move {one}",
                "to": f"r{r}.move {two}",
                "length": float(behind + cycle * height - rng.uniform(0.5, 5)),
                "height": height,
            }
        )
    return {"format": "energy-opt/job/2", "cycle_time": cycle, "robot": tables, "lag": lags}


def no_model(name: str | None, robot: Robot) -> PowerModel:
    """These robots are known by their curves."""
    raise AssertionError(name, robot)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    rows = []
    for k in range(args.cells):
        rng = np.random.default_rng([args.seed, k])
        asked = cell(rng, 2 + k % 11)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "cell.toml"
            file.write_bytes(tomli_w.dumps(asked).encode())
            begin = time.process_time()
            result = run_workcell(load_workcell(file), file, model_of=no_model)
            found = document(result)
        row = {
            "robots": len(asked["robot"]),
            "steps": sum(len(robot["step"]) for robot in asked["robot"]),
            "seconds": time.process_time() - begin,
            "energy": found["energy_total"],
            "gap_percent": found["optimality"]["gap_percent"],
            "saved_percent": 100 * (1 - found["energy_total"] / found["levers"][0]["energy_total"]),
            "faults": faults_of_schedule(asked, found),
        }
        rows.append(row)
        print(
            f"{row['robots']:>2} robots {row['steps']:>3} steps {row['seconds']:>7.2f} s  {row['energy']:>12.0f} J  "
            f"gap {row['gap_percent']:.1e} %  saved {row['saved_percent']:.1f} %  {len(row['faults'])} faults"
        )
        for fault in row["faults"]:
            print("   ", fault)
    if args.out:
        args.out.write_text(json.dumps(rows, indent=1))
    wrong = [row for row in rows if row["faults"] or row["gap_percent"] > 1]
    print(f"{len(rows) - len(wrong)} of {len(rows)} cells: no fault, gap at most 1 %")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
