"""Ctrl-C as a request: the first lets the work end with the best so far, the second ends the process."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def stop_on_interrupt() -> Iterator[Callable[[], bool]]:
    """A function that tells whether Ctrl-C has been pressed inside the block."""
    event = threading.Event()

    def request(signum: int, frame: object) -> None:
        if event.is_set():
            raise KeyboardInterrupt
        event.set()

    if threading.current_thread() is not threading.main_thread():
        yield event.is_set
        return
    before = signal.signal(signal.SIGINT, request)
    try:
        yield event.is_set
    finally:
        signal.signal(signal.SIGINT, before)
