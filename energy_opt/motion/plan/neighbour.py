"""A move at one duration after the other: as a single move is solved, and from a neighbour's optimum.

Fronts of energy against duration are made of such steps. A step does all that a single solve at its duration does, so
that a front lies nowhere above what single moves find (but for what they find around obstacles: there a step goes from
its neighbour's way on alone). What the starts lead to is shared by durations that lie close together, which a single
move has for itself alone. Then the neighbour's curve is taken as it is, with the new duration and with the rows that
bound it; the better one counts. A retimed path is retimed anew, which needs no start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from energy_opt.errors import Infeasible
from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.move import Move
from energy_opt.motion.plan.candidates import (
    least_energy_timing,
    mended,
    mended_timing,
    reference_time,
    task_of,
)
from energy_opt.motion.plan.choice import least
from energy_opt.motion.plan.clear import mended_clear
from energy_opt.motion.plan.context import Context
from energy_opt.motion.plan.making import first_timing, made
from energy_opt.motion.reshape.clear import ClearSearch
from energy_opt.motion.reshape.level import Outcome
from energy_opt.motion.reshape.search import Kept, Reshaper
from energy_opt.motion.reshape.task import FEASIBLE, Line, Task
from energy_opt.motion.timing.law import Timing
from energy_opt.motion.trajectory import Trajectory

ONLY_ONE = 1e-6  # so close to the minimum time (relative) there is no other timing of a path
CARRIED = 6  # rounds from a neighbour that keeps clear


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
        self._known: dict[float, Optimum | None] = {}  # what single solves find, by duration

    @cached_property
    def _timing(self) -> Timing | None:
        return first_timing(self._context, self._move)

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
        if duration not in self._known:
            self._known[duration] = self._single(move)
        found = [carried, self._known[duration]]
        if self._context.cell is not None and not any(x is not None and x.outcome is not None for x in found):
            found.append(self._cleared(task, neighbour))
        best = min((x for x in found if x is not None), key=lambda x: x.energy.total, default=None)
        return best if best is not None else self._retimed(duration)

    def _single(self, move: Move) -> Optimum | None:
        """What a solve of the move alone finds; None where nothing within limits came of it."""
        try:
            work = made(self._context, move, self._timing, kept=self._kept, around=False)
        except Infeasible:
            return None
        slowed = []
        if work.timing is not None and work.solution is not None:
            joints = self._context.robot.joints
            slowed = [("scaled", work.timing.slowed(work.solution.trajectory.duration).trajectory(joints))]
        best, _ = least(self._context, move, work, slowed)
        if best is None:
            return None
        name, judged = best
        outcome = work.asked.outcome if name == "reshape" else None
        return Optimum(judged.trajectory, judged.energy, work.asked.converged, outcome)

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
