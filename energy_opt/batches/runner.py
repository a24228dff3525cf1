"""Runs the tasks that are left: keeps workers busy, turns every failure into a row, survives workers that die."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED as FIRST
from concurrent.futures import BrokenExecutor, CancelledError, Future, wait

from energy_opt.batches.executors import Opener, local
from energy_opt.batches.records import Record, failed
from energy_opt.batches.task import Task
from energy_opt.batches.work import solve_task
from energy_opt.errors import EnergyOptError

Solver = Callable[[Task], Record]


def run_tasks(tasks: Sequence[Task], place: Opener, solve: Solver = solve_task) -> Iterator[Record]:
    """Records of all tasks, in the order in which they come.

    Tasks that were in the hands of a pool whose worker died are tried again, each alone; the one that kills its
    worker again becomes a row that says so.
    """
    left = deque(sorted(tasks, key=_by_build(tasks)))
    while left:
        suspects = yield from _drain(left, place, solve)
        for task in suspects:
            alone = deque([task])
            if (yield from _drain(alone, lambda: local(1), solve)):
                yield failed(task, "the worker process died while it solved this move")


def _by_build(tasks: Sequence[Task]) -> Callable[[Task], tuple[int, int]]:
    """Sort key that keeps tasks of one built problem together, in the order of the suite otherwise."""
    first: dict[object, int] = {}
    group = {task.index: first.setdefault(task.build, task.index) for task in tasks}
    return lambda task: (group[task.index], task.index)


def _drain(left: deque[Task], place: Opener, solve: Solver) -> Generator[Record, None, list[Task]]:
    """Run tasks from `left` until it is empty or a worker dies; returns the tasks that were under way when one did."""
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
                    raise EnergyOptError("the cluster gave up its work; --resume does what is left") from None
                except Exception as error:
                    yield failed(task, f"{type(error).__name__}: {error}")
    return suspects
