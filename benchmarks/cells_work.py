"""Problems of the benchmark of cells, and what is measured of one: first paths, proofs, whole answers, own bodies.

Seconds are CPU times of this process.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from common import Case, cases
from dense_judge import DenseJudge

from energy_opt.batches.suite import load_suite
from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene_files import read_scene
from energy_opt.effects import Payload
from energy_opt.errors import Infeasible
from energy_opt.formats import write
from energy_opt.motion import Move, Planner, Settings, Trajectory
from energy_opt.motion.judge.clearance import cell_beside
from energy_opt.motion.path import JointPath, through
from energy_opt.motion.plan.context import path_of
from energy_opt.motion.result import Result
from energy_opt.motion.timing.toppra import fastest
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot

MBM = Path(__file__).parents[2] / "shared" / "data" / "mbm"
SUITE = Path(__file__).parent / "suites" / "cells.toml"
SLOWER = 1.5  # durations are this multiple of the fastest on the first path
WAYS = 4  # further paths of one's own that are started from besides a given one
PAYLOAD = (1.0, 0.0, 0.0, 0.08)  # [kg, m] of the suite's second half


@dataclass(frozen=True)
class Problem:
    """A move among things; `given` is a planner's free path, where the problem has one."""

    name: str
    kind: str
    robot: Robot
    cell: Cell
    scene: Path | None
    start: np.ndarray
    goal: np.ndarray
    given: JointPath | None = None


def problems(count: int | None) -> Iterator[Problem]:
    """MotionBenchMaker's, then the suite's: the first `count` of each."""
    robots: dict[str, Robot] = {}
    rows = json.loads((MBM / "problems.json").read_text())["problems"] if MBM.is_dir() else []
    for row in rows[:count]:
        robot = robots.setdefault(row["robot"], load_robot(row["robot"]))
        file = MBM / "scenes" / f"{row['id']}.yaml"
        start, goal = (np.array(row[end], dtype=float) for end in ("start", "goal"))
        cell = Cell(robot, CellRequest(), read_scene(file))
        yield Problem(row["id"], "mbm", robot, cell, file, start, goal, through(np.array(row["waypoints"])))
    known: dict[tuple[str, str], Cell] = {}
    tasks = [task for task in load_suite(SUITE).tasks if not task.payload[0]]
    for task in tasks[:count]:
        robot = robots.setdefault(task.robot.name, task.robot.load())
        key = robot.name, task.surroundings.scene
        known.setdefault(key, task.surroundings.cell(robot))
        file = SUITE.parent / "scenes" / f"{task.move.split()[0]}.yaml"
        name, start, goal = f"{robot.name} {task.move}", np.array(task.start), np.array(task.goal)
        yield Problem(name, "suite", robot, known[key], file, start, goal)


def judged(cell: Cell, trajectory: Trajectory | None) -> tuple[str, float]:
    """What the proof says of a trajectory, and how deep it touches [mm]."""
    if trajectory is None:
        return "none", 0.0
    found = cell.prove(trajectory.time, trajectory.position, trajectory.velocity, trajectory.acceleration)
    return found.verdict, 1e3 * (found.depth or 0.0)


