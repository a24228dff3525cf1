"""Two arms whose straight schedules collide: how many are solved, and does anything touch by a judge of its own?

    python benchmarks/two_arms.py [--count 30] [--seed 1] [--first 0] [--out FILE.json]

Each of two arms goes to and fro between two random poses in front of it. Kept are problems in which both begin free of
each other, end free of each other, and touch where both go straight at the same time or one a sixth of the move
earlier. The cycle takes 1.5 times what the slower arm takes at 60 % of its joints' speeds. In every other problem both
arms must begin their moves together, so that no shift of times helps.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import tomli_w
from cell_judge import Body, faults_of_cell, touching

REST = {"panda": [0.0, 0.1, 0.0, -1.9, 0.0, 2.0, 0.785], "ur5": [0.0, -1.4, 1.7, -1.87, -1.57, 0.0]}
SPREAD = {"panda": [0.9, 0.4, 0.2, 0.4, 0.2, 0.3, 0.5], "ur5": [0.9, 0.4, 0.4, 0.4, 0.3, 0.5]}
SPEED = {"panda": [2.175] * 4 + [2.61] * 3, "ur5": [3.15] * 3 + [3.2] * 3}
JOINTS = {
    "panda": [f"panda_joint{k}" for k in range(1, 8)],
    "ur5": ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint",
            "wrist_3_joint"],
}  # fmt: skip
PAIRS = [("panda", "panda"), ("ur5", "ur5"), ("panda", "ur5")]
SAMPLES = 100
EARLIER = SAMPLES // 6  # samples by which one arm may be ahead without anything changed: they touch all the same
AT = [(slice(None), slice(None)), (slice(EARLIER, None), slice(None, -EARLIER)),
      (slice(None, -EARLIER), slice(EARLIER, None))]  # fmt: skip
TOGETHER = 0.1  # [s]


def free(body: Body, q: np.ndarray) -> bool:
    """Is the arm above the table, and its links apart that have two joints between them?"""
    _, origin = body.placed(q[None])
    return bool(origin[0, 3:, 2].min() > 0.08)


def problem(rng: np.random.Generator, together: bool) -> dict:
    """A cell in which straight moves at the same time touch; `together`: both moves begin within 0.1 s."""
    while True:
        kinds = PAIRS[int(rng.integers(len(PAIRS)))]
        gap = float(rng.uniform(0.7, 0.9))
        bases = [[0.0] * 6, [gap, float(rng.uniform(-0.15, 0.15)), 0.0, 0.0, 0.0, float(np.pi)]]
        bodies = [Body(kind, JOINTS[kind], base) for kind, base in zip(kinds, bases, strict=True)]
        ends = []
        for kind in kinds:
            at = np.array(REST[kind]) + rng.uniform(-1, 1, (2, len(REST[kind]))) * SPREAD[kind]
            at[:, 0] = np.array([-1, 1]) * rng.choice([-1, 1]) * rng.uniform(0.35, 0.9, 2)  # across the middle
            ends.append(at)
        if not all(free(body, q) for body, at in zip(bodies, ends, strict=True) for q in at):
            continue
        x = np.linspace(0, 1, SAMPLES)
        s = (x**3 * (10 - 15 * x + 6 * x**2))[:, None]
        placed = [body.placed(at[0] + s * (at[1] - at[0])) for body, at in zip(bodies, ends, strict=True)]
        still = [tuple(part[[0, -1]] for part in p) for p in placed]
        if touching(*bodies, *still) is not None or not all(
            touching(*bodies, *(tuple(x[r] for x in p) for p, r in zip(placed, rows, strict=True))) for rows in AT
        ):
            continue
        slowest = max(
            float((np.abs(at[1] - at[0]) / np.array(SPEED[kind])).max()) for kind, at in zip(kinds, ends, strict=True)
        )
        robots = [
            {
                "name": name,
                "robot": kind,
                "base": base,
                "step": [{"name": "there", "to": at[1].tolist()}, {"name": "back", "to": at[0].tolist()}],
            }
            for name, kind, base, at in zip("ab", kinds, bases, ends, strict=True)
        ]
        cycle = round(1.5 * 2 * (slowest / 0.6 + 0.2), 3)
        lags = [
            {"from": f"{one}.{step}", "to": f"{two}.{step}", "length": -TOGETHER}
            for step in ("there", "back")
            for one, two in ("ab", "ba")
        ]
        cell = {"format": "energy-opt/job/2", "cycle_time": cycle, "jitter": 0.02, "robot": robots}
        return cell | ({"lag": lags} if together else {})


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    rows = []
    for k in range(args.first, args.first + args.count):
        asked = problem(np.random.default_rng([args.seed, k]), k % 2 == 1)
        with tempfile.TemporaryDirectory() as name:
            file, out = Path(name) / "cell.toml", Path(name) / "out"
            file.write_bytes(tomli_w.dumps(asked).encode())
            begin = time.monotonic()
            command = [sys.executable, "-m", "energy_opt", "job", file, "--out", out, "--model", "source-method-2"]
            done = subprocess.run([*command, "--starts", "1", "--quiet"], capture_output=True, text=True, check=False)
            seconds = time.monotonic() - begin
            faults = faults_of_cell(asked, out) if done.returncode == 0 else []
            found = json.loads((out / "job.json").read_text()) if done.returncode == 0 else {}
        row = {"problem": k, "robots": [r["robot"] for r in asked["robot"]], "code": done.returncode,
               "seconds": seconds, "around": found.get("around"), "faults": faults,
               "levers": found.get("levers"), "said": done.stderr[-300:]}  # fmt: skip
        rows.append(row)
        print(
            f"{k:>3} {'-'.join(row['robots']):<12} exit {done.returncode}  {seconds:6.1f} s  {row['around']}  {faults}"
        )
        if done.returncode:
            print("   ", done.stderr.strip()[-300:])
        sys.stdout.flush()
    if args.out:
        args.out.write_text(json.dumps(rows, indent=1))
    solved = sum(row["code"] == 0 for row in rows)
    print(f"{solved} of {len(rows)} solved; {sum(bool(row['faults']) for row in rows)} touch by the judge")
    return 0 if solved >= 0.9 * len(rows) and not any(row["faults"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
