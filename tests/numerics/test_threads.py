"""The number of threads of linear algebra is the process's own again when nothing plans any more."""

import os
import subprocess
import sys

SCRIPT = """
from concurrent.futures import ThreadPoolExecutor
from threading import Event
import numpy
from threadpoolctl import threadpool_info
from energy_opt.numerics.threads import one_thread

def blas():
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}

begun, leave = (Event(), Event()), (Event(), Event())

@one_thread
def work(k):
    begun[k].set()
    leave[k].wait(20)
    return blas()

before = blas()
with ThreadPoolExecutor(2) as pool:
    found = []
    for k in (0, 1):
        found.append(pool.submit(work, k))
        begun[k].wait(20)
    leave[0].set()
    assert found[0].result() == {1}
    leave[1].set()
assert blas() == before, (before, blas())
"""


def test_threads_that_plan_at_once_restore_it():
    """The one that ended last had restored the limit of the first: all later linear algebra was on one thread."""
    several = {"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, env=os.environ | several)
    assert done.returncode == 0, done.stderr
