"""Ctrl-C where libraries that call Python lose exceptions, as CasADi does."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interrupted_at_end(*, only: bool = False) -> Iterator[list[BaseException]]:
    """A block at whose end an exception of the handler of Ctrl-C is raised, again if it was lost.

    Args:
        only: the exception is raised at the end only.

    Yields:
        The exceptions of the handler so far.
    """
    raised: list[BaseException] = []
    before = signal.getsignal(signal.SIGINT)
    if not callable(before) or threading.current_thread() is not threading.main_thread():
        yield raised
        return

    def handle(signum: int, frame: FrameType | None) -> None:
        try:
            before(signum, frame)
        except BaseException as error:
            raised.append(error)
            if not only:
                raise

    signal.signal(signal.SIGINT, handle)
    try:
        yield raised
    finally:
        signal.signal(signal.SIGINT, before)
        if raised:
            raise raised[0]
