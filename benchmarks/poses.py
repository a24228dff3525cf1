"""Moves to poses of the tool: how many are solved, what the choice of the joint goal saves, and what it costs.

    python benchmarks/poses.py [--moves 60] [--first 0] [--enumerate 20] [--jobs 6] [--arms panda ur5e ...]
                               [--keep rows.jsonl] [--out FILE]

Poses are those of seeded random configurations that touch nothing, so each is reachable; half of them leave the turn
about the tool's z free, every third move has boxes around it. Durations are 1.5 times the shortest of the move to the
nearest goal. Every answer is judged from its written file: the pose by Pinocchio from the URDF, contact between samples
by the many poses of dense_judge.py (Pinocchio and coal). Enumeration takes every branch at every 15 degrees of the free
turn and, of arms with seven joints, of their redundancy; of each goal also those with one joint a whole turn away.
Seconds are CPU times. A row that was kept is not computed again.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from common import Kept, finish, table
from dense_judge import DenseJudge

import energy_opt as eo
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import EnergyOptError, Infeasible
from energy_opt.front.models import rivals_from
from energy_opt.poses.cheapest_move import nearest_move
from energy_opt.poses.distance import kept_by
from energy_opt.poses.given import Ends
from energy_opt.poses.inverse import ToolKinematics, reach
from energy_opt.poses.pose import Freedom, Pose
from energy_opt.robot import load_robot

ARMS = ("panda", "ur5e", "ur10e", "xarm7", "z1", "iiwa")
MODEL = "source-method-2"
TURNS = 24  # of a free axis, 15 degrees each
MOST = 30  # goals of an enumeration that are solved in full


def arm(name: str) -> Any:
    """An arm by its name; the iiwa is that of PyPI's pybullet (`pip install pybullet`), which need not be imported."""
    if name != "iiwa":
        return load_robot(name)
    found = importlib.util.find_spec("pybullet_data")
    if found is None or found.origin is None:
        raise SystemExit("the iiwa is in pybullet: pip install pybullet, or give --arms without it")
    return load_robot(str(Path(found.origin).parent / "kuka_iiwa" / "model.urdf"))


