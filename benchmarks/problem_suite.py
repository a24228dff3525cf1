"""A thousand seeded moves on each of five arms, of every kind that users ask for, judged by a second evaluator.

    python benchmarks/problem_suite.py --count 1000 --jobs 8 --out problem_suite     # goes on where it stopped
    python benchmarks/problem_suite.py --count 40 --out sample --arms panda ur5
    python benchmarks/problem_suite.py --count 200 --out new
    ENERGY_OPT=../old python benchmarks/problem_suite.py --count 200 --out old --arms-of new  # that package
    python benchmarks/problem_suite.py --count 200 --out new --against old  # compares the answers

Conditions are drawn: retime or reshape; free, 1.2, 1.5 or 3 times the minimum time; anywhere, near limits, tiny; with
payload or without. Every answer is judged anew by `tests/independent.py`, which shares no code with the package: its
energy, its limits, and that it is not worse than its baselines. An answer "infeasible" is confirmed by
`tests/feasibility.py`: a linear program over the line's timings, and trees of poses that the arm can hold.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

HERE = Path(__file__).resolve().parents[1]
sys.path[:0] = [os.environ.get("ENERGY_OPT", str(HERE)), str(HERE / "tests")]

from feasibility import holds, line_has_timing, some_path  # noqa: E402
from independent import Arm, judged  # noqa: E402

import energy_opt as eo  # noqa: E402

ARMS = ("panda", "ur5", "ur5e", "xarm7", "z1")
SLOWNESS = (None, 1.2, 1.5, 3.0)  # of the minimum time; None is free
KINDS = ("anywhere", "near limits", "tiny")
SAME = 1e-4  # relative difference of energies: kinks between rows are integrated by other rules
ALLOWED = 2e-6  # of a bound
ENOUGH = 0.995  # of the feasible moves are to be solved
OUTLIER = 10.0  # times the median time of its kind
NOTABLE = 0.01  # share of the loss
WORST = 3  # cases that a comparison names


@cache
def arm_of(name: str, folder: Path | None) -> tuple[eo.Robot, eo.PowerModel]:
    """An arm and its model; with the limits and electrical values that another run left in `folder`, if given."""
    if folder is None:
        robot = eo.load_robot(name)
        return robot, eo.source_model(robot)
    robot = eo.load_robot(name, limits=folder / f"{name}.yaml")
    model = eo.source_model(robot)
    for effect, values in json.loads((folder / f"{name}.json").read_text()).items():
        kind = next(type(own) for own in model.effects if own.name == effect)
        model = model.replaced(kind(**{key: np.array(x) if len(x) > 1 else x[0] for key, x in values.items()}))
    return robot, model


def keep_arm(name: str, folder: Path) -> None:
    """Write an arm's limits and electrical values into `folder`, for a run of another state of the package."""
    robot, model = arm_of(name, None)
    rates = ("velocity", "acceleration", "jerk", "effort")
    limits = {
        joint: {
            key: value
            for rate in rates
            for key, value in ((f"has_{rate}_limits", True), (f"max_{rate}", float(getattr(robot.limits, rate)[j])))
        }
        for j, joint in enumerate(robot.joints)
    }
    (folder / f"{name}.yaml").write_text(yaml.safe_dump({"joint_limits": limits}))
    values = {effect.name: {key: x.tolist() for key, x in effect.values.items()} for effect in model.effects}
    (folder / f"{name}.json").write_text(json.dumps(values))


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


def no_way(robot: eo.Robot, arm: Arm, case: dict[str, Any]) -> str:
    """Why a move cannot be done, by a second opinion; empty where that finds a way."""
    start, goal, bounds = np.array(case["start"]), np.array(case["goal"]), asdict(robot.limits)
    for what, held in zip(("start", "goal"), holds(arm, bounds, np.array([start, goal])), strict=True):
        if not held:
            return f"the {what} cannot be held"
    if line_has_timing(arm, bounds, start, goal):
        return ""
    if case["mode"] == "retime":
        return "the line has no timing"
    return "" if some_path(arm, bounds, start, goal, 0) else "no path of poses that can be held was found"


