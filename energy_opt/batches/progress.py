"""A progress line on stderr: how many, how fast, how long still."""

from __future__ import annotations

import sys
import time
from typing import TextIO

LINE_EVERY = 10.0  # s between lines where stderr is not a terminal


def clock(seconds: float) -> str:
    """Seconds as h:mm:ss.

    >>> clock(3725)
    '1:02:05'
    """
    whole = max(0, round(seconds))
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


class Progress:
    """Counts what is done; rate and time left come from this run alone, not from what was resumed."""

    def __init__(self, total: int, before: int = 0, *, quiet: bool = False, stream: TextIO | None = None) -> None:
        self.total, self.before = total, before
        self.done, self.failed = before, 0
        self._quiet, self._stream = quiet, stream or sys.stderr
        self._start = time.monotonic()
        self._shown = -LINE_EVERY
        self._width = 0

    @property
    def seconds(self) -> float:
        """Since the start of this run."""
        return time.monotonic() - self._start

    @property
    def rate(self) -> float:
        """Moves per second of this run."""
        return (self.done - self.before) / max(self.seconds, 1e-9)

    def count(self, solved: bool) -> None:
        """One more move is done."""
        self.done += 1
        self.failed += not solved
        self.show()

    def text(self) -> str:
        """The line."""
        words = [f"{self.done}/{self.total} moves"]
        if self.done > self.before:
            words += [f"{self.rate:.3g} moves/s", f"{clock((self.total - self.done) / self.rate)} left"]
        if self.failed:
            words.append(f"{self.failed} not solved")
        return ", ".join(words)

    def show(self, last: bool = False) -> None:
        """Rewrite the line on a terminal; elsewhere write one now and then."""
        if self._quiet:
            return
        text = self.text()
        if self._stream.isatty():
            self._stream.write("\r" + text.ljust(self._width) + ("\n" if last else ""))
            self._width = len(text)
        elif last or self.seconds - self._shown >= LINE_EVERY:
            self._shown = self.seconds
            self._stream.write(text + "\n")
        self._stream.flush()
