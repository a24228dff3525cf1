"""An evaluator of answers that imports nothing of the package: URDF, SRDF, result.json and the files beside it.

Dynamics are those of tests/independent.py, which reads the URDF itself; bodies are Pinocchio's and coal's. Places
between rows are so many that a peak between two is below what is tolerated. What touches is convicted, never acquitted.
"""

from __future__ import annotations

import csv
import hashlib
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from independent import curve
from option_arm import Robot

TOLERANCE = 2e-6  # of a bound, or of an energy
PLACES, POSES = 24, 400  # between two rows, and of a motion whose contacts are looked for
PLAIN = {"standby", "copper_loss", "payload"}  # effects of which energies are recomputed
VIA = 1e-4  # [rad, m] a via point is passed within, as the option says
PASSED, SPREAD = 2e-3, 1e-3  # [rad], of an energy: what the mean over milliseconds does to a cycle without jumps


Rows = tuple[np.ndarray, ...]  # time, position, velocity, acceleration


def rows_of(path: Path, joints: Sequence[str]) -> list[np.ndarray]:
    """time (N,), positions, velocities and accelerations (N, n) of a trajectory.csv."""
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    return [np.array([float(row["time"]) for row in rows])] + [
        np.array([[float(row[f"{joint}.{what}"]) for joint in joints] for row in rows])
        for what in ("position", "velocity", "acceleration")
    ]


def faults_of_files(out: Path, document: str = "result.json") -> list[str]:
    """Files of the folder that the document does not list with their digest, and the other way round."""
    listed = {row["name"]: row["sha256"] for row in json.loads((out / document).read_text()).get("files", [])}
    there = {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in out.iterdir() if p.name != document}
    return [f"files: {name}" for name in sorted({*listed, *there}) if listed.get(name) != there.get(name)]


def model_of(document: Mapping[str, Any]) -> dict[str, Any]:
    """Effects by name of the model that a document's energies are stated under."""
    request = document["request"]
    model = request["model"]
    if isinstance(model, list):
        model = model[0]
    return {effect["name"]: effect for effect in model["effect"]}


def _noting(faults: list[str]) -> Callable[[str, float], None]:
    def holds(what: str, excess: float) -> None:
        if not excess <= TOLERANCE:
            faults.append(f"{what}: {excess:.3e} beyond")

    return holds


def energy_of(robot: Robot, asked: Mapping[str, Any], rows: Rows, model: Mapping[str, Any]) -> float:
    """J of a motion under standby and copper loss, by Newton and Cotes' rule of degree 9 between two rows."""
    copper = np.atleast_1d(model["copper_loss"]["r_over_kt2"]) if "copper_loss" in model else np.zeros(1)
    _, (y, dy, ddy, _) = curve(*rows, 9)
    load = robot.arm(asked.get("payload")).torque(*(z.reshape(-1, robot.n) for z in (y, dy, ddy))).reshape(y.shape)
    each = model["standby"]["power"] + np.sum(load * dy + copper * load**2, axis=2)
    weight = np.linalg.solve(np.vander(np.linspace(0, 1, 9), increasing=True).T, 1 / (np.arange(9) + 1))
    return float(np.sum((each @ weight) * np.diff(rows[0])))