def seen(robot: Robot, scene: Path | None, trajectory: Trajectory) -> int:
    """Poses of the trajectory.csv that touch something, by the judge that shares nothing with our cell."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "trajectory.csv"
        write(trajectory, file)
        return DenseJudge(robot, scene).file(file).touching


def timed(problem: Problem, path: JointPath) -> Trajectory | None:
    """The path timed by TOPP-RA; None where that is not possible."""
    try:
        return fastest(problem.robot, source_method_2(problem.robot.name), path).trajectory(problem.robot.joints)
    except Infeasible:
        return None


def first_path(problem: Problem) -> dict[str, Any]:
    """A first path from start and goal alone, and the proof of the given one."""
    begin = time.process_time()
    row: dict[str, Any] = {"kind": problem.kind, "proof_seconds": proof_seconds(problem)}
    begin = time.process_time()
    try:
        planner = Planner(
            problem.robot, source_method_2(problem.robot.name), Settings(initial_paths=1), cell=problem.cell
        )
        move, source, _ = planner.first_path(Move(problem.start, problem.goal, "retime"))
    except Infeasible as error:
        return {**row, "source": "none", "seconds": time.process_time() - begin, "message": str(error)}
    seconds = time.process_time() - begin
    verdict, depth = judged(problem.cell, timed(problem, path_of(move)))
    return {**row, "source": source.source, "seconds": seconds, "verdict": verdict, "depth": depth}


def proof_seconds(problem: Problem) -> float | None:
    """CPU time of the proof of a free motion, the least of three."""
    trajectory = None if problem.given is None else timed(problem, problem.given)
    if trajectory is None or judged(problem.cell, trajectory)[0] != "proven":
        return None
    found = []
    for _ in range(3):
        begin = time.process_time()
        judged(problem.cell, trajectory)
        found.append(time.process_time() - begin)
    return min(found)


@dataclass
class Workers:
    """Planners of robots, each warm: what is built for one move serves all others."""

    seed: int = 0
    solver: str = "ipopt"
    _known: dict[tuple[str, int | None, bool], Planner] = field(default_factory=dict)

    def of(self, robot: Robot, initial_paths: int | None = None, payload: bool = False) -> Planner:
        """A planner that has solved a move before."""
        key = robot.name, initial_paths, payload
        if key not in self._known:
            model = source_method_2(robot.name)
            if payload:
                model = model.replaced(Payload(mass=PAYLOAD[0], com=list(PAYLOAD[1:])))
            settings = Settings(compile="always", seed=self.seed, initial_paths=initial_paths, solver=self.solver)
            self._known[key] = Planner(robot, model, settings)
            case = cases(robot, self._known[key], 1)[0]
            self._known[key].solve(case.move)
        return self._known[key]


def answered(planner: Planner, problem: Problem, given: JointPath | None, plain: bool = False) -> dict[str, Any]:
    """The whole answer at 1.5 times TOPP-RA's duration on the first path: what it saves, and what judges say of it.

    `work` is the figure that cuRobo calls energy, the integral of sum |tau v|, against that of the path slowed evenly.
    With `plain` the same move is answered without regard to anything it may touch, for the time that takes.
    """
    planner = planner.around(problem.cell)
    move = Move(problem.start, problem.goal, path=given)
    begin = time.process_time()
    try:
        move = replace(move, duration=SLOWER * planner.minimum_time(move))
        result = planner.solve(move)
    except Infeasible as error:
        seconds = time.process_time() - begin
        return {"kind": problem.kind, "status": "infeasible", "seconds": seconds, "message": str(error)}
    row = {"kind": problem.kind, **_stated(result), "seconds": time.process_time() - begin}
    cell = problem.cell if given is None else cell_beside(problem.cell, given)  # what a given path may come near
    row["verdict"], _ = judged(cell, result.trajectory)
    row["touching"] = seen(problem.robot, problem.scene, result.trajectory)
    scaled = result.baseline("scaled")
    if scaled is not None:
        row["work"], row["work_scaled"] = (absolute_work(planner, t) for t in (result.trajectory, scaled.trajectory))
    if plain:
        planner = planner.around(None)
        row["plain_seconds"], free = _clocked(planner, move)
        row["plain_saved"], row["plain_verdict"] = _saved(free), judged(problem.cell, free.trajectory)[0]
        row["ratio"] = row["seconds"] / row["plain_seconds"]
    return row


def own_body(planner: Planner, case: Case, cell: Cell) -> dict[str, Any]:
    """A move of the suites with its own body and without: what safety costs in loss saved and in time."""
    planner = planner.around(None)
    plain_seconds, free = _clocked(planner, case.move)
    planner = planner.around(cell)
    seconds, result = _clocked(planner, case.move)
    row = {"kind": planner.robot.name, **_stated(result), "seconds": seconds, "plain_seconds": plain_seconds}
    row |= {"plain_saved": _saved(free), "plain_verdict": judged(cell, free.trajectory)[0]}
    row["change_percent"] = 100 * (result.energy.loss / free.energy.loss - 1)
    row["verdict"], _ = judged(cell, result.trajectory)
    row["touching"] = seen(planner.robot, None, result.trajectory)
    begin = time.process_time()
    judged(cell, result.trajectory)
    return {**row, "ratio": seconds / plain_seconds, "proof_seconds": time.process_time() - begin}


def _clocked(planner: Planner, move: Move) -> tuple[float, Result]:
    begin = time.process_time()
    result = planner.solve(move)
    return time.process_time() - begin, result


def _saved(result: Result) -> float | None:
    """The loss saved against the first path slowed evenly, %, whether that one touches something or not."""
    scaled = result.baseline("scaled")
    return None if scaled is None else 100 * (1 - result.energy.loss / scaled.energy.loss)


def _stated(result: Result) -> dict[str, Any]:
    scaled = result.baseline("scaled")
    return {
        "status": result.status,
        "chosen": result.chosen,
        "source": result.first_path.source if result.first_path is not None else "-",
        "saved": _saved(result),
        "loss": result.energy.loss,
        "loss_scaled": None if scaled is None else scaled.energy.loss,
        "message": result.message,
    }


def absolute_work(planner: Planner, trajectory: Trajectory) -> float:
    """Integral of sum |tau v| over a trajectory, J."""
    filled = planner.scorer.filled(trajectory)
    return float(np.trapezoid(np.abs(filled.effort * filled.velocity).sum(axis=1), filled.time))
