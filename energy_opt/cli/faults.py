"""Conversion of faults of libraries, of the machine and of unforeseen ones to one line and an exit code.

Errors that the package raises on purpose (`EnergyOptError`) pass unchanged; all others that a verb raises end here.
"""

from __future__ import annotations

import errno
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from energy_opt.errors import BadInput, EnergyOptError

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
LONGEST = 1500  # most characters of a line; a longer one is cut in its middle


class Unforeseen(BadInput):
    """A fault that no check foresaw, most likely by an extreme value; the line says where."""

    status = "failed"


def as_error(error: Exception) -> EnergyOptError:
    """Convert an exception to an error with one clear line."""
    if isinstance(error, EnergyOptError):
        return error
    if isinstance(error, OSError) and error.errno is not None:
        return BadInput(_of_system(error))
    if isinstance(error, MemoryError):
        what = str(error) or "an allocation failed"
        return BadInput(f"not enough memory: {what}; ask for less: a shorter duration, or fewer points or samples")
    if isinstance(error, RecursionError):
        return BadInput("nested too deeply to be read; flatten it")
    if isinstance(error, UnicodeError):
        return BadInput(f"not text that can be encoded: {error}")
    if isinstance(error, ImportError):
        return BadInput(f"a library cannot be imported: {error}; install energy-opt again with its dependencies")
    frame = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{os.path.basename(frame.filename)}:{frame.lineno}"
    return Unforeseen(
        f"cannot be computed with these values: {type(error).__name__}: {error or 'no reason given'} ({place}); "
        "if they are sensible, this is a fault of the program: run again with -v and report it"
    )


def _of_system(error: OSError) -> str:
    reason = error.strerror or str(error)
    if error.errno in FULL:
        reason = "the disk is full, or the file may not grow; nothing half written was left"
    return f"{error.filename}: {reason}" if error.filename else reason


def printable(text: str) -> str:
    """A text with control characters as escapes, so that names in files cannot control the terminal."""
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)


def one_line(message: str) -> str:
    """A message with control characters as escapes, cut to `LONGEST` characters."""
    text = printable(message)
    if len(text) <= LONGEST:
        return text
    return f"{text[: LONGEST // 2]} … {text[-LONGEST // 2 :]}"


_pressed = threading.Event()


def was_pressed() -> bool:
    """Whether Ctrl-C has come since the command began."""
    return _pressed.is_set()


def interrupt(signum: int, frame: object) -> None:
    """Handle Ctrl-C while there is no result to write: end the command.

    A library that is interrupted while it is imported may raise another error instead: `was_pressed` shows this.
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