def held(robot: Robot, asked: Mapping[str, Any], rows: Rows, model: Mapping[str, Any]) -> list[str]:
    """What a motion breaks of the arm's limits and what it touches."""
    (t, q, v, a), faults = rows, []
    holds = _noting(faults)
    _, (x, dx, ddx, jerk) = curve(t, q, v, a, PLACES)
    bounds = robot.bounds
    span = np.where(np.isfinite(bounds["upper"] - bounds["lower"]), bounds["upper"] - bounds["lower"], 1)
    holds("position", float(np.max(np.maximum(x - bounds["upper"], bounds["lower"] - x) / span)))
    values = {"velocity": dx, "acceleration": ddx, "jerk": jerk}
    if set(model) <= PLAIN:
        arm = robot.arm(asked.get("payload"))
        values["effort"] = arm.torque(*(y.reshape(-1, robot.n) for y in (x, dx, ddx))).reshape(x.shape)
    for name, value in values.items():
        holds(name, float(np.max(np.abs(value) / bounds[name])) - 1)
    own = asked.get("own", True)
    if own or asked.get("scene") or asked.get("floor") is not None:
        many = np.linspace(t[0], t[-1], POSES)
        k = np.clip(np.searchsorted(t, many, side="right") - 1, 0, len(t) - 2)
        poses = x[k, np.round((many - t[k]) / (t[k + 1] - t[k]) * (PLACES - 1)).astype(int)]
        pair = robot.touching(poses, asked.get("scene", []), asked.get("floor"), own)
        if pair is not None:
            faults.append(f"touches: {pair}")
    return faults


def judge_cycle(robot: Robot, asked: Mapping[str, Any], out: Path) -> list[str]:
    """What is wrong with the cycle.csv of a job: asked cycle_time, passes (positions, in order), and waits [s]."""
    found = json.loads((out / "job.json").read_text())
    rows = rows_of(out / "cycle.csv", robot.joints)
    t, q, v, _ = rows
    model = model_of(found)
    faults = faults_of_files(out, "job.json") + held(robot, asked, rows, model)
    holds = _noting(faults)
    holds("cycle time", abs(t[-1] - t[0] - asked["cycle_time"]) / asked["cycle_time"])
    holds("steps' times", abs(sum(row["duration"] for row in found["steps"]) - asked["cycle_time"]))
    holds("steps' energies", abs(sum(row["energy_total"] for row in found["steps"]) / found["energy_total"] - 1))
    for name, place in (("begin", 0), ("end", -1)):
        holds(name, float(np.abs(q[place] - asked["start"]).max()) + float(np.abs(v[place]).max()))
    at = 0
    for point in asked["passes"]:
        off = np.abs(q[at:] - point).max(axis=1)
        reach = PASSED + 0.5 * np.abs(np.diff(q[at:], axis=0, append=q[-1:])).max(axis=1)  # it is between two samples
        near = np.flatnonzero(off <= reach)  # the way back may come nearer than the way there
        at += int(near[0]) if near.size else 0
        holds("pass", float((off - reach).min()))
    still = np.abs(np.diff(q, axis=0)).max(axis=1) < 1e-12  # [rad]: the last digit of a position may differ
    waits = float(np.diff(t)[still].sum())
    if waits < asked["wait"] * 0.9:  # jumps of the acceleration are spread at their cost
        faults.append(f"waits {waits:g} s")
    if set(model) <= PLAIN:
        energy = energy_of(robot, asked, rows, model)
        if abs(energy / found["energy_total"] - 1) > SPREAD:
            faults.append(f"energy: {energy:g} instead of {found['energy_total']:g}")
    return faults


def judge_front(robot: Robot, asked: Mapping[str, Any], out: Path) -> list[str]:
    """What is wrong with a front: durations as asked, energies that add up, and a minimum that is none."""
    found, faults = json.loads((out / "tradeoff.json").read_text()), faults_of_files(out, "tradeoff.json")
    holds, model, arm = _noting(faults), model_of(found), robot.arm(asked.get("payload"))
    holds("durations", float(np.abs(np.array([row["duration"] for row in found["points"]]) - asked["durations"]).max()))
    solved = [row for row in found["points"] if row["energy_total"] is not None]
    x, weight = np.polynomial.legendre.leggauss(60)
    start, way = np.array(asked["start"]), np.array(asked["goal"]) - asked["start"]
    q = start + (x[:, None] + 1) / 2 * way
    stored = float(weight / 2 @ (arm.torque(q, 0 * q, 0 * q) @ way))  # what lifting takes, along the straight line
    for row in solved:
        holds("standby", abs(row["energy_standby"] / (model["standby"]["power"] * row["duration"]) - 1))
        rest = row["energy_total"] - row["energy_standby"] - row["energy_loss"]
        if abs(rest - stored) > 1e-4 * max(abs(stored), 1.0):
            faults.append(f"stored: {rest:g} instead of {stored:g}")
        if found["minimum"] is not None and row["status"] == "solved":
            holds("minimum", found["minimum"]["energy_total"] / row["energy_total"] - 1)
        holds("fastest", found["fastest"] - row["duration"])
    return faults