def shortest(planner: eo.Planner, move: eo.Move) -> float | None:
    """The straight line's minimum time, s; None where it has none and a move with a free path is asked for."""
    try:
        return planner.minimum_time(move)
    except eo.Infeasible:
        if move.mode == "retime":
            raise
        return None


def solve(arm_name: str, number: int, folder: Path | None = None) -> dict[str, Any]:
    """Draw and solve one case, and judge it; `folder`: see `arm_of`."""
    case = draw(arm_of(arm_name, folder)[0], np.random.default_rng([ARMS.index(arm_name), number]))
    return judged_answer(arm_name, case, folder) | {"number": number}


def judged_answer(arm_name: str, case: dict[str, Any], folder: Path | None = None) -> dict[str, Any]:
    """Solve a case and judge the answer by the second evaluator."""
    robot, model = arm_of(arm_name, folder)
    standby, copper = (next(e for e in model.effects if e.name == name) for name in ("standby", "copper_loss"))
    if case["payload"]:
        model = model.replaced(eo.Payload(mass=case["payload"], com=np.zeros(3)))
    row = {"arm": arm_name, **case, "duration": None}
    begin = time.process_time()
    other, loss = second(robot, case["payload"]), np.broadcast_to(copper.values["r_over_kt2"], robot.n)
    try:
        planner = eo.Planner(robot, model, eo.Settings(starts=4, compile="never"))
        move = eo.Move(case["start"], case["goal"], case["mode"])
        fastest = None if case["slowness"] is None else shortest(planner, move)
        if fastest is not None:
            move = replace(move, duration=case["slowness"] * fastest)
        result = planner.solve(move)
    except eo.Infeasible as error:
        return {**row, "status": "infeasible", "reason": no_way(robot, other, case), "say": str(error)[:200],
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
        "total": result.energy.total, "loss": result.energy.loss,
    }  # fmt: skip


def faults(row: dict[str, Any]) -> list[str]:
    """What is wrong with a row; nothing where it is as it should be."""
    out = []
    if row["status"] == "infeasible" and not row["reason"]:
        out.append("infeasible, but there is a way")
    elif row["status"] not in ("solved", "infeasible"):
        out.append("not solved")
    if row["status"] == "solved" and (row["excess"] > ALLOWED or row["energy_error"] > SAME or row["ends"] > 1e-9):
        out.append("wrong")
    if (row.get("worse") or 0) > 1e-9:
        out.append("worse")
    return out


def table(rows: list[dict[str, Any]]) -> str:
    """A line per arm and mode, and every case that is not as it should be."""
    lines = [f"{'arm':8} {'mode':8} {'cases':>6} {'solved':>7} {'infeas.':>8} {'of feasible':>11} {'wrong':>6}"
             f" {'worse':>6} {'median s':>9} {'max s':>8} {'outliers':>9}"]  # fmt: skip
    strange: list[str] = []
    for arm, mode in [(a, m) for a in [*ARMS, "all"] for m in ("retime", "reshape", "both")]:
        mine = [r for r in rows if arm in (r["arm"], "all") and mode in (r["mode"], "both")]
        if not mine or (arm == "all") != (mode == "both"):
            continue
        found = [(r, faults(r)) for r in mine]
        solved = sum(r["status"] == "solved" for r in mine)
        none = sum(r["status"] == "infeasible" and not f for r, f in found)
        share = 100 * solved / max(len(mine) - none, 1)
        counts = [sum(what in f for _, f in found) for what in ("wrong", "worse")]
        median = float(np.median([r["seconds"] for r in mine]))
        slow = [r for r in mine if r["seconds"] > OUTLIER * median]
        lines.append(f"{arm:8} {mode:8} {len(mine):6d} {solved:7d} {none:8d} {share:9.2f} % {counts[0]:6d} "
                     f"{counts[1]:6d} {median:9.2f} {max(r['seconds'] for r in mine):8.2f} {len(slow):9d}")  # fmt: skip
        if arm != "all":
            named = [*((r, what) for r, f in found for what in f), *((r, "slow") for r in slow)]
            strange += [f"  {what}: {described(r)}" for r, what in named]
    return "\n".join([*lines, *strange])


