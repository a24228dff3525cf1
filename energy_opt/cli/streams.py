"""Checks of the standard streams, and opening of the report in a browser."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

from energy_opt.errors import BadInput

SAY = ("robots", "effects", "--example", "--print-completion")  # these verbs and options only print


def opened(words: Sequence[str]) -> None:
    """Redirect closed streams to the null device, so that no file opened later gets their number.

    Raises:
        BadInput: standard output is closed, and what was asked for is to be printed there.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    closed = [name for name in ("stderr", "stdout") if getattr(sys, name) is None]
    for name in closed:
        setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    if "stdout" in closed and ("--json" in words or (words and words[0].partition("=")[0] in SAY)):
        raise BadInput("standard output is closed, but the result is printed there")


def of_output(fault: Exception) -> BadInput | None:
    """The error for a fault in printing, else None: only modules of this folder print, others write files."""
    if not isinstance(fault, OSError) or fault.filename is not None or fault.__traceback__ is None:
        return None
    if Path(traceback.extract_tb(fault.__traceback__)[-1].filename).parent != Path(__file__).parent:
        return None
    return BadInput(f"standard output cannot be written: {fault.strerror}; files in --out are whole")


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
