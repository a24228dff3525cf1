"""Moves to poses of the tool: how many are solved, what the choice of the joint goal saves, and what it costs.

    python benchmarks/poses.py [--moves 60] [--enumerate 20] [--arms panda ur5e ...] [--keep rows.jsonl] [--out FILE]

Poses are those of seeded random configurations that touch nothing, so each is reachable; half of them leave the turn
about the tool's z free, every third move has boxes around it. Durations are 1.5 times the shortest of the move to the
nearest goal. Every answer is judged from its written file: the pose by Pinocchio from the URDF, contact between samples
by the many poses of dense_judge.py (Pinocchio and coal). Enumeration solves every branch, at every 15 degrees of the
free turn, in full; of arms with seven joints it also takes 24 positions along their redundancy. Seconds are CPU times.
A row that was kept is not computed again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from common import finish, table
from dense_judge import DenseJudge

import energy_opt as eo
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import EnergyOptError, Infeasible
from energy_opt.front.rivals import rivals_from
from energy_opt.poses.ends import Ends
from energy_opt.poses.inverse import ToolKinematics, reach
from energy_opt.poses.pose import Freedom, Pose
from energy_opt.poses.sets import free_of, thinned
from energy_opt.poses.solve import nearest_move
from energy_opt.robot import load_robot

ARMS = ("panda", "ur5e", "ur10e", "xarm7", "z1")
MODEL = "source-method-2"
TURNS = 24  # of a free axis, 15 degrees each
ALONG = 24  # positions along a redundancy


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


def draw(name: str, number: int, folder: Path) -> dict[str, Any]:
    """A move: start, pose, whether its turn is free, scene."""
    robot = load_robot(name)
    rng = np.random.default_rng([number, len(name), ord(name[0])])
    judge, limits = DenseJudge(robot), robot.limits
    low, high = np.maximum(limits.lower, -2.6), np.minimum(limits.upper, 2.6)
    ends: list[np.ndarray] = []
    while len(ends) < 2:
        q = low + (high - low) * rng.uniform(0.15, 0.85, len(low))
        if judge.pose(q) is None and placed(robot, q)[2, 3] > 0.05:
            ends.append(q)
    free = (Freedom("rz"),) if number % 2 else ()
    pose = Pose(placed(robot, ends[1]), free, name="goal")
    scene = boxes(robot, rng, ends, folder) if number % 3 == 0 else None
    return {"robot": robot, "start": ends[0], "pose": pose, "scene": scene, "known": ends[1]}


def judged(move: dict[str, Any], answer: Any, folder: Path) -> dict[str, Any]:
    """What the written file comes to: what its last row misses the pose by, and whether it touches anything."""
    answer.save(folder)
    rows = np.genfromtxt(folder / "trajectory.csv", delimiter=",", names=True, deletechars="")
    q = np.array([rows[f"{joint}.position"][-1] for joint in move["robot"].joints])
    off = np.linalg.inv(move["pose"].matrix) @ placed(move["robot"], q)
    turn = pin.log3(off[:3, :3])
    if move["pose"].free:  # what is left of the turn when that about z is taken out
        turn = np.array([np.arccos(np.clip(off[2, 2], -1, 1))])
    touch = DenseJudge(move["robot"], move["scene"]).file(folder / "trajectory.csv")
    return {"distance": float(np.linalg.norm(off[:3, 3])), "angle": float(np.linalg.norm(turn)),
            "touching": touch.touching}  # fmt: skip


def solved(move: dict[str, Any], folder: Path) -> dict[str, Any]:
    """One row: the answer, its judgement, the saving against the nearest goal and the time beside a joint goal's."""
    robot, pose, request = move["robot"], move["pose"], CellRequest(scene=move["scene"])
    cell = load_cell(robot, request)
    settings = eo.Settings()
    near = nearest_move(Ends(None, (pose,)), eo.Move(move["start"], move["start"]), robot, cell, settings)
    fastest = eo.Planner(robot, rivals_from([MODEL], None, robot, None)[0][0].model, settings).minimum_time(near)
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
        "seconds": seconds, "joint_seconds": alone, "joint_total": joint.energy.total, **judged(move, answer, folder),
    }  # fmt: skip


