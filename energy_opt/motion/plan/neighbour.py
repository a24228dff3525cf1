"""Solve one move at several durations, each as a single move or from the optimum of a neighbouring duration.

Fronts of energy against duration consist of such steps. The first duration is solved as a single move; every other one
starts at the optimum of its neighbour. At durations that differ by a factor of `ALONE`, all optima are compared again.
They are continued from those of the neighbouring duration, not from random starts. If another one is now the best, the
move is solved there as a single move. All durations share first paths and their timings. Then the search continues a
neighbour's curve if this may lead to less energy, and the better result counts. A retimed path needs no start: it is
solved anew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.move import Move
from energy_opt.motion.plan.busy_joints import with_busy_joints
from energy_opt.motion.plan.candidates import (
    NEAR_FASTEST,
    least_energy_timing,
    reference_time,
    repaired,
    repaired_timing,
    task_of,
)
from energy_opt.motion.plan.clear import repaired_clear
from energy_opt.motion.plan.clearing import Clearing
from energy_opt.motion.plan.context import path_of
from energy_opt.motion.plan.single import Single
from energy_opt.motion.plan.standing import with_rests
from energy_opt.motion.reshape.clear import TRUST
from energy_opt.motion.reshape.curve import Outcome
from energy_opt.motion.reshape.search import Reshaper
from energy_opt.motion.reshape.starts import joined
from energy_opt.motion.reshape.task import FEASIBLE, Line, Task
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.threads import one_thread

ONLY_ONE = 1e-6  # relative: so close to the minimum time, only that timing is used
PROMISING = 0.01  # share of the cost: a trial that costs more than the known optimum by this share is given up
SAME = 1e-9  # relative difference of durations that count as equal
ALONE = 1.3  # ratio of durations beyond which a duration is solved as a single move
APART = 0.3  # [rad, m] curves whose control points differ by less lead to the same optimum
LOWER = 5e-5  # share of the cost: a curve counts as better only if it saves more
# share of the cost: a point this little above the line between its neighbours is not searched again in its valley
BUMP = 0.001


@dataclass(frozen=True)
class Optimum:
    """The least energy found at one duration; the next step starts from `outcome` (None if retimed).

    `chosen`: its origin, as in a result.
    """

    trajectory: Trajectory
    energy: Energy
    converged: bool
    outcome: Outcome | None = None
    chosen: str = "reshape"


class Neighbours:
    """Solves one move at several durations, one after the other."""

    def __init__(self, single: Single) -> None:
        self._single, self._context, self._move = single, single.context, single.move
        self._known: dict[float, Optimum | None] = {}  # the best so far, by duration
        self._alone_at: list[float] = []  # durations that were solved as single moves
        # steps tried: duration, the neighbour's duration, its energy
        self._tried: set[tuple[float, float, float]] = set()

    @cached_property
    def _reshaper(self) -> Reshaper:
        return self._context.reshaper("energy")

    @one_thread
    def at(self, duration: float, neighbour: Optimum) -> Optimum | None:
        """The optimum at exactly `duration` s, from the usual starts and a neighbour's; None if none is valid.

        Args:
            neighbour: an optimum of the move at a nearby duration.

        Raises:
            Infeasible: retiming, if `duration` is below the path's minimum time.
        """
        if self._move.mode == "retime":
            return self._retimed(duration)
        same = abs(neighbour.trajectory.duration / duration - 1) <= SAME
        far = duration not in self._known and not same and self._is_far_from_single(duration)
        if far and not self._alone_at:
            self._known[duration] = self._single_or_none(duration)
        # continue the neighbour's curve, unless this was tried or cannot lead lower
        here = self._known.get(duration)
        move = replace(self._move, duration=duration)
        task = task_of(self._context, move, reference_time(self._context, move, self._single.timing), duration)
        step = duration, neighbour.trajectory.duration, neighbour.energy.total
        if step not in self._tried and self._may_lead_lower(task, here, neighbour):
            self._tried.add(step)
            stepped = (
                self._continued(task, neighbour, here)
                if self._context.cell is None
                else self._continued_clear(task, neighbour, here)
            )
            here = _cheaper(here, stepped)
        # far from any single move, another valley may be the best by now
        if far and duration not in self._alone_at and not self._at_the_best(task, move, here):
            here = _cheaper(here, self._single_or_none(duration))
        timing = self._single.timing
        if here is None and timing is not None and duration < NEAR_FASTEST * timing.duration:
            here = self._with_busy_joints(move, timing, neighbour)
        if same:
            here = _cheaper(here, neighbour)
        if here is None and duration not in self._alone_at:
            here = self._single_or_none(duration)
        self._known[duration] = here if here is not None else self._retimed(duration)
        return self._known[duration]

    def learn(self, duration: float, optimum: Optimum) -> None:
        """Take an optimum of an earlier run as known; a duration far from the others counts as solved alone."""
        if self._is_far_from_single(duration):
            self._alone_at.append(duration)
        self._known[duration] = optimum

    def near(self, duration: float) -> Optimum | None:
        """The optimum at exactly `duration` s, from that of the nearest known duration; the first is a single move.

        Raises:
            Infeasible: no timing or no path holds the limits.
        """
        known = {d: found for d, found in self._known.items() if found is not None}
        if not known:
            return self.single_move(duration)
        nearest = min(known, key=lambda d: abs(d / duration - 1))
        return known[nearest] if nearest == duration else self.at(duration, known[nearest])

    def single_move(self, duration: float) -> Optimum:
        """The optimum of solving the move alone at exactly `duration` s.

        Raises:
            Infeasible: no timing or no path holds the limits.
        """
        self._alone_at.append(duration)
        solved = self._single.at(duration)
        result = solved.result
        found = Optimum(result.trajectory, result.energy, result.status == "solved", solved.outcome, result.chosen)
        self._known[duration] = found
        return found

    def _at_the_best(self, task: Task, move: Move, here: Optimum | None) -> bool:
        """True if the known optimum is the best of all coarse optima found without bodies."""
        if here is None or here.outcome is None:
            return False
        settings, lines = self._context.settings, [Line.along(path_of(move), task.durations[0])]
        search, stopped = self._reshaper.optima, self._context.stopped
        best = search(task, lines, settings.starts, settings.seed, stopped, self._single.kept)[0][0].curve
        known = here.outcome.curve
        found = known.shape is best.shape and bool(np.abs(known.points - best.points).max() < APART)
        if found:
            self._alone_at.append(task.durations[0])
        return found

    def _is_far_from_single(self, duration: float) -> bool:
        """True if no duration near this one was solved as a single move."""
        return all(max(duration / other, other / duration) > ALONE for other in self._alone_at)

    def _single_or_none(self, duration: float) -> Optimum | None:
        """As `single_move`, but None if nothing valid was found."""
        try:
            return self.single_move(duration)
        except Infeasible:
            return None

    def _may_lead_lower(self, task: Task, here: Optimum | None, neighbour: Optimum) -> bool:
        """False if the best so far is in one valley with the neighbour's and on the line between its neighbours' costs.

        The cost of the same path in another duration decides nothing: if limits bind, the path changes too.
        """
        there = neighbour.outcome
        if here is None or here.outcome is None or there is None or here.outcome.curve.shape is not there.curve.shape:
            return True
        costs = {d: x.energy.total - task.offset * d for d, x in self._known.items() if x is not None}
        costs[neighbour.trajectory.duration] = neighbour.energy.total - task.offset * neighbour.trajectory.duration
        duration, cost = task.durations[0], here.energy.total - task.offset * task.durations[0]
        others = sorted(d for d in costs if d != duration)
        if cost > (1 + BUMP) * np.interp(duration, others, [costs[d] for d in others]):
            return True
        level, curve = self._reshaper.fine(task.vias), replace(there.curve, duration=duration)
        passed, _ = level.shares(curve.points[None], duration, replace(task, width=1.0))
        return not joined(level, task, here.outcome, replace(there, curve=curve, cost=float(passed[0])))

    def _continued(self, task: Task, neighbour: Optimum, here: Optimum | None) -> Optimum | None:
        """Continue from a neighbour to the optimum at this duration; None if that is no better than the known one."""
        if neighbour.outcome is None:
            start = task.curve(self._reshaper.fine(task.vias).shape, Line.of(neighbour.trajectory))
        else:
            start = replace(neighbour.outcome.curve, duration=task.durations[0])
        outcome = self._reshaper.solved(start, task, near=True)
        known = None if here is None else here.outcome
        if known is not None and outcome.cost > (1 - LOWER) * known.cost:
            return None
        return self._judged(outcome, task)

    def _continued_clear(self, task: Task, neighbour: Optimum, here: Optimum | None) -> Optimum | None:
        """As `_continued`, for a move that keeps clear of bodies."""
        level = self._reshaper.fine(task.vias)
        curve = task.curve(level.shape, Line.of(neighbour.trajectory))
        if neighbour.outcome is not None and neighbour.outcome.curve.shape is level.shape:
            curve = replace(neighbour.outcome.curve, duration=task.durations[0])
        work = Clearing.of(self._context, task, [curve])
        if here is not None:
            trial = work.search.trial(curve, TRUST)
            # of the path alone, as merits are
            known = here.energy.total - here.energy.stored - task.offset * task.durations[0]
            if work.search.merit(trial) > (1 + PROMISING) * work.search.scale * known:
                return None
            curve = work.search.curve_of(trial)
        if not work.finish(curve, TRUST) or work.best is None:
            return None
        found = repaired_clear(self._context, work.search, task, work.best)
        if found.trajectory is None or found.outcome is None:
            return None
        judged = with_rests(self._context, self._context.judge(found.trajectory))
        return Optimum(judged.trajectory, judged.energy, True, found.outcome) if judged.certificate.valid else None

    def _with_busy_joints(self, move: Move, timing: Timing, neighbour: Optimum) -> Optimum | None:
        """The optimum with joints that need all the time at the first path's timing; None if nothing valid is found."""
        line = least_energy_timing(self._context, move, timing)
        if line is None:
            return None
        start = None if neighbour.outcome is None else neighbour.outcome.curve
        found = with_busy_joints(self._context, move, line.trajectory, start).trajectory
        return None if found is None else Optimum(found, self._context.judge(found).energy, True)

    def _judged(self, outcome: Outcome, task: Task) -> Optimum | None:
        """The optimum within limits by the judge, or None."""
        if outcome.broken > FEASIBLE:
            return None
        best, trajectory, certificate, _ = repaired(self._context, self._reshaper, outcome, task)
        if not certificate.valid:
            return None
        found = with_rests(self._context, self._context.judge(trajectory))
        return Optimum(found.trajectory, found.energy, best.converged, best) if found.certificate.valid else None

    def _retimed(self, duration: float) -> Optimum | None:
        context, shortest = self._context, self._single.timing
        if shortest is None:
            return None
        if abs(duration / shortest.duration - 1) < ONLY_ONE:
            trajectory, converged = shortest.trajectory(context.robot.joints), True
        else:
            move = replace(self._move, duration=duration)
            solution = least_energy_timing(context, move, shortest)
            if solution is None:
                return None
            candidate = repaired_timing(context, move, solution)
            if candidate.trajectory is None:
                return None
            trajectory, converged = candidate.trajectory, candidate.converged
        judged = context.judge(trajectory)
        retimed = Optimum(trajectory, judged.energy, converged, chosen="retime")
        return retimed if judged.certificate.valid else None


def _cheaper(a: Optimum | None, b: Optimum | None) -> Optimum | None:
    """The one of less energy; None if both are None."""
    return min((x for x in (a, b) if x is not None), key=lambda x: x.energy.total, default=None)