def judge_batch(out: Path) -> list[str]:
    """What is wrong with the rows of a batch: what is solved holds its limits and costs no more than slowed evenly."""
    from pyarrow import parquet

    faults: list[str] = []
    holds = _noting(faults)
    for row in parquet.read_table(out / "results.parquet").to_pylist():
        if row["status"] == "solved":
            holds(f"{row['mode']}: violation", float(row["max_violation"]))
            if row["saving_loss_percent"] is not None and np.isfinite(row["saving_loss_percent"]):
                holds(f"{row['mode']}: costs more", -float(row["saving_total_percent"]) / 100)
            parts = row["energy_standby"] + row["energy_loss"]
            if not np.isfinite(parts) or row["energy_loss"] < -1e-9:
                faults.append(f"{row['mode']}: energies {row['energy_total']:g}, {parts:g}")
    return faults


def judge(robot: Robot, asked: Mapping[str, Any], out: Path) -> list[str]:
    """What is wrong with the answer in a folder to what was asked for; empty where nothing is.

    Args:
        asked: start, goal; and where they were asked for duration, max_duration, payload, max_power, tool_speed,
            tool_acceleration, keep, tube, via, floor, scene (objects), write, self_collision.
    """
    found = json.loads((out / "result.json").read_text())
    t, q, v, a = rows_of(out / "trajectory.csv", robot.joints)
    model = model_of(found)
    plain, faults = set(model) <= PLAIN, faults_of_files(out) + held(robot, asked, (t, q, v, a), model)
    arm, holds = robot.arm(asked.get("payload")), _noting(faults)
    _, (x, dx, ddx, _) = curve(t, q, v, a, PLACES)
    tau = arm.torque(*(y.reshape(-1, robot.n) for y in (x, dx, ddx))).reshape(x.shape)
    holds("start", float(np.abs(q[0] - asked["start"]).max()) + float(np.abs(v[0]).max()))
    holds("goal", float(np.abs(q[-1] - asked["goal"]).max()) + float(np.abs(v[-1]).max()))
    if asked.get("duration") is not None:
        holds("duration", abs(t[-1] - t[0] - asked["duration"]))
    if asked.get("max_duration") is not None:
        holds("max_duration", t[-1] - t[0] - asked["max_duration"])
    if plain:
        copper = np.atleast_1d(model["copper_loss"]["r_over_kt2"]) if "copper_loss" in model else np.zeros(1)
        power = model["standby"]["power"] + np.sum(tau * dx + copper * tau**2, axis=2)
        energy = energy_of(robot, asked, (t, q, v, a), model)
        holds("energy", abs(energy - found["energy"]["total"]) / max(abs(energy), 1.0))
        if asked.get("max_power") is not None:
            holds("power", float(power.max()) / asked["max_power"] - 1)
    for point in asked.get("via", []):
        k = int(np.argmin(np.abs(q - point).max(axis=1)))  # it may be passed between two rows
        near = slice(max(k - 1, 0), k + 2)
        _, (fine, *_) = curve(t[near], q[near], v[near], a[near], 4001)
        holds("via", float(np.abs(fine - point).max(axis=2).min()) - VIA)
    faults += _conditions(robot, asked, t, q, v, a)
    for path in out.glob("trajectory.*"):
        faults += _written(path, robot, asked)
    return faults


