"""The terminal that a verb talks to: messages, and progress with the time that is left."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

from energy_opt.cli.faults import one_line, printable, stop_on_interrupt
from energy_opt.front.desk import Desk, Show

PATIENCE = 1.0  # [s] shorter work shows no progress
TICK = 0.5  # [s] between updates of the progress line
LEAST_SHARE = 0.03  # least share of the work from which the time left is estimated
WIDTH = 100  # characters of the progress line


def write_message(text: str, stream: TextIO | None = None) -> None:
    """Write a message on standard error; where nobody takes it any more, the work goes on without messages."""
    stream = stream or sys.stderr
    try:
        stream.write(text)
        stream.flush()
    except OSError:  # the terminal was closed, the pipe's reader has ended, or the disk is full
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), stream.fileno())


class Progress(logging.Handler, Show):
    """Shows progress while its block lasts; silent with --quiet, and off a terminal without -v."""

    def __init__(self, quiet: bool, verbose: bool, stream: TextIO | None = None) -> None:
        super().__init__(logging.INFO)
        self._stream = stream or sys.stderr
        self._lines = verbose and not quiet
        self._rewrites = not self._lines and not quiet and self._stream.isatty()
        self._begin = self._stage_begin = time.monotonic()
        self._text, self._detail = "", ""
        self._share: float | None = None
        self._expected: float | None = None
        self._own = False  # True if the verb itself states its progress
        self._span: tuple[float, float] | None = None  # range of all the work that a stage's own shares refer to
        self._ended, self._written = threading.Event(), False
        self._before = logging.NOTSET

    def __enter__(self) -> Progress:
        if self._lines or self._rewrites:
            logger = logging.getLogger("energy_opt")
            self._before = logger.level
            logger.addHandler(self)
            logger.setLevel(logging.INFO)
        if self._rewrites:
            threading.Thread(target=self._tick, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._lines or self._rewrites:
            logger = logging.getLogger("energy_opt")
            logger.removeHandler(self)
            logger.setLevel(self._before)
        with self.lock or threading.RLock():
            if self._written:
                write_message("\r" + " " * WIDTH + "\r", self._stream)

    def __call__(self, text: str, share: float | None = None) -> None:
        """Show that the verb starts `text`; `share` of all its work is done."""
        self._own, self._text, self._share, self._detail, self._expected = True, text, share, "", None
        self._span = None
        self._say(text)

    def stage(self, text: str, low: float, high: float) -> None:
        """Show that the verb starts `text`, which takes its work from `low` to `high`; log records refine the share."""
        self(text, low)
        self._span = low, high

    def emit(self, record: logging.LogRecord) -> None:
        """Show a stage of the solver from its log record."""
        self._detail = record.getMessage()
        self._expected, self._stage_begin = getattr(record, "expected", None), time.monotonic()
        share = getattr(record, "share", None)
        if share is not None and self._span is not None:
            self._share = self._span[0] + (self._span[1] - self._span[0]) * share
        elif share is not None and not self._own:
            self._share = share
        self._say(f"  {self._detail}" if self._own else self._detail)

    def line(self) -> str:
        """Progress line: seconds so far, seconds left if known, and what is being done."""
        now = time.monotonic()
        words = [f"{now - self._begin:.0f} s"]
        left = self.left(now)
        if left is not None:
            words.append(f"about {left:.0f} s left")
        text = ": ".join(part for part in (self._text, self._detail) if part)
        return f"{', '.join(words)} | {text}"[:WIDTH]

    def left(self, now: float) -> float | None:
        """Seconds left, by the stage's own estimate or by the share of the work that is done."""
        if self._expected is not None:
            return max(self._expected - (now - self._stage_begin), 0.0)
        if self._share is None or self._share < LEAST_SHARE:
            return None
        return (now - self._begin) * (1 - self._share) / self._share

    def _say(self, text: str) -> None:
        if self._lines:
            left = self.left(time.monotonic())
            more = "" if left is None else f", about {left:.0f} s left"
            write_message(f"[{time.monotonic() - self._begin:6.1f} s{more}] {text}\n", self._stream)

    def _tick(self) -> None:
        """Rewrite the line of progress every TICK seconds until the block ends."""
        while not self._ended.wait(TICK):
            if time.monotonic() - self._begin < PATIENCE:
                continue
            with self.lock or threading.RLock():
                if not self._ended.is_set():
                    write_message("\r" + self.line().ljust(WIDTH), self._stream)
                    self._written = True


class Terminal(Desk):
    """A desk that talks to the terminal."""

    def say(self, text: str) -> None:
        """A message, unless --quiet."""
        if not self.quiet and text:
            write_message(f"{printable(text)}\n")

    def complain(self, text: str) -> None:
        """A fault, always."""
        write_message(f"energy-opt: {one_line(text)}\n")

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
