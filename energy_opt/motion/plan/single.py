"""One move at any duration: its candidates, and the choice among them. `Planner` and `tradeoffs` use this module."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

from energy_opt.errors import Infeasible
from energy_opt.motion.limits.early_check import least_duration
from energy_opt.motion.limits.registry import without_conditions
from energy_opt.motion.move import Move
from energy_opt.motion.plan.anytime import Progress
from energy_opt.motion.plan.busy_joints import with_busy_joints
from energy_opt.motion.plan.candidates import (
    NEAR_FASTEST,
    Candidate,
    least_energy_timing,
    repaired_timing,
    reshaped,
    stopped_by_rounding,
)
from energy_opt.motion.plan.choice import Work, baselines_of, choose, is_at_rest
from energy_opt.motion.plan.clear import kept_clear, nearly_clear
from energy_opt.motion.plan.context import Context, Judge, path_of
from energy_opt.motion.plan.refusals import below_bound
from energy_opt.motion.plan.resting import rested
from energy_opt.motion.plan.unsearched import below_resolution, without_search
from energy_opt.motion.reshape.curve import Outcome
from energy_opt.motion.reshape.search import Kept
from energy_opt.motion.result import FirstPath, Result
from energy_opt.motion.retime.solve import RetimeSolution
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.threads import one_thread

log = logging.getLogger(__name__)
# times the least time of the first path: in longer moves, zero acceleration at the ends costs almost nothing
HURRIED = 1.2


def candidates_of(
    context: Context,
    move: Move,
    timing: Timing | None,
    warm: Sequence[Trajectory] = (),
    kept: Kept | None = None,
    bare: Callable[[], Timing | None] = lambda: None,
) -> Work:
    """Candidates for a move's answer.

    Args:
        timing: the fastest timing of the first path.
        warm: further trajectories to start from.
        kept: coarse results of the starts at other durations of the same move.
        bare: gives `Single.bare`.

    Raises:
        Infeasible: no timing or no path holds the limits.
    """
    if timing is not None and timing.path.moves and below_resolution(move):
        answer = without_search(context, move, timing)
        return Work(
            timing, None, answer if move.mode == "reshape" else None, answer if move.mode == "retime" else None, warm
        )
    if move.mode == "retime":
        assert timing is not None
        if context.settings.objective == "time":
            asked = timing if move.duration is None else timing.slowed(move.duration)
            return Work(timing, None, None, Candidate(asked.trajectory(context.robot.joints)), warm)
        solution = least_energy_timing(context, move, timing)
        assert solution is not None
        return Work(timing, solution, None, repaired_timing(context, move, solution), warm)
    if context.stopped() and timing is not None:
        return Work(timing, None, None, None, warm)

    @cache
    def retimed() -> RetimeSolution | None:
        return _least_energy(context, move, timing)

    if is_at_rest(move, context.settings) or (context.stopped() and timing is not None):
        return Work(timing, None, None, None, warm, retimed)
    curve = _curve(context, move, timing, retimed, warm, kept)
    if curve.trajectory is not None and (judged := context.judge(curve.trajectory)).certificate.valid:
        context.progress.found(judged.energy.loss)
    # timings begin with any acceleration: where they beat the curve from zero to zero, its ends are freed, too
    if context.settings.end_acceleration == "zero" and not context.stopped():
        beaten = _is_beaten(context, move, curve, timing, retimed)
        if beaten or _is_beaten_without_conditions(context, move, curve, timing, bare):
            other = _curve(context.freed, move, timing, retimed, warm, kept, again=True)
            curve = replace(_better(context, curve, other), iterations=curve.iterations + other.iterations)
    return Work(timing, None, _in_least_time(context, move, timing, curve), None, warm, retimed)


def _in_least_time(context: Context, move: Move, timing: Timing | None, curve: Candidate) -> Candidate:
    """A curve of free duration, in the first path's least time if it takes hardly longer and that costs less.

    Only if its end accelerations are free: that timing begins and ends at the limits of its busy joints.
    """
    found, judge = curve.trajectory, context.judge
    if timing is None or found is None or curve.outcome is None or context.stopped():
        return curve
    if not curve.outcome.curve.shape.free_acceleration:
        return curve
    if context.settings.objective != "energy" or not _is_fast_enough(timing, move.longest):
        return curve
    if move.duration is not None or not 1 - 1e-9 <= found.duration / timing.duration < NEAR_FASTEST:
        return curve
    line = timing.trajectory(context.robot.joints)
    faster = with_busy_joints(context, move, line, curve.outcome.curve)
    curve = replace(curve, iterations=curve.iterations + faster.iterations)
    if faster.trajectory is None or judge(faster.trajectory).energy.total >= judge(found).energy.total:
        return curve
    return replace(curve, trajectory=faster.trajectory, converged=True, message="")


def is_hurried(move: Move, timing: Timing, duration: float) -> bool:
    """Is a motion's duration so near that of the first path's fastest timing that zero accelerations at its ends cost
    energy, and is that timing in time?
    """
    return duration < HURRIED * timing.duration and _is_fast_enough(timing, move.longest)


def _is_fast_enough(timing: Timing, wanted: float | None) -> bool:
    return wanted is None or wanted >= timing.duration * (1 - 1e-9) or not timing.path.moves


def _least_energy(context: Context, move: Move, timing: Timing | None) -> RetimeSolution | None:
    """The least-energy timing of a first path; None if it has no timing in time."""
    if timing is None or not _is_fast_enough(timing, move.longest):
        return None
    return least_energy_timing(context, move, timing)


def _curve(
    context: Context, move: Move, timing: Timing | None, retimed: Callable[[], RetimeSolution | None],
    warm: Sequence[Trajectory], kept: Kept | None, again: bool = False,
) -> Candidate:  # fmt: skip
    """The curve of least objective that keeps clear; `again`: see `kept_clear`."""
    worth = None if context.cell is None else partial(nearly_clear, context, move)
    curve = reshaped(context, move, timing, retimed, warm, kept, worth)
    failed = curve.trajectory is None and curve.outcome is None and context.settings.objective == "energy"
    hurried = timing is not None and move.longest is not None and move.longest < NEAR_FASTEST * timing.duration
    if failed and hurried and not again and (line := retimed()) is not None:
        mixed = with_busy_joints(context, move, line.trajectory)
        mixed = replace(mixed, iterations=mixed.iterations + curve.iterations, starts=mixed.starts + curve.starts)
        if mixed.trajectory is not None:
            return mixed
        curve = replace(curve, iterations=mixed.iterations, starts=mixed.starts)
    log.info("keeping clear", extra={"share": 0.6})
    curve = kept_clear(context, move, timing, retimed, curve, warm, again)
    if not curve.converged and not context.stopped():
        curve = stopped_by_rounding(context, move, retimed(), curve)
    return curve


def _is_beaten(
    context: Context, move: Move, curve: Candidate, timing: Timing | None, best: Callable[[], RetimeSolution | None]
) -> bool:
    """Is a hurried curve, from zero acceleration to zero, beaten by the best timing of the first path?

    Timings begin and end with any acceleration. Near the least time that counts: building it up takes about 1 % longer,
    and far more under a tight jerk limit. Of a free duration, it is enough that the best timing is hurried.
    """
    found, objective = curve.trajectory, context.settings.objective
    if timing is None:
        return False
    duration = 0.0 if found is None else found.duration
    if move.duration is None and objective == "energy" and (free := best()) is not None:
        duration = min(duration, free.trajectory.duration)
    if not is_hurried(move, timing, duration):
        return False
    if objective == "time":
        return found is None or found.duration > timing.duration * (1 + 1e-9)
    solution = best() if objective == "energy" else None
    return solution is not None and (found is None or context.judge(found).energy.total > solution.energy)


def _is_beaten_without_conditions(
    context: Context, move: Move, curve: Candidate, timing: Timing | None, bare: Callable[[], Timing | None]
) -> bool:
    """As `_is_beaten`, by the best timing of the path that the move starts from without conditions and bodies.

    So a condition that slows the first path, but not the answer, does not change the answer's ends.
    """
    fastest = bare()
    if fastest is None or fastest is timing:
        return False
    alone, move = replace(context, limits=without_conditions(context.limits)), replace(move, path=fastest.path)
    return _is_beaten(context, move, curve, fastest, lambda: _least_energy(alone, move, fastest))


def _better(context: Context, a: Candidate, b: Candidate) -> Candidate:
    """The candidate of less objective, energy or time; the first one if both are equal."""
    if a.trajectory is None or b.trajectory is None:
        return b if a.trajectory is None else a
    if context.settings.objective == "time":
        return b if b.trajectory.duration < a.trajectory.duration else a
    return b if context.judge(b.trajectory).energy.total < context.judge(a.trajectory).energy.total else a


def first_timing(move: Move, timing: Callable[[], Timing]) -> Timing | None:
    """The fastest timing of the first path, by `timing`; None if a reshaped move's path has none."""
    log.info("timing of the first path", extra={"share": 0.05})
    try:
        return timing()
    except Infeasible:
        if move.mode == "retime":
            raise
        return None


