"""Linear algebra on one thread: matrices of a move are small, and threads that wait for more work cost a third more."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from threading import Lock
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

Given = ParamSpec("Given")
Found = TypeVar("Found")


_limited = Lock()  # held while the number is one


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()


def one_thread(function: Callable[Given, Found]) -> Callable[Given, Found]:
    """The function with NumPy's and SciPy's linear algebra on one thread; the number before is restored.

    So its results do not depend on the number of cores either. The number is one for the whole process: only the call
    that sets it restores it. A call within that one, or beside it in another thread, leaves it as it is.
    """

    @wraps(function)
    def limited(*args: Given.args, **kwargs: Given.kwargs) -> Found:
        if not _limited.acquire(blocking=False):
            return function(*args, **kwargs)
        try:
            with _libraries().limit(limits=1, user_api="blas"):
                return function(*args, **kwargs)
        finally:
            _limited.release()

    return limited
