"""What a worker does with a task: build once for tasks that share a problem, solve, and answer with a record."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from typing import TYPE_CHECKING, Any

import numpy as np

from energy_opt.bench.rows import Record, failed, filled, identity
from energy_opt.bench.task import Task
from energy_opt.errors import EnergyOptError, Infeasible

if TYPE_CHECKING:
    from energy_opt.motion import Move, Planner

KEPT = 4  # built problems that a worker holds; tasks come grouped by problem, so this is plenty

_planners: OrderedDict[tuple[Any, ...], Planner] = OrderedDict()
_one_at_a_time = threading.Lock()  # a cluster's worker may have several threads; a built problem serves one move


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
        except Exception as error:  # whatever a library throws at one move must not end the batch
            record = failed(task, f"{type(error).__name__}: {error}")
        record["worker"] = {"process": os.getpid(), "memory": resident_memory()}
        return record


def _planner(task: Task) -> Planner:
    from energy_opt.cell.load import load_cell
    from energy_opt.cell.request import CellRequest
    from energy_opt.motion import Planner, Settings

    key, model = task.build, task.power()
    if key not in _planners:
        settings = Settings(objective=task.objective, compile=task.compile, **dict(task.settings))
        while len(_planners) >= KEPT:
            _planners.popitem(last=False)
        robot = task.robot.load()
        _planners[key] = Planner(robot, model, settings, cell=load_cell(robot, CellRequest()))
    _planners.move_to_end(key)
    _planners[key].set_model(model)
    return _planners[key]


def _move(task: Task, duration: float | None) -> Move:
    """The move; a retimed one follows a path through its via points, a reshaped one passes them as it likes."""
    from energy_opt.motion import Move
    from energy_opt.motion.path import through

    start, goal = np.array(task.start), np.array(task.goal)
    via = tuple(np.array(point) for point in task.via)
    if task.mode == "retime" and via:
        return Move(start, goal, task.mode, duration, path=through(np.vstack([start, *via, goal])))
    return Move(start, goal, task.mode, duration, via=via)


def _row(task: Task) -> dict[str, Any]:
    planner = _planner(task)
    row = identity(task)
    row["minimum_time"] = fastest = planner.minimum_time(_move(task, None))
    duration = task.timing.seconds
    if task.timing.multiple is not None:
        duration = task.timing.multiple * fastest
    return filled(row, planner.solve(_move(task, duration)).document())


def resident_memory() -> int | None:
    """Memory that this process holds, bytes; None where the system does not say."""
    try:
        with open("/proc/self/statm", encoding="ascii") as stream:
            return int(stream.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None