def enumerated(move: dict[str, Any], duration: float) -> dict[str, Any]:
    """The least energy over all branches and 15 degrees of every freedom, each solved."""
    robot, pose = move["robot"], move["pose"]
    cell = load_cell(robot, CellRequest(scene=move["scene"]))
    planner = eo.Planner(robot, rivals_from([MODEL], None, robot, None)[0][0].model, eo.Settings(), cell=cell)
    tool, best, count, begin = ToolKinematics(robot), np.inf, 0, time.process_time()
    for k in range(TURNS if pose.free else 1):
        at = pose.matrix.copy()
        angle = k * 2 * np.pi / TURNS
        at[:3, :3] = at[:3, :3] @ pin.exp3(np.array([0.0, 0.0, angle]))
        q = free_of(reach(tool, Pose(at), near=move["start"]).positions, cell)
        for goal in thinned(q, np.zeros(len(q)), ALONG if robot.n > 6 else len(q)):
            count += 1
            try:
                found = planner.solve(eo.Move(move["start"], goal, "reshape", duration))
            except Infeasible:
                continue
            if found.status == "solved" and found.energy.total < best:
                best, loss = found.energy.total, found.energy.loss
    return {"least": best, "least_loss": loss, "count": count, "enumerate_seconds": time.process_time() - begin}


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--moves", type=int, default=60)
    parser.add_argument("--enumerate", type=int, default=20)
    parser.add_argument("--arms", nargs="+", default=ARMS)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    kept: dict[str, dict[str, Any]] = {}
    if args.keep is not None and args.keep.is_file():
        kept = {row["key"]: row for row in map(json.loads, args.keep.read_text().splitlines())}
    rows = []
    for number in range(args.moves):
        name = args.arms[number % len(args.arms)]
        with tempfile.TemporaryDirectory() as folder:
            move: dict[str, Any] | None = None
            for part in ("solve", "enumerate")[: 1 + (number < args.enumerate)]:
                key = f"{name} {number} {part}"
                if key not in kept:
                    move = move or draw(name, number, Path(folder))
                    try:
                        kind = {"free": bool(move["pose"].free), "scene": move["scene"] is not None}
                        duration = kept.get(f"{name} {number} solve", {}).get("duration")
                        found = solved(move, Path(folder) / "out") if part == "solve" else enumerated(move, duration)
                    except EnergyOptError as error:
                        found = {"status": "failed", "message": str(error)}
                    kept[key] = {"key": key, "arm": name, **kind, **found}
                    print(json.dumps(kept[key]), flush=True)
                    if args.keep is not None:
                        with args.keep.open("a") as stream:
                            stream.write(json.dumps(kept[key]) + "\n")
            rows.append({**kept[f"{name} {number} solve"], **kept.get(f"{name} {number} enumerate", {})})
    return report(rows, args)


def report(rows: list[dict[str, Any]], args: argparse.Namespace) -> int:
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
    share = [(r["solves"]["full"] + r["solves"]["screened"]) / r["count"] for r in compared]
    ratio = float(np.median([r["seconds"] / r["joint_seconds"] for r in good])) if good else np.nan
    print(f"{len(rows)} moves, {len(good)} solved, {len(false)} false; enumeration: {len(compared)} moves, "
          f"{len(near)} within 1 % of the loss, {100 * np.mean(share) if share else 0:.2g} % of its solves; "
          f"median time {ratio:.3g} joint-goal solves")  # fmt: skip
    checks = {
        "98 % of the moves are solved": len(good) >= 0.98 * len(rows),
        "none is false by Pinocchio and coal": not false,
        "at most 3 times a joint-goal solve": ratio <= 3,
    }
    if compared:
        checks["within 1 % of the loss of the enumeration in 90 %"] = len(near) >= 0.9 * len(compared)
        checks["at most 10 % of its solves"] = float(np.mean(share)) <= 0.1
    return finish({"rows": rows}, checks, args.out)


if __name__ == "__main__":
    sys.exit(main())
