"""What the workers of batch tests do with a task; imported by their processes."""

from __future__ import annotations

import os
import signal
import time

from energy_opt.batches.records import identity


def known(task):
    """An answer that follows from the task alone, after a little time that does not."""
    time.sleep(0.002 * (os.getpid() % 3))
    row = identity(task) | {"status": "solved", "duration": 1.0 + task.index, "energy_total": sum(task.goal)}
    row |= {"energy_loss": 1.0, "max_violation": -0.1, "solve_seconds": 0.01, "build_seconds": 0.0, "iterations": 3}
    return {"key": task.key, "row": row, "worker": {"process": os.getpid()}}


def slow(task):
    """The same, slowly enough to be killed in the middle."""
    time.sleep(0.1)
    return known(task)


def deadly(task):
    """The third move kills the process that solves it."""
    if task.index == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return known(task)


def faulty(task):
    """The third move raises what nobody foresaw."""
    if task.index == 2:
        raise ZeroDivisionError("by nought")
    return known(task)


def failing_once(task):
    """The third move kills its worker the first time only (a marker file remembers)."""
    marker = os.environ["BENCH_TEST_MARKER"]
    if task.index == 2 and not os.path.exists(marker):
        open(marker, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    return known(task)
