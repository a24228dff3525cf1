"""`--view`: the report in the browser."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path


def add_view(group: argparse._ActionsContainer) -> None:
    """The option."""
    group.add_argument("--view", action="store_true", help="open report.html in the browser when it is written")


def view(args: argparse.Namespace, out: Path) -> None:
    """Open the report that was written into `out`, if asked to; where there is no display, say where it is."""
    if not args.view:
        return
    import webbrowser

    report = (Path(out) / "report.html").resolve()
    if not report.is_file():
        return
    try:
        if has_display() and webbrowser.open(report.as_uri()):
            return
    except webbrowser.Error:
        pass
    if not args.quiet:
        print(f"no browser to open; the report is {report}", file=sys.stderr)


def has_display() -> bool:
    """Is there anything that a browser can be seen on? (On a bare terminal one would take the keyboard.)"""
    named = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
    return named or sys.platform in ("darwin", "win32")
