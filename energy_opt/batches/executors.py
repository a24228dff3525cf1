"""Workers of a batch: processes of this machine or a Dask cluster, and the distribution of tasks to them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED as FIRST
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType

from energy_opt.batches.records import Record, failed
from energy_opt.batches.task import Task
from energy_opt.batches.work import solve_task
from energy_opt.effects import known_effects
from energy_opt.errors import BadInput, EnergyOptError

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