def _conditions(
    robot: Robot, asked: Mapping[str, Any], t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> list[str]:
    """What is asked of the tool and of the path, at three places between rows; speeds by differences of its poses."""
    faults: list[str] = []
    if not {"tool_speed", "tool_acceleration", "keep", "tube"} & set(asked):
        return faults
    _, (x, *_) = curve(t, q, v, a, 4)
    poses = robot.tool(x.reshape(-1, robot.n))
    place, turn = poses[:, :3, 3], poses[:, :3, :3]
    if "tube" in asked:
        width = float(asked["tube"].rstrip("radm"))
        start, along = np.array(asked["start"]), np.array(asked["goal"]) - asked["start"]
        flat = x.reshape(-1, robot.n)
        if asked["tube"].endswith("rad"):
            foot = np.clip((flat - start) @ along / (along @ along), 0, 1)
            off = float(np.abs(flat - start - foot[:, None] * along).max())
        else:
            path = robot.tool(start + np.linspace(0, 1, 2001)[:, None] * along)[:, :3, 3]
            off = max(float(np.linalg.norm(path - p, axis=1).min()) for p in place[::7])
        if off > width * (1 + 1e-4) + 2e-6:
            faults.append(f"tube: {off:g}")
    for word in asked.get("keep", []):
        kind, _, most = word.partition(":")
        if kind == "upright":
            axis = turn[0].T @ np.array([0, 0, 1.0])
            off, limit = np.degrees(np.arccos(np.clip((turn @ axis)[:, 2], -1, 1))).max(), float(most or 5)
        elif kind == "orientation":
            cosine = (np.einsum("kij,ij->k", turn, turn[0]) - 1) / 2
            off, limit = np.degrees(np.arccos(np.clip(cosine, -1, 1))).max(), float(most or 2)
        else:
            line = place[-1] - place[0]
            share = np.clip((place - place[0]) @ line / (line @ line), 0, 1)
            off, limit = 1000 * np.linalg.norm(place - place[0] - share[:, None] * line, axis=1).max(), float(most or 1)
        if off > limit * (1 + 1e-4) + 1e-6:
            faults.append(f"keep {word}: {off:g}")
    for name, order in (("tool_speed", 1), ("tool_acceleration", 2)):
        if name in asked:
            many = np.linspace(t[0], t[-1], 4000)
            k, step = np.clip(np.searchsorted(t, many, side="right") - 1, 0, len(t) - 2), many[1] - many[0]
            h = t[k + 1] - t[k]
            _, (y, *_) = curve(t, q, v, a, 65)
            whole = y[k, np.round((many - t[k]) / h * 64).astype(int)]
            exact = t[k] + h * np.round((many - t[k]) / h * 64) / 64
            path, size = robot.tool(whole)[:, :3, 3], None
            for _ in range(order):
                path = np.gradient(path, exact, axis=0)
            size = float(np.linalg.norm(path[4:-4], axis=1).max())
            if size > asked[name] * 1.02 + 3 * step:
                faults.append(f"{name}: {size:g}")
    return faults


def _written(path: Path, robot: Robot, asked: Mapping[str, Any]) -> list[str]:
    """Whether a written file begins at the start and ends at the goal."""
    text = path.read_bytes()
    if path.name.endswith(".franka.csv"):
        rows = [[float(x) for x in line.split(",")] for line in text.decode().splitlines() if line[:1] in "-0123456789"]
        ends = np.array([rows[0][-robot.n :], rows[-1][-robot.n :]])
    elif path.suffix in (".yaml", ".json"):
        document = yaml.safe_load(text) if path.suffix == ".yaml" else json.loads(text)
        plan = document.get("trajectory", document)
        order = [plan["joint_names"].index(joint) for joint in robot.joints]
        ends = np.array([plan["points"][k]["positions"] for k in (0, -1)])[:, order]
    else:
        return [] if text else [f"{path.name}: empty"]
    off = float(np.abs(ends - [asked["start"], asked["goal"]]).max())
    return [f"{path.name}: its ends are {off:g} off"] if off > 1e-6 else []
