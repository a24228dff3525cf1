"""A move at one duration after the other: from its starts, as a single move is, and from a neighbour's optimum.

Fronts of energy against duration are made of such steps. What the starts lead to is found once for durations that lie
close together, and solved at each; the neighbour's curve is taken as it is, with the new duration and with the rows
that bound it. Where both are the same optimum the neighbour's is the quicker way there, else the better one counts. So
a front lies nowhere above what a single move finds. A retimed path is retimed anew, which needs no start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.move import Move
from energy_opt.motion.plan.candidates import (
    first_line,
    least_energy_timing,
    mended,
    mended_timing,
    reference_time,
    task_of,
)
from energy_opt.motion.plan.clear import mended_clear
from energy_opt.motion.plan.context import Context, path_of
from energy_opt.motion.reshape.clear import ClearSearch
from energy_opt.motion.reshape.level import Outcome
from energy_opt.motion.reshape.search import Kept, Reshaper
from energy_opt.motion.reshape.task import FEASIBLE, Line, Task
from energy_opt.motion.timing.law import Timing
from energy_opt.motion.trajectory import Trajectory

ONLY_ONE = 1e-6  # so close to the minimum time (relative) there is no other timing of a path
CARRIED = 6  # rounds from a neighbour that keeps clear
PLACES = np.linspace(0, 1, 33)  # where curves are compared


@dataclass(frozen=True)
class Optimum:
    """The least energy found at one duration; the next step starts from `outcome` (None after retiming)."""

    trajectory: Trajectory
    energy: Energy
    converged: bool
    outcome: Outcome | None = None


class Neighbours:
    """Solves one move (its own duration is ignored) at one duration after the other."""

    def __init__(self, context: Context, move: Move) -> None:
        self._context, self._move = context, replace(move, duration=None, max_duration=None)
        self._kept: Kept = {}
        self._coarse: dict[float, list[Outcome]] = {}  # what the starts lead to, by duration
        self._refined: set[float] = set()  # durations at which that was refined already

    @cached_property
    def _timing(self) -> Timing | None:
        try:
            return self._context.fastest(path_of(self._move))
        except Infeasible:
            if self._move.mode == "retime":
                raise
            return None

    @cached_property
    def _reshaper(self) -> Reshaper:
        return self._context.reshaper("energy")

    def at(self, duration: float, neighbour: Optimum) -> Optimum | None:
        """The optimum at exactly `duration` s, from starts and a neighbour's; None where nothing within limits came.

        Raises:
            Infeasible: retiming, where `duration` is below the path's minimum time.
        """
        if self._move.mode == "retime":
            return self._retimed(duration)
        move = replace(self._move, duration=duration)
        reference = reference_time(self._context, move, self._timing)
        task = task_of(self._context, move, reference, duration)
        carried = self._carried(task, neighbour)
        found = [carried, self._from_starts(task, carried)]
        if self._context.cell is not None and not any(found):
            found.append(self._cleared(task, neighbour))
        best = min((x for x in found if x is not None), key=lambda x: x.energy.total, default=None)
        return best if best is not None else self._retimed(duration)

    def _carried(self, task: Task, neighbour: Optimum) -> Optimum | None:
        if neighbour.outcome is None:
            outcome = self._reshaper.from_line(Line.of(neighbour.trajectory), task)
        else:
            start = replace(neighbour.outcome, curve=replace(neighbour.outcome.curve, duration=task.durations[0]))
            outcome = self._reshaper.step(start, task)
        return self._judged(outcome, task)

    def _cleared(self, task: Task, neighbour: Optimum) -> Optimum | None:
        """From a neighbour that keeps clear, on to what does so at this duration."""
        context = self._context
        assert context.cell is not None
        search, level = ClearSearch(context.cell, context.robot.joints), self._reshaper.fine(task.vias)
        curve = task.curve(level.shape, Line.of(neighbour.trajectory))
        if neighbour.outcome is not None and neighbour.outcome.curve.shape is level.shape:
            curve = replace(neighbour.outcome.curve, duration=task.durations[0])
        found = search.run(level, task, curve, context.stopped, rounds=CARRIED)
        if found.best is None:
            return None
        made = mended_clear(context, search, task, found.best)
        if made.trajectory is None or made.outcome is None:
            return None
        judged = context.judge(made.trajectory)
        return Optimum(made.trajectory, judged.energy, True, made.outcome) if judged.certificate.valid else None

    def _from_starts(self, task: Task, carried: Optimum | None) -> Optimum | None:
        """What the move's own search finds; None where that is the optimum which the neighbour's led to already."""
        context, duration = self._context, task.durations[0]
        if duration not in self._coarse:
            settings, line = context.settings, first_line(self._move, duration)
            optima, _, _ = self._reshaper.optima(
                task, [line], settings.starts, settings.seed, context.stopped, self._kept
            )
            self._coarse[duration] = optima
        optima = self._coarse[duration]
        if duration in self._refined or (carried is not None and _nearest(optima, carried) == 0):
            return None
        self._refined.add(duration)
        best, _ = self._reshaper.refined(task, optima, context.stopped)
        return None if best is None else self._judged(best, task)

    def _judged(self, outcome: Outcome, task: Task) -> Optimum | None:
        """Within limits by the judge, or None."""
        if outcome.broken > FEASIBLE:
            return None
        best, trajectory, certificate, _ = mended(self._context, self._reshaper, outcome, task)
        if not certificate.valid:
            return None
        judged = self._context.judge(trajectory)
        return Optimum(trajectory, judged.energy, best.converged, best) if judged.certificate.valid else None

    def _retimed(self, duration: float) -> Optimum | None:
        context, shortest = self._context, self._timing
        if shortest is None:
            return None
        if abs(duration / shortest.duration - 1) < ONLY_ONE:
            trajectory, converged = shortest.trajectory(context.robot.joints), True
        else:
            move = replace(self._move, duration=duration)
            solution = least_energy_timing(context, move, shortest)
            if solution is None:
                return None
            made = mended_timing(context, move, solution)
            if made.trajectory is None:
                return None
            trajectory, converged = made.trajectory, made.converged
        judged = context.judge(trajectory)
        return Optimum(trajectory, judged.energy, converged) if judged.certificate.valid else None


def _nearest(optima: Sequence[Outcome], found: Optimum) -> int:
    """Which of several coarse optima a fine one belongs to."""
    t = found.trajectory
    q = t.sample(t.time[0] + PLACES * t.duration)[0]
    return int(np.argmin([np.abs(o.curve.position(PLACES) - q).max() for o in optima]))
