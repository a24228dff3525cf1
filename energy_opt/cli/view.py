"""`--view`: the report in the browser."""

from __future__ import annotations

import os
import sys
from pathlib import Path


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
    """Is there anything that a browser can be seen on? (On a bare terminal one would take the keyboard.)"""
    named = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
    return named or sys.platform in ("darwin", "win32")
