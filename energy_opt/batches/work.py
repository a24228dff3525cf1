"""A worker's handling of a task: build once for tasks that share a problem, solve, and return a record."""

from __future__ import annotations

import os
import tempfile
import threading
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.batches.records import Record, failed, filled, identity
from energy_opt.batches.task import Task
from energy_opt.cell.cell import Cell
from energy_opt.errors import EnergyOptError, Infeasible
from energy_opt.formats import read_path
from energy_opt.motion import Move, Planner, Result, Settings
from energy_opt.motion.path import JointPath, through
from energy_opt.motion.plan.rivals import Rival
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.poses.ends import ends_from_text
from energy_opt.poses.solve import nearest_move, solve_to
from energy_opt.robot import Robot

KEPT = 4  # most built problems that a worker keeps; enough, because tasks are grouped by problem

_planners: OrderedDict[tuple[Any, ...], Planner] = OrderedDict()
_cells: OrderedDict[tuple[Any, ...], Cell] = OrderedDict()
# a cluster's worker may have several threads; a built problem serves one move at a time
_one_at_a_time = threading.Lock()


def solve_task(task: Task) -> Record:
    """Solve a task; every failure becomes a row with its reason."""
    with _one_at_a_time:
        try:
            record: Record = {"key": task.key, "row": _row(task), "worker": {}}
        except Infeasible as error:
            record = failed(task, str(error))
            record["row"]["status"] = "infeasible"
        except EnergyOptError as error:
            record = failed(task, str(error))
        except Exception as error:  # no error of a library in one move may end the batch
            record = failed(task, f"{type(error).__name__}: {error}")
        record["worker"] = {"process": os.getpid(), "memory": resident_memory()}
        return record


def _planner(task: Task) -> Planner:
    """The planner of a task. Tasks with the same build share one; a process keeps the last KEPT planners."""
    key, model = task.build, task.power()
    if key not in _planners:
        given = {"tool": task.surroundings.request.tool, **dict(task.settings)}
        settings = Settings(objective=task.objective, compile=task.compile, **given)
        while len(_planners) >= KEPT:
            _planners.popitem(last=False)
        _planners[key] = Planner(task.robot.load(), model, settings)
    _planners.move_to_end(key)
    return _planners[key].under(model).around(_cell(task, _planners[key].robot))


def _cell(task: Task, robot: Robot) -> Cell | None:
    """The arm's body in its cell, built once for tasks that share it."""
    around = task.surroundings
    if not around.request.checks and not around.scene:
        return None
    key = (task.robot, around, task.payload if around.request.payload_size else ())
    if key not in _cells:
        while len(_cells) >= KEPT:
            _cells.popitem(last=False)
        _cells[key] = around.cell(robot, task.payload)
    _cells.move_to_end(key)
    return _cells[key]


def _given_path(task: Task, robot: Robot) -> JointPath | None:
    """The path that a suite gives with a move."""
    ending, text = task.path
    if not text:
        return None
    with tempfile.TemporaryDirectory(prefix="energy-opt-") as folder:
        file = Path(folder) / f"path{ending}"
        file.write_text(text, encoding="utf-8")
        return read_path(file, robot.joints)


def _move(task: Task, robot: Robot, duration: float | None) -> Move:
    """The move; a retimed one follows a path through its via points, a reshaped one passes them freely."""
    start, goal = np.array(task.start), np.array(task.goal)
    given = _given_path(task, robot)
    if given is not None:
        return Move(given.start, given.goal, task.mode, duration, path=given)
    via = tuple(np.array(point) for point in task.via)
    if task.mode == "retime" and via:
        return Move(start, goal, task.mode, duration, path=through(np.vstack([start, *via, goal])))
    return Move(start, goal, task.mode, duration, via=via)


def _row(task: Task) -> dict[str, Any]:
    """Solve a task; returns its record. Multiples of the minimum time become seconds here."""
    planner, powers, row = _planner(task), task.powers(), identity(task)
    solver: Any = planner
    if len(powers) > 1:
        solver = RobustPlanner(planner.robot, [Rival(name, model) for name, model in powers], planner=planner)
    if task.ends:
        return filled(row, _posed(task, planner, solver, row).document())
    row["minimum_time"] = fastest = planner.minimum_time(_move(task, planner.robot, None))
    return filled(row, solver.solve(_move(task, planner.robot, task.timing.of(fastest))).document())


def _posed(task: Task, planner: Planner, solver: Any, row: dict[str, Any]) -> Result:
    """A move between poses of the tool; a multiple of the minimum time is one of the move to the nearest goal."""
    ends, robot, cell, settings = ends_from_text(task.ends), planner.robot, planner.cell, planner.settings
    move = Move(np.array(task.start), np.array(task.goal), task.mode, task.timing.seconds)
    row["minimum_time"] = planner.minimum_time(nearest_move(ends, move, robot, cell, settings))
    move = replace(move, duration=task.timing.of(row["minimum_time"]))
    return solve_to(ends, move, robot, [model for _, model in task.powers()], cell, settings, solver).result


def resident_memory() -> int | None:
    """Memory of this process, bytes; None if the system does not provide it."""
    try:
        with open("/proc/self/statm", encoding="ascii") as stream:
            return int(stream.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None
