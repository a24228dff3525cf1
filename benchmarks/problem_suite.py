"""A thousand seeded moves on each of five arms, of every kind that users ask for, judged by a second evaluator.

    python benchmarks/problem_suite.py --count 1000 --jobs 8 --out problem_suite     # goes on where it stopped
    python benchmarks/problem_suite.py --count 40 --out sample --arms panda ur5

Conditions are drawn: retime or reshape; free, 1.2, 1.5 or 3 times the minimum time; anywhere, near limits, tiny; with
payload or without. Every answer is judged anew by `tests/independent.py`, which shares no code with the package: its
energy, its limits, and that it is not worse than its baselines. An answer "infeasible" is checked by a feasibility test
of its own: the straight line in smooth steps, ever slower, by the second evaluator.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parents[1] / "tests")]

from independent import Arm, judged  # noqa: E402

import energy_opt as eo  # noqa: E402

ARMS = ("panda", "ur5", "ur5e", "xarm7", "z1")
SLOWNESS = (None, 1.2, 1.5, 3.0)  # of the minimum time; None is free
KINDS = ("anywhere", "near limits", "tiny")
SAME = 1e-4  # relative difference of energies: kinks between rows are integrated by other rules
ALLOWED = 2e-6  # of a bound
OUTLIER = 10.0  # times the median time of its kind


def draw(robot: eo.Robot, rng: np.random.Generator) -> dict[str, Any]:
    """One case: ends, mode, slowness, payload."""
    low = np.where(np.isfinite(robot.limits.lower), robot.limits.lower, -np.pi)
    high = np.where(np.isfinite(robot.limits.upper), robot.limits.upper, np.pi)
    kind = str(rng.choice(KINDS, p=[0.6, 0.2, 0.2]))
    share = 0.998 if kind == "near limits" else 0.6
    middle, half = (low + high) / 2, share * (high - low) / 2
    start = middle + half * rng.uniform(-1, 1, robot.n)
    goal = middle + half * rng.uniform(-1, 1, robot.n)
    if kind == "near limits":
        j = int(rng.integers(robot.n))
        goal[j] = middle[j] + half[j] * rng.choice([-1, 1])
    if kind == "tiny":
        goal = np.clip(start + 10 ** rng.uniform(-9, -2) * rng.uniform(-1, 1, robot.n), low, high)
    return {
        "kind": kind,
        "mode": str(rng.choice(["retime", "reshape"])),
        "slowness": SLOWNESS[int(rng.integers(len(SLOWNESS)))],
        "payload": float(rng.choice([0.0, 0.0, 0.5, 1.5])),
        "start": start.tolist(),
        "goal": goal.tolist(),
    }


def second(robot: eo.Robot, payload: float) -> Arm:
    """The independent arm."""
    arm = Arm(Path(robot.urdf).read_text(encoding="utf-8"), robot.joints, dict(robot.locked))
    if payload:
        arm.carry(payload, np.zeros(3))
    return arm


def hopeless(robot: eo.Robot, arm: Arm, case: dict[str, Any], duration: float | None, copper: np.ndarray) -> bool:
    """Does the straight line in a smooth step break limits, in the time asked for or however slow it is?"""
    start, goal = np.array(case["start"]), np.array(case["goal"])
    u = np.linspace(0, 1, 400)[:, None]
    s, ds, dds = u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2, 60 * u * (1 - 3 * u + 2 * u**2)
    bounds = asdict(robot.limits)
    for time_of in [duration] if duration else 0.1 * 2.0 ** np.arange(12):
        rows = (u[:, 0] * time_of, start + s * (goal - start), ds * (goal - start) / time_of,
                dds * (goal - start) / time_of**2)  # fmt: skip
        if judged(arm, bounds, 0.0, copper, rows)[1] <= 0:
            return False
    return True


def solve(arm_name: str, number: int) -> dict[str, Any]:
    """Draw and solve one case, and judge it."""
    robot = eo.load_robot(arm_name)
    case = draw(robot, np.random.default_rng([ARMS.index(arm_name), number]))
    model = eo.source_model(robot)
    standby, copper = (next(e for e in model.effects if e.name == name) for name in ("standby", "copper_loss"))
    if case["payload"]:
        model = model.replaced(eo.Payload(mass=case["payload"], com=np.zeros(3)))
    row = {"arm": arm_name, "number": number, **case, "duration": None}
    begin = time.process_time()
    other, loss = second(robot, case["payload"]), np.full(robot.n, float(copper.values["r_over_kt2"][0]))
    duration = None
    try:
        planner = eo.Planner(robot, model, eo.Settings(starts=4, compile="never"))
        move = eo.Move(case["start"], case["goal"], case["mode"])
        if case["slowness"] is not None:
            duration = case["slowness"] * planner.minimum_time(move)
            move = eo.Move(case["start"], case["goal"], case["mode"], duration=duration)
        result = planner.solve(move)
    except eo.Infeasible as error:
        confirmed = hopeless(robot, other, case, duration, loss)
        return {**row, "status": "infeasible", "confirmed": confirmed, "say": str(error)[:200],
                "seconds": time.process_time() - begin}  # fmt: skip
    except Exception as error:
        return {**row, "status": "fault", "say": f"{type(error).__name__}: {error}"[:300],
                "seconds": time.process_time() - begin}  # fmt: skip
    seconds, t = time.process_time() - begin, result.trajectory
    energy, excess = judged(
        other,
        asdict(robot.limits),
        float(standby.values["power"][0]),
        loss,
        (t.time, t.position, t.velocity, t.acceleration),
    )
    best = min((b.energy.total for b in result.baselines if b.valid and abs(b.duration / t.duration - 1) < 1e-9),
               default=np.inf)  # fmt: skip
    ends = max(np.abs(t.position[0] - move.start).max(), np.abs(t.position[-1] - move.goal).max())
    return {
        **row, "status": result.status, "seconds": seconds, "duration": t.duration, "say": result.message[:200],
        "violation": result.certificate.violation, "excess": excess, "ends": float(ends),
        "energy_error": abs(energy - result.energy.total) / max(abs(energy), 1e-9),
        "worse": float(result.energy.total / best - 1) if np.isfinite(best) else None,
    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    """A line per arm and mode, and every case that is not as it should be."""
    lines = [f"{'arm':8} {'mode':8} {'cases':>6} {'solved':>7} {'infeas.':>8} {'wrong':>6} {'worse':>6} {'median s':>9}"
             f" {'max s':>8} {'outliers':>9}"]  # fmt: skip
    strange: list[str] = []
    for arm in ARMS:
        for mode in ("retime", "reshape"):
            mine = [r for r in rows if r["arm"] == arm and r["mode"] == mode]
            if not mine:
                continue
            median = float(np.median([r["seconds"] for r in mine]))
            slow = [r for r in mine if r["seconds"] > OUTLIER * median]
            wrong = [r for r in mine if r.get("excess", 0) > ALLOWED or r.get("energy_error", 0) > SAME]
            worse = [r for r in mine if (r.get("worse") or 0) > 1e-9]
            open_ = [r for r in mine if r["status"] not in ("solved", "infeasible")]
            open_ += [r for r in mine if r["status"] == "infeasible" and not r["confirmed"]]
            solved, none = (sum(r["status"] == s for r in mine) for s in ("solved", "infeasible"))
            lines.append(f"{arm:8} {mode:8} {len(mine):6d} {solved:7d} {none:8d} {len(wrong):6d} {len(worse):6d} "
                         f"{median:9.2f} {max(r['seconds'] for r in mine):8.2f} {len(slow):9d}")  # fmt: skip
            for what, found in (("wrong", wrong), ("worse", worse), ("not solved", open_), ("slow", slow)):
                strange += [
                    f"  {what}: {r['arm']} {r['number']} {r['mode']} {r['kind']} {r['slowness']} {r['payload']:g} kg: "
                    f"{r['status']}, {r['seconds']:.1f} s, excess {r.get('excess')}, "
                    f"energy error {r.get('energy_error')}, "
                    f"worse {r.get('worse')}, {r['say']}"
                    for r in found
                ]
    return "\n".join([*lines, *strange])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000, help="moves per arm")
    parser.add_argument("--arms", nargs="+", default=list(ARMS), choices=ARMS)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("problem_suite"))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    journal = args.out / "cases.jsonl"
    rows = [json.loads(x) for x in journal.read_text().splitlines() if x.endswith("}")] if journal.exists() else []
    done = {(r["arm"], r["number"]) for r in rows}
    left = [(arm, k) for k in range(args.count) for arm in args.arms if (arm, k) not in done]
    with ProcessPoolExecutor(args.jobs) as pool, journal.open("a") as stream:
        for row in pool.map(solve, *zip(*left, strict=True)) if left else ():
            rows.append(row)
            stream.write(json.dumps(row) + "\n")
            stream.flush()
    print(table([r for r in rows if r["arm"] in args.arms and r["number"] < args.count]))


if __name__ == "__main__":
    main()