@dataclass(frozen=True)
class Solved:
    """A result, and the curve it came from (None if it was not reshaped)."""

    result: Result
    outcome: Outcome | None


class Single:
    """Solves one move at any duration; what durations share is computed once."""

    def __init__(self, context: Context, move: Move, first: FirstPath, timing: Callable[[Move, Judge], Timing]) -> None:
        self.context, self.first, self._timing = context, first, timing
        self.move = replace(move, duration=None, max_duration=None)
        self.kept: Kept = {}  # coarse results of the starts, by duration

    @cached_property
    def timing(self) -> Timing | None:
        """The fastest timing of the first path; None if a reshaped move's path has none."""
        return first_timing(self.move, partial(self._timing, self.move, self.context.judge))

    @cached_property
    def bare(self) -> Timing | None:
        """The fastest timing of the given or straight path without conditions, via points and bodies; None if it has
        none.
        """
        given, limits = self.first.source == "given", without_conditions(self.context.limits)
        move = replace(self.move, path=self.move.path if given else None, via=())
        if move == self.move and len(limits) == len(self.context.limits):
            return self.timing
        try:
            return self.context.fastest(path_of(move), limits)
        except Infeasible:
            return None

    def refuse_below_bound(self, move: Move) -> None:
        """Refuse a duration that is shorter than a limit requires on any path, before a search.

        Raises:
            Infeasible: with the least duration of the first path, if that is valid.
        """
        least, limit, where = least_duration(self.context.limits, self.context.robot, move)
        if move.longest is None or move.longest >= least:
            return
        first = None if self.timing is None else self.timing.trajectory(self.context.robot.joints)
        works = first is not None and self.context.judge(first).certificate.valid
        raise below_bound(move, limit, where, least, first.duration if first is not None and works else None)

    def rested(self, move: Move, result: Result, progress: Progress) -> Result:
        """The result of a move, or a faster move with rest that takes less energy in the same duration."""
        found = rested(
            self.context, move, self.timing, result, lambda faster: self.at(faster, None, (), progress).result
        )
        return replace(found, solver=found.solver.whole(progress.seconds))

    @one_thread
    def at(
        self, duration: float | None, max_duration: float | None = None, warm: Sequence[Trajectory] = (),
        progress: Progress | None = None,
    ) -> Solved:  # fmt: skip
        """The answer in that duration.

        Args:
            progress: a search that has started already; by default it begins now, with the settings' deadline.

        Raises:
            Infeasible: no timing or no path holds the limits; says which, where and what would work.
        """
        if progress is None:
            progress = Progress(self.context.settings.deadline, self.context.stopped)
        context, workshop = replace(self.context, stopped=progress.ended, progress=progress), self.context.workshop
        move = replace(self.move, duration=duration, max_duration=max_duration)
        built, begin = workshop.seconds, time.perf_counter()
        judged_before = None
        if duration is not None and self.timing is not None and duration >= self.timing.duration:
            judged_before = baselines_of(context, move, self.timing, duration)
            judged = dict(judged_before)["scaled"]
            if judged.certificate.valid:
                progress.found(judged.energy.loss)
        work = candidates_of(context, move, self.timing, warm, self.kept, lambda: self.bare)
        build = workshop.seconds - built + (work.solution.build_seconds if work.solution is not None else 0.0)
        try:
            result = choose(context, move, work, build, time.perf_counter() - begin - build, judged_before)
        except Infeasible as error:
            if not self.first.blocked or context.stopped():
                raise
            blocked = f"{self.first.blocked}; nor did reshaping from it keep clear"
            raise Infeasible(blocked, limit="clearance") from error
        outcome = work.asked.outcome if result.chosen == "reshape" else None
        return Solved(replace(result, first_path=self.first), outcome)
