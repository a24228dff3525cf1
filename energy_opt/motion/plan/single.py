"""One move at any duration, from its first path to its answer: the search behind single moves and points of fronts."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from energy_opt.errors import Infeasible
from energy_opt.motion.move import Move
from energy_opt.motion.plan.anytime import Progress
from energy_opt.motion.plan.choice import baselines_of, choose
from energy_opt.motion.plan.context import Context
from energy_opt.motion.plan.making import first_timing, made
from energy_opt.motion.reshape.curve import Outcome
from energy_opt.motion.reshape.search import Kept
from energy_opt.motion.result import FirstPath, Result
from energy_opt.motion.timing.law import Timing
from energy_opt.motion.trajectory import Trajectory


@dataclass(frozen=True)
class Solved:
    """A result, and the curve that it is (None where it is no reshaped one)."""

    result: Result
    outcome: Outcome | None


class Single:
    """Solves one move at any duration; what durations share is found once.

    Args:
        context: with the ways that the move may start from besides its own path.
        move: with its first path; its own duration is ignored.
        first: where that path comes from.
    """

    def __init__(self, context: Context, move: Move, first: FirstPath) -> None:
        self.context, self.first = context, first
        self.move = replace(move, duration=None, max_duration=None)
        self._kept: Kept = {}

    @cached_property
    def timing(self) -> Timing | None:
        """The fastest of the first path; None where a reshaped move's has none."""
        return first_timing(self.context, self.move)

    def at(
        self, duration: float | None, max_duration: float | None = None, warm: Sequence[Trajectory] = (),
        progress: Progress | None = None,
    ) -> Solved:  # fmt: skip
        """The answer in that time.

        Args:
            progress: of a search that has started already; by default it begins now, with the settings' deadline.

        Raises:
            Infeasible: no timing or no path holds the limits; says which, where and what would work.
        """
        if progress is None:
            progress = Progress(self.context.settings.deadline, self.context.stopped)
        context, workshop = replace(self.context, stopped=progress.ended, progress=progress), self.context.workshop
        move = replace(self.move, duration=duration, max_duration=max_duration)
        built, begin = workshop.seconds, time.perf_counter()
        begun = None
        if duration is not None and self.timing is not None and duration >= self.timing.duration:
            begun = baselines_of(context, move, self.timing, duration)
            judged = dict(begun)["scaled"]
            if judged.certificate.valid:
                progress.found(judged.energy.loss)
        work = made(context, move, self.timing, warm, self._kept)
        build = workshop.seconds - built + (work.solution.build_seconds if work.solution is not None else 0.0)
        try:
            result = choose(context, move, work, build, time.perf_counter() - begin - build, begun)
        except Infeasible as error:
            if not self.first.blocked or context.stopped():
                raise
            blocked = f"{self.first.blocked}; nor did reshaping from it keep clear"
            raise Infeasible(blocked, limit="clearance") from error
        outcome = work.asked.outcome if result.chosen == "reshape" else None
        return Solved(replace(result, first_path=self.first), outcome)