def against(rows: list[dict[str, Any]], other: list[dict[str, Any]]) -> str:
    """Losses and processor times of two runs of the same cases."""
    theirs = {(row["arm"], row["number"]): row for row in other}
    pairs = [(row, theirs[row["arm"], row["number"]]) for row in rows if (row["arm"], row["number"]) in theirs]
    lines = [f"{len(pairs)} cases in both; status differs in {sum(a['status'] != b['status'] for a, b in pairs)}"]
    for mode in ("retime", "reshape"):
        both = [(a, b) for a, b in pairs if a["mode"] == mode and a.get("loss") and b.get("loss")]
        gain = np.array([1 - a["loss"] / b["loss"] for a, b in both])
        ratio = np.median([b["seconds"] / a["seconds"] for a, b in both])
        lines.append(
            f"{mode}: {len(both)} solved in both; {100 * gain.mean():+.2f} % of the loss saved beyond the other run in "
            f"the mean; {(gain > NOTABLE).sum()} cases save over 1 % more, {(gain < -NOTABLE).sum()} over 1 % less; "
            f"{ratio:.2f} times as fast in the median"
        )
        for k in np.argsort(gain)[: WORST * bool((gain < -NOTABLE).any())]:
            lines.append(f"  {-100 * gain[k]:.1f} % more loss: {described(both[k][0])}")
    return "\n".join(lines)


def described(row: dict[str, Any]) -> str:
    """A case in a line."""
    numbers = ", ".join(f"{n} {row[n]:.3g}" for n in ("excess", "energy_error", "worse") if row.get(n) is not None)
    return (
        f"{row['arm']} {row['number']} {row['mode']} {row['kind']} {row['slowness'] or 'free'} {row['payload']:g} kg: "
        f"{row['status']}, {row['seconds']:.1f} s, {numbers or 'no trajectory'}; {row['say']}"
    )


def read(journal: Path) -> list[dict[str, Any]]:
    """The whole records of a journal."""
    return [json.loads(x) for x in journal.read_text().splitlines() if x.endswith("}")] if journal.exists() else []


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000, help="moves per arm")
    parser.add_argument("--arms", nargs="+", default=list(ARMS), choices=ARMS)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("problem_suite"))
    parser.add_argument("--every", type=float, default=120.0, metavar="S", help="seconds between tables on the way")
    parser.add_argument("--arms-of", type=Path, metavar="OUT", help="limits and models of another run's folder")
    parser.add_argument("--against", type=Path, metavar="OUT", help="compare with the answers in another run's folder")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    if args.arms_of is None:
        for arm in args.arms:
            keep_arm(arm, args.out)
    journal = args.out / "cases.jsonl"
    rows = read(journal)
    done = {(r["arm"], r["number"]) for r in rows}
    left = [(arm, k) for k in range(args.count) for arm in args.arms if (arm, k) not in done]
    shown = time.monotonic()
    with ProcessPoolExecutor(args.jobs) as pool, journal.open("a") as stream:
        for row in pool.map(solve, *zip(*left, strict=True), [args.arms_of] * len(left)) if left else ():
            rows.append(row)
            stream.write(json.dumps(row) + "\n")
            stream.flush()
            if faults(row):
                print(f"{', '.join(faults(row))}: {described(row)}", flush=True)
            if time.monotonic() - shown > args.every:
                shown = time.monotonic()
                print(table(rows), flush=True)
    mine = [r for r in rows if r["arm"] in args.arms and r["number"] < args.count]
    print(table(mine))
    if args.against is not None:
        print(against(mine, read(args.against / "cases.jsonl")))
    bad = [what for r in mine for what in faults(r)]
    solved = sum(r["status"] == "solved" for r in mine)
    feasible = len(mine) - sum(r["status"] == "infeasible" and not faults(r) for r in mine)
    return 1 if {"wrong", "worse"} & set(bad) or solved < ENOUGH * feasible else 0


if __name__ == "__main__":
    sys.exit(main())
