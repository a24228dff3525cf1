"""An answer at any time: when a search has to end, and how its best proven answer got better until then."""

from __future__ import annotations

import time
from collections.abc import Callable


class Progress:
    """One search for one motion.

    Args:
        deadline: seconds after which it ends with the best proven answer so far; None for no end.
        stopped: asked between solves; True where the user ends the search.
        begin: when the search began (`time.perf_counter`), s; None for now.
    """

    def __init__(
        self, deadline: float | None, stopped: Callable[[], bool] = lambda: False, begin: float | None = None
    ) -> None:
        self.deadline, self.interrupted = deadline, stopped
        self._begin = time.perf_counter() if begin is None else begin
        self.cut = False  # the deadline passed while something was still searched
        self.losses: list[tuple[float, float]] = []  # seconds since the begin, and the least loss until then, J

    @property
    def seconds(self) -> float:
        """Since the begin."""
        return time.perf_counter() - self._begin

    @property
    def left(self) -> float | None:
        """Seconds until the deadline, a nanosecond at least; None without one."""
        return None if self.deadline is None else max(self.deadline - self.seconds, 1e-9)

    def late(self) -> bool:
        """Has the deadline passed?"""
        return self.deadline is not None and self.seconds >= self.deadline

    def ended(self) -> bool:
        """Has the deadline passed, or did the user end the search?"""
        self.cut = self.cut or self.late()
        return self.cut or self.interrupted()

    def found(self, loss: float) -> None:
        """A proven answer with this loss [J] is known."""
        if not self.losses or loss < self.losses[-1][1]:
            self.losses.append((self.seconds, loss))
