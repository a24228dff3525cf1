"""Workers of a batch: processes of this machine or a Dask cluster, and the distribution of tasks to them."""

from __future__ import annotations

import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED as FIRST
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from multiprocessing import connection
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from energy_opt.batches.records import Record, failed, filled, identity
from energy_opt.batches.task import Task
from energy_opt.cell.cell import Cell
from energy_opt.effects import known_effects
from energy_opt.errors import BadInput, EnergyOptError, Infeasible
from energy_opt.formats import read_path
from energy_opt.motion import Move, Planner, Result, Settings
from energy_opt.motion.path import JointPath, through
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.poses.cheapest_move import nearest_move, solve_to
from energy_opt.poses.given import ends_from_text
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


def resident_memory() -> int:
    """Memory of this process [bytes]; the most so far where there is no /proc, as in a bare chroot."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        unit = 1 if sys.platform == "darwin" else 1024  # [bytes]
        return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


# For workers: one thread for linear algebra, and no imports from the current folder (such as a `selectors.py` there).
_FOR_WORKERS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "PYTHONSAFEPATH")


@dataclass(frozen=True)
class Place:
    """A running set of workers: submit to `executor`, with about `window` moves at a time."""

    executor: Executor
    window: int


Opener = Callable[[], AbstractContextManager[Place]]


def _follow_parent() -> None:
    """In a worker: leave Ctrl-C to the parent, and exit when the parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def leave() -> None:
        if parent is not None:
            connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=leave, daemon=True).start()


class _Process(SpawnProcess):
    """A process that does not run the user's script again, as processes of Python do, unless it defines effects."""

    def start(self) -> None:
        """Start it; what it knows of the user's script is read from `__main__` now."""
        main = sys.modules["__main__"]
        if not any(kind.__module__ == "__main__" for kind in known_effects().values()):
            sys.modules["__main__"] = ModuleType("__main__")
        try:
            super().start()
        finally:
            sys.modules["__main__"] = main


class _Context(SpawnContext):
    """Starts such processes."""

    Process = _Process


@contextmanager
def local(jobs: int) -> Iterator[Place]:
    """`jobs` processes of this machine, each with one thread for linear algebra; killed on an exception."""
    before = {name: os.environ.get(name) for name in _FOR_WORKERS}
    others = set(multiprocessing.active_children())
    os.environ.update({name: value or "1" for name, value in before.items()})
    executor = ProcessPoolExecutor(jobs, mp_context=_Context(), initializer=_follow_parent)
    try:
        yield Place(executor, 2 * jobs)
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - others:
            process.kill()
        raise
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)


@contextmanager
def cluster(address: str) -> Iterator[Place]:
    """The workers of a running Dask cluster.

    Raises:
        EnergyOptError: the extra is not installed.
        BadInput: nothing answers at `address`, or the cluster has no workers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise EnergyOptError("--scheduler needs Dask: pip install 'energy-opt[cluster]'") from None
    if "://" not in address and not address.rpartition(":")[2].isdigit():
        raise BadInput(f"--scheduler {address}: no Dask scheduler answers there; expected HOST:PORT or tcp://HOST:PORT")
    try:
        client = Client(address, timeout="10s", set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise BadInput(f"--scheduler {address}: no Dask scheduler answers there ({error})") from None
    with client:
        threads = sum(client.nthreads().values())
        if threads == 0:
            raise BadInput(f"--scheduler {address}: no workers; start some: dask worker {address}")
        executor = client.get_executor(pure=False)
        try:
            yield Place(executor, 2 * threads)
        finally:
            executor.shutdown(wait=False)


Solver = Callable[[Task], Record]


def run_tasks(tasks: Sequence[Task], place: Opener, solve: Solver = solve_task) -> Iterator[Record]:
    """Records of all tasks, in the order of arrival.

    If a worker dies, the tasks of its pool are tried again, each alone; a task that kills its worker again gets a
    record with that reason.

    Args:
        tasks: to do. place: opens the workers.
        solve: what a worker does with a task; workers must be able to import it.

    Raises:
        EnergyOptError: the cluster stopped.
    """
    first: dict[object, int] = {}  # tasks of one built problem stay together, otherwise in the order of the suite
    group = {task.index: first.setdefault(task.build, task.index) for task in tasks}
    left = deque(sorted(tasks, key=lambda task: (group[task.index], task.index)))
    while left:
        suspects = yield from _run_until_worker_dies(left, place, solve)
        for task in suspects:
            alone = deque([task])
            if (yield from _run_until_worker_dies(alone, lambda: local(1), solve)):
                yield failed(task, "the worker process died while it solved this move")


def _run_until_worker_dies(left: deque[Task], place: Opener, solve: Solver) -> Generator[Record, None, list[Task]]:
    """Run tasks from `left` until it is empty or a worker dies; returns the tasks that were running when one died."""
    running: dict[Future[Record], Task] = {}
    suspects: list[Task] = []
    with place() as at:
        while (left and not suspects) or running:
            while left and not suspects and len(running) < at.window:
                try:
                    running[at.executor.submit(solve, left[0])] = left[0]
                except BrokenExecutor:
                    if not running:
                        suspects.append(left.popleft())
                    break
                left.popleft()
            done, _ = wait(running, return_when=FIRST)
            for future in sorted(done, key=lambda f: running[f].index):
                task = running.pop(future)
                try:
                    yield future.result()
                except BrokenExecutor:
                    suspects.append(task)
                except CancelledError:
                    raise EnergyOptError("the cluster stopped; --resume runs the remaining moves") from None
                except Exception as error:
                    yield failed(task, f"{type(error).__name__}: {error}")
    return suspects
