"""The deadline of a search, and how its best proven answer improved over time."""

from __future__ import annotations

import time
from collections.abc import Callable

LATE = "the deadline passed before a shorter one was looked for or this one was confirmed"


class Progress:
    """The progress of one search for one motion.

    Args:
        deadline: seconds after which the search ends with the best proven answer so far; None for no deadline.
        stopped: called between solves; returns True if the user ends the search.
        begin: when the search began (`time.perf_counter`), s; None for now.
        enough: whether any proven answer ends the search.
    """

    def __init__(
        self,
        deadline: float | None,
        stopped: Callable[[], bool] = lambda: False,
        begin: float | None = None,
        enough: bool = False,
    ) -> None:
        self.deadline, self.interrupted, self.enough = deadline, stopped, enough
        self._begin = time.perf_counter() if begin is None else begin
        self.cut = False  # True if the deadline passed during the search, or any answer was enough
        self.losses: list[tuple[float, float]] = []  # (seconds since the begin, least loss so far [J])

    @property
    def seconds(self) -> float:
        """Seconds since the begin."""
        return time.perf_counter() - self._begin

    @property
    def left(self) -> float | None:
        """Seconds until the deadline, at least a nanosecond; None without a deadline."""
        return None if self.deadline is None else max(self.deadline - self.seconds, 1e-9)

    def late(self) -> bool:
        """Has the deadline passed?"""
        return self.deadline is not None and self.seconds >= self.deadline

    def ended(self) -> bool:
        """Has the deadline passed, is any answer enough, or did the user end the search?"""
        self.cut = self.cut or self.late() or (self.enough and bool(self.losses))
        return self.cut or self.interrupted()

    def found(self, loss: float) -> None:
        """Record that a proven answer with this loss [J] is known."""
        if not self.losses or loss < self.losses[-1][1]:
            self.losses.append((self.seconds, loss))
