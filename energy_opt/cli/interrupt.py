"""Ctrl-C as a request: the first lets the work end with the best so far, the second ends the process."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_pressed = threading.Event()


def was_pressed() -> bool:
    """Whether Ctrl-C has come since the command began."""
    return _pressed.is_set()


def interrupt(signum: int, frame: object) -> None:
    """What Ctrl-C does while nothing is there that could be written: the command ends.

    A library that is interrupted while it is imported may raise another error in its place: `was_pressed` tells.
    """
    _pressed.set()
    raise KeyboardInterrupt


@contextmanager
def stop_on_interrupt() -> Iterator[Callable[[], bool]]:
    """A function that tells whether Ctrl-C has been pressed inside the block."""
    event = threading.Event()

    def request(signum: int, frame: object) -> None:
        if event.is_set():
            interrupt(signum, frame)
        event.set()

    if threading.current_thread() is not threading.main_thread():
        yield event.is_set
        return
    before = signal.signal(signal.SIGINT, request)
    try:
        yield event.is_set
    finally:
        signal.signal(signal.SIGINT, before)
