"""Conversion of faults of libraries, of the machine and of unforeseen ones to one line and an exit code.

Errors that the package raises on purpose (`EnergyOptError`) pass unchanged; all others that a verb raises end here.
Also here: checks of the standard streams, and opening of the report in a browser.
"""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path

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
    if isinstance(error, OSError) and error.filename is None and error.__traceback__ is not None:
        raised = Path(traceback.extract_tb(error.__traceback__)[-1].filename)
        if raised.parent == Path(__file__).parent:  # only modules of this folder print, others write files
            return BadInput(f"standard output cannot be written: {error.strerror}; files in --out are whole")
    if isinstance(error, OSError) and error.errno is not None:
        reason = error.strerror or str(error)
        if error.errno in FULL:
            reason = "the disk is full, or the file may not grow; no incomplete file was left"
        return BadInput(f"{error.filename}: {reason}" if error.filename else reason)
    if isinstance(error, MemoryError):
        what = str(error) or "an allocation failed"
        return BadInput(f"not enough memory: {what}; request a shorter duration, or fewer points or samples")
    if isinstance(error, RecursionError):
        return BadInput("nested too deeply to be read; flatten it")
    if isinstance(error, UnicodeError):
        return BadInput(f"not text that can be encoded: {error}")
    if isinstance(error, ImportError):
        return BadInput(f"a library cannot be imported: {error}; install energy-opt again with its dependencies")
    frame = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{os.path.basename(frame.filename)}:{frame.lineno}"
    reason = " ".join(str(error).split()) or "no reason given"
    return Unforeseen(
        f"cannot be computed with these values: {type(error).__name__}: {reason} ({place}); "
        "if they are sensible, this is a fault of the program: run again with -v and report it"
    )


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


SAY = ("robots", "effects", "--example", "--print-completion")  # these verbs and options only print


def opened(words: Sequence[str]) -> None:
    """Redirect closed streams to the null device, so that no file opened later gets their number.

    Characters that the terminal's encoding lacks are printed as escapes, such as \\u2265.

    Raises:
        BadInput: standard output is closed, and what was asked for is to be printed there.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    closed = [name for name in ("stderr", "stdout") if getattr(sys, name) is None]
    for name in closed:
        setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    if "stdout" in closed and ("--json" in words or (words and words[0].partition("=")[0] in SAY)):
        raise BadInput("standard output is closed, but the result is printed there")


@contextmanager
def stdout_for_json(wanted: bool) -> Iterator[None]:
    """A block that prints nothing on standard output if JSON is `wanted` there.

    What users' files, libraries and worker processes print goes to standard error.
    """
    if not wanted:
        yield
        return
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def flushed() -> int:
    """0 when standard output has taken all that was printed.

    Raises:
        OSError: it has not; what it refused is dropped.
    """
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise
    return 0


def view(out: Path, quiet: bool = False) -> None:
    """Open the report that was written into `out`; where there is no display, say where it is."""
    import webbrowser

    report = (Path(out) / "report.html").resolve()
    if not report.is_file():
        return
    try:
        if has_display() and webbrowser.open(report.as_uri()):
            return
    except webbrowser.Error:
        pass
    if not quiet:
        print(f"no browser to open; the report is {report}", file=sys.stderr)


def has_display() -> bool:
    """True if there is a display for a browser. (On a bare terminal, a browser would take the keyboard.)"""
    named = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
    return named or sys.platform in ("darwin", "win32")
