"""The desk of the command line: messages and progress on stderr, Ctrl-C as a request to stop."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from energy_opt.cli.faults import one_line, printable
from energy_opt.cli.interrupt import stop_on_interrupt
from energy_opt.cli.progress import Progress
from energy_opt.front.desk import Desk, Show


class Terminal(Desk):
    """A desk that talks to the terminal."""

    def say(self, text: str) -> None:
        """A message, unless --quiet."""
        if not self.quiet and text:
            print(printable(text), file=sys.stderr)

    def complain(self, text: str) -> None:
        """A fault, always."""
        print(f"energy-opt: {one_line(text)}", file=sys.stderr)

    @contextmanager
    def showing(self) -> Iterator[Show]:
        """Inside, Ctrl-C ends the process."""
        with Progress(self.quiet, self.verbose) as show:
            yield show

    @contextmanager
    def working(self) -> Iterator[tuple[Callable[[], bool], Show]]:
        """Inside, the first Ctrl-C asks to stop, the second ends the process."""
        with stop_on_interrupt() as stopped, Progress(self.quiet, self.verbose) as show:
            yield stopped, show