def placed(robot: Any, q: np.ndarray) -> np.ndarray:
    """The last joint's frame (4, 4) by a model that Pinocchio reads from the URDF itself."""
    model = pin.buildModelFromUrdf(str(robot.urdf))
    full = pin.neutral(model)
    for name, value in zip(robot.joints, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        full[joint.idx_q : joint.idx_q + joint.nq] = [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
    data = model.createData()
    pin.forwardKinematics(model, data, full)
    return data.oMi[model.getJointId(robot.joints[-1])].homogeneous


def boxes(robot: Any, rng: np.random.Generator, ends: list[np.ndarray], folder: Path) -> Path | None:
    """A scene of three boxes that neither end touches; None where none was drawn."""
    reach_ = np.linalg.norm(placed(robot, ends[0])[:3, 3]) + 0.1
    for _ in range(200):
        things = []
        for k in range(3):
            at = rng.normal(size=3)
            at = at / np.linalg.norm(at) * rng.uniform(0.5, 1.1) * reach_
            at[2] = abs(at[2])
            size = rng.uniform(0.05, 0.25, 3)
            things.append(f"  - {{name: box{k}, type: box, size: {size.round(3).tolist()}, "
                          f"position: {at.round(3).tolist()}}}")  # fmt: skip
        path = folder / "scene.yaml"
        path.write_text("objects:\n" + "\n".join(things) + "\n")
        judge = DenseJudge(robot, path)
        if all(judge.pose(q) is None for q in ends):
            return path
    return None


def configuration(robot: Any, judge: DenseJudge, rng: np.random.Generator) -> np.ndarray:
    """Random positions (n,) [rad] at which the arm touches nothing and its last frame is above the base."""
    low, high = np.maximum(robot.limits.lower, -2.6), np.minimum(robot.limits.upper, 2.6)
    while True:
        q = low + (high - low) * rng.uniform(0.15, 0.85, len(low))
        if judge.pose(q) is None and placed(robot, q)[2, 3] > 0.05:
            return q


def pose_numbers(matrix: np.ndarray) -> list[float]:
    """x, y, z [m] and a quaternion x, y, z, w of a pose (4, 4)."""
    return pin.SE3ToXYZQUATtuple(pin.SE3(matrix))  # type: ignore[no-any-return]


def draw(name: str, number: int, kind: int, folder: Path) -> dict[str, Any]:
    """A move: start, pose, whether its turn is free (of every other kind), scene (of every third)."""
    robot = arm(name)
    rng = np.random.default_rng([number, len(name), ord(name[0])])
    judge = DenseJudge(robot)
    ends = [configuration(robot, judge, rng) for _ in range(2)]
    free = (Freedom("rz"),) if kind % 2 else ()
    pose = Pose(placed(robot, ends[1]), free, name="goal")
    scene = boxes(robot, rng, ends, folder) if kind % 3 == 0 else None
    return {"robot": robot, "start": ends[0], "pose": pose, "scene": scene, "known": ends[1]}


def judged(move: dict[str, Any], answer: Any) -> dict[str, Any]:
    """What the written file comes to: what its last row misses the pose by, and whether it touches anything."""
    with tempfile.TemporaryDirectory() as folder:
        file = answer.save(Path(folder) / "out") / "trajectory.csv"
        rows = np.genfromtxt(file, delimiter=",", names=True, deletechars="")
        touch = DenseJudge(move["robot"], move["scene"]).file(file)
    q = np.array([rows[f"{joint}.position"][-1] for joint in move["robot"].joints])
    off = np.linalg.inv(move["pose"].matrix) @ placed(move["robot"], q)
    turn = pin.log3(off[:3, :3])
    if move["pose"].free:  # what is left of the turn when that about z is taken out
        turn = np.array([np.arccos(np.clip(off[2, 2], -1, 1))])
    return {"distance": float(np.linalg.norm(off[:3, 3])), "angle": float(np.linalg.norm(turn)),
            "touching": touch.touching}  # fmt: skip


def solved(move: dict[str, Any]) -> dict[str, Any]:
    """One row: the answer, its judgement, the saving against the nearest goal and the time beside a joint goal's."""
    robot, pose, request = move["robot"], move["pose"], CellRequest(scene=move["scene"])
    cell = load_cell(robot, request)
    settings = eo.Settings()
    near = nearest_move(Ends(None, (pose,)), eo.Move(move["start"], move["start"]), robot, cell, settings)
    fastest = eo.Planner(robot, rivals_from([MODEL], None, robot)[0][0].model, settings).minimum_time(near)
    duration = float(np.round(1.5 * fastest, 3))
    eo.optimize(robot, MODEL, start=move["start"], goal=near.goal, duration=duration, cell=request)  # builds, compiles
    begin = time.process_time()
    answer = eo.optimize(robot, MODEL, start=move["start"], goal=pose, duration=duration, cell=request)
    seconds, begin = time.process_time() - begin, time.process_time()
    joint = eo.optimize(robot, MODEL, start=move["start"], goal=answer.trajectory.position[-1], duration=duration,
                        cell=request)  # fmt: skip
    alone = time.process_time() - begin
    nearest = answer.goals["nearest"]
    return {
        "status": answer.status, "duration": duration, "total": answer.energy.total, "loss": answer.energy.loss,
        "nearest_total": nearest["energy"], "nearest_loss": nearest["loss"], "saved": nearest["saving_joules"],
        "moving": answer.energy.total - answer.energy.standby, "solves": answer.goals["solves"],
        "seconds": seconds, "joint_seconds": alone, "joint_total": joint.energy.total, **judged(move, answer),
    }  # fmt: skip


def turned(move: dict[str, Any], duration: float, k: int) -> dict[str, Any]:
    """Sketches of the moves to every branch, with the tool turned by k times 15 degrees in its freedom.

    A sketch (one coarse start, blind to bodies) costs no more than the motion around them.
    """
    planner, pose = planning(move), move["pose"]
    begin, at, sketches = time.process_time(), pose.matrix.copy(), []
    at[:3, :3] = at[:3, :3] @ pin.exp3(np.array([0.0, 0.0, k * 2 * np.pi / TURNS]))
    found = reach(ToolKinematics(move["robot"]), Pose(at), near=move["start"]).positions
    for goal in with_whole_turns(move["robot"], spread(found[kept_by(found, planner.cell)])):
        asked = eo.Move(move["start"], goal, "reshape", duration)
        try:
            sketches.append([planner.score(planner.sketch(asked)).total, *goal.tolist()])
        except Infeasible:
            sketches.append([None, *goal.tolist()])
    return {"sketches": sketches, "sketch_seconds": time.process_time() - begin}


def enumerated(move: dict[str, Any], duration: float, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The least energy over all that was sketched: goals are solved in full, in order, while sketches are below it."""
    planner, begin, best, loss, full = planning(move), time.process_time(), np.inf, np.nan, 0
    sketches = [sketch for row in rows for sketch in row["sketches"]]
    for energy, *goal in sorted(sketch for sketch in sketches if sketch[0] is not None):
        if energy >= best or full == MOST:
            break
        full += 1
        try:
            found = planner.solve(eo.Move(move["start"], np.array(goal), "reshape", duration))
        except Infeasible:
            continue
        if found.status == "solved" and found.energy.total < best:
            best, loss = found.energy.total, found.energy.loss
    seconds = time.process_time() - begin + sum(row["sketch_seconds"] for row in rows)
    return {"least": best, "least_loss": loss, "count": len(sketches), "solved_in_full": full,
            "enumerate_seconds": seconds}  # fmt: skip


def planning(move: dict[str, Any]) -> eo.Planner:
    """What solves a move to a joint goal in its scene."""
    robot, cell = move["robot"], load_cell(move["robot"], CellRequest(scene=move["scene"]))
    model = rivals_from([MODEL], None, robot)[0][0].model
    return eo.Planner(robot, model, eo.Settings(solver="sqp"), cell=cell)


def with_whole_turns(robot: Any, q: np.ndarray) -> np.ndarray:
    """Positions (K, n), and those that differ from one of them by a whole turn of one revolute joint, within limits."""
    turning = np.flatnonzero(~np.array(robot.slides, dtype=bool))
    steps = [side * 2 * np.pi * np.eye(q.shape[1])[j] for j in turning for side in (-1, 1)]
    every = np.concatenate([q, *(q + step for step in steps)])
    return np.asarray(every[((every >= robot.limits.lower) & (every <= robot.limits.upper)).all(axis=1)])


def spread(q: np.ndarray) -> np.ndarray:
    """Positions (K, n) of which no two are nearer than 15 degrees in every joint."""
    kept: list[np.ndarray] = []
    for row in q:
        if all(np.abs(row - other).max() >= 2 * np.pi / TURNS for other in kept):
            kept.append(row)
    return np.array(kept).reshape(-1, q.shape[1])


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--moves", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=6)
    parser.add_argument("--starts", type=int, default=4, help="of the jobs")
    parser.add_argument("--enumerate", type=int, default=20)
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=ARMS)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    kept, rows = Kept(args.keep), []
    for number in range(args.first, args.first + args.moves):
        name, kind = args.arms[number % len(args.arms)], sum(divmod(number, len(args.arms)))
        row = kept(f"{name} {number} solve", partial(part, name, number, kind, solved))
        if number < args.first + args.enumerate and "duration" in row:
            find = partial(enumerating, kept, name, number, kind, row["duration"], row["free"])
            row = row | kept(f"{name} {number} enumerate", find)
        rows.append(row)
    names = [args.arms[number % len(args.arms)] for number in range(args.jobs)]
    jobs = [kept(f"{name} job {k}", partial(job_of_six, name, k, args.starts)) for k, name in enumerate(names)]
    return report(rows, jobs, args)


def enumerating(kept: Kept, name: str, number: int, kind: int, duration: float, free: bool) -> dict[str, Any]:
    """A row of an enumeration, from a row for every turn of the tool."""
    turns = [
        kept(f"{name} {number} turned by {15 * k} deg", partial(part, name, number, kind, turned, duration, k))
        for k in range(TURNS if free else 1)
    ]
    return part(name, number, kind, enumerated, duration, turns)


def part(name: str, number: int, kind: int, find: Callable[..., dict[str, Any]], *more: Any) -> dict[str, Any]:
    """A row of a move: what `find` makes of it, or why it was not solved."""
    with tempfile.TemporaryDirectory() as folder:
        move = draw(name, number, kind, Path(folder))
        about = {"arm": name, "free": bool(move["pose"].free), "scene": move["scene"] is not None}
        try:
            return about | find(move, *more)
        except EnergyOptError as error:
            return about | {"status": "failed", "message": str(error)}


def job_of_six(name: str, number: int, starts: int) -> dict[str, Any]:
    """A row of a job: a cycle of six poses with a free turn, beside the same with the nearest branch at every pose."""
    robot = arm(name)
    rng = np.random.default_rng([number, len(name), 6])
    ends = [configuration(robot, DenseJudge(robot), rng) for _ in range(6)]
    steps = [{"pose": pose_numbers(placed(robot, q)), "free": ["rz"]} for q in ends]
    document = {
        "format": "energy-opt/job/1",
        "robot": str(robot.urdf) if name == "iiwa" else name,
        "cycle_time": 12.0,
        "step": steps,
    }
    begin = time.process_time()
    found = eo.job(job=document, model=MODEL, starts=starts, allow_outside=True).document()
    return {
        "status": found["status"], "energy": found["energy_total"], "nearest": found["choice"]["greedy_nearest"],
        "solves": found["choice"]["solves"], "seconds": time.process_time() - begin,
    }  # fmt: skip


def report(rows: list[dict[str, Any]], jobs: list[dict[str, Any]], args: argparse.Namespace) -> int:
    """Print the tables and the verdicts; the exit code."""
    good = [r for r in rows if r.get("status") == "solved" or "total" in r]
    false = [r for r in good if r["touching"] or r["distance"] > 2e-6 or r["angle"] > 1e-5]
    lines = []
    for arm in args.arms:
        for free in (False, True):
            own = [r for r in good if r["arm"] == arm and r["free"] == free]
            if own:
                saved = [100 * r["saved"] / r["nearest_total"] for r in own if r["saved"] is not None]
                ratio = [r["seconds"] / r["joint_seconds"] for r in own]
                lines.append([arm, "yes" if free else "no", len(own), float(np.mean(saved)), float(np.median(ratio))])
    print(table(["arm", "free turn", "moves", "saved against nearest [%]", "time, joint-goal solves"], lines))
    compared = [r for r in good if "least" in r and np.isfinite(r["least"])]
    # the loss alone would count what gravity gives back: all that motion takes is compared, on the scale of the loss
    near = [r for r in compared if r["total"] - r["least"] <= 0.01 * max(r["least_loss"], 1e-9)]
    solves = sum(r["solves"]["full"] + r["solves"]["screened"] for r in compared)
    count = sum(r["count"] for r in compared)
    ratio = float(np.median([r["seconds"] / r["joint_seconds"] for r in good])) if good else np.nan
    print(f"{len(rows)} moves, {len(good)} solved, {len(false)} false; enumeration: {len(compared)} moves, "
          f"{len(near)} within 1 % of the loss, {solves} solves for its {count}; "
          f"median time {ratio:.3g} joint-goal solves")  # fmt: skip
    checks = {
        "98 % of the moves are solved": len(good) >= 0.98 * len(rows),
        "none is false by Pinocchio and coal": not false,
        "at most 3 times a joint-goal solve": ratio <= 3,
    }
    if compared:
        checks["within 1 % of the loss of the enumeration in 90 %"] = len(near) >= 0.9 * len(compared)
        checks["at most 10 % of its solves"] = solves <= 0.1 * count
    if jobs:
        header = ["job", "cheapest [J]", "nearest branches [J]", "solves", "CPU [s]"]
        print(table(header, [[r[k] for k in ("key", "energy", "nearest", "solves", "seconds")] for r in jobs]))
        known = [r for r in jobs if r["nearest"] is not None]
        checks["jobs cost no more than with the nearest branches"] = all(r["energy"] <= r["nearest"] for r in known)
    return finish({"rows": rows, "jobs": jobs}, checks, args.out)


if __name__ == "__main__":
    sys.exit(main())
