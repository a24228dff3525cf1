"""Where moves are computed: processes of this machine, or the workers of a Dask cluster, behind one interface."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from multiprocessing.connection import wait

from energy_opt.errors import BadInput, EnergyOptError

# For workers: one thread for linear algebra, and no code from the current folder (a `selectors.py` that lies there).
_FOR_WORKERS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "PYTHONSAFEPATH")


@dataclass(frozen=True)
class Place:
    """A running set of workers: submit to `executor`, keep about `window` moves in its hands."""

    executor: Executor
    window: int


Opener = Callable[[], AbstractContextManager[Place]]


def _follow_parent() -> None:
    """In a worker: leave Ctrl-C to the parent, and do not outlive it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def leave() -> None:
        if parent is not None:
            wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=leave, daemon=True).start()


@contextmanager
def local(jobs: int) -> Iterator[Place]:
    """`jobs` processes of this machine, each with one thread for linear algebra; killed when left by an exception."""
    before = {name: os.environ.get(name) for name in _FOR_WORKERS}
    others = set(multiprocessing.active_children())
    os.environ.update({name: value or "1" for name, value in before.items()})
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(jobs, mp_context=context, initializer=_follow_parent)
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
