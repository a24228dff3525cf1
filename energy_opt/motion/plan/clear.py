"""A reshaped move that keeps clear of bodies.

The optimum found without regard to bodies, if it is proven clear; else the best of searches from several curves: the
first path, mixtures of it with the optima found without bodies, and these optima themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from energy_opt.cell.planes import Near
from energy_opt.errors import Infeasible
from energy_opt.motion.move import Move
from energy_opt.motion.plan.candidates import REPAIRS, Candidate, reference_time, reshaped, task_of
from energy_opt.motion.plan.clearing import NEARLY, Clearing, Start
from energy_opt.motion.plan.context import Context, path_of
from energy_opt.motion.plan.further import wider_optima
from energy_opt.motion.reshape.clear import PLACES, TRUST, ClearSearch
from energy_opt.motion.reshape.curve import Curve, Outcome
from energy_opt.motion.reshape.search import trajectory_of
from energy_opt.motion.reshape.task import Line, Task
from energy_opt.motion.retime.solve import RetimeSolution
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Trajectory

# If bodies cost COSTLY times the loss of the optimum without them, a move of free duration is also started from the
# clear answer in another one: SLOWER times that of the optimum, since limits leave no room to come free near the least
# duration, but not below a SLOWER-th of that of the best. Of the least time, bodies must cost LATE times that time. A
# given duration is not changed: if bodies cost FAR times the loss, its optimum is solved in full, and a search from it
# too. With 1 in place of FAR, one of 17 scenes takes 45 % longer and gains nothing (`cells.py --part given`).
COSTLY, LATE, FAR, SLOWER = 0.25, 1.0, 2.0, 1.3
NOTHING = "reshaping found no collision-free motion that is better than the first path"


def nearly_clear(context: Context, move: Move, curve: Curve) -> bool:
    """True if a curve of a move keeps clear at many sampled places, or nearly so: then it is worth solving in full."""
    if context.cell is None:
        return True
    u = (np.arange(PLACES) + 0.5) / PLACES
    ends = np.stack([move.start, move.goal])
    wanted = context.cell.wanted(ends)
    near = Near(context.cell.bodies, ends)
    _, number, distance, _, _ = near.measured(u, curve.position(u), context.cell.asked + NEARLY)
    return bool((distance > wanted[near.pair[number]] - NEARLY).all())


def kept_clear(
    context: Context, move: Move, timing: Timing | None, retimed: Callable[[], RetimeSolution | None],
    free: Candidate, warm: Sequence[Trajectory], again: bool = False,
) -> Candidate:  # fmt: skip
    """The reshaped move of least objective that is proven to keep clear.

    Args:
        timing: the fastest timing of the first path; None if it has none.
        retimed: solves for the least-energy timing of the first path; None if there is none.
        free: what reshaping found without regard to bodies; the answer if it is proven clear.
        warm: further trajectories to start from, if they are proven clear.
        again: the move was solved before, with other end accelerations.

    Returns:
        A candidate, without a trajectory if no search led to one that is proven clear and within limits.
    """
    if context.cell is None:
        return free
    wider = wider_optima(context, move, timing, retimed, free) if context.settings.initial_paths else free
    if wider.trajectory is not None and _is_proven(context, wider.trajectory):
        return wider
    free_time = context.settings.objective == "time"
    reference = reference_time(context, move, timing)
    task = task_of(context, move, reference, None if free_time else move.duration)
    level = context.reshaper(context.settings.objective).fine(task.vias)
    lines = _lines(context, move, retimed, timing, warm, task, 2 * reference)
    work = Clearing.of(context, task, [task.curve(level.shape, line) for line in lines])
    work.search_from(free)
    if wider is not free:
        work.search_from(wider)
    fixed = move.duration is not None and not free_time
    if not fixed and not again and not context.stopped() and work.is_costly(wider, LATE if free_time else COSTLY):
        slower = _slower(context, move, timing, wider, work.best)
        work.search.iterations += slower.iterations
        if slower.outcome is not None:
            work.finish(task.within(slower.outcome.curve), TRUST)
    # more starts: another path around the bodies, where little is saved, and those that were asked for
    if work.little(timing) and not context.stopped():
        for path in context.further():
            work.finish(task.curve(level.shape, Line.along(path, work.first.duration)), TRUST)
    if fixed and not again and not context.stopped() and work.is_costly(wider, FAR):
        work.search_in_full(wider)
    if context.settings.initial_paths:
        curves = [task.curve(level.shape, Line.along(path, work.first.duration)) for path in context.initial_paths]
        work.best_of([Start(curve, TRUST) for curve in curves])
    if work.best is None:
        return Candidate(None, work.search.iterations, True, NOTHING, free.starts)
    candidate = repaired_clear(context, work.search, task, work.best)
    trajectory = candidate.trajectory
    if trajectory is not None and free_time and move.duration is not None and trajectory.duration <= move.duration:
        assert candidate.outcome is not None
        trajectory = trajectory_of(replace(candidate.outcome.curve, duration=move.duration), context.robot.joints)
    spent = wider.iterations + work.search.iterations
    return replace(candidate, trajectory=trajectory, iterations=spent, starts=free.starts)


def _slower(
    context: Context, move: Move, timing: Timing | None, free: Candidate, best: Outcome | None
) -> Candidate:  # fmt: skip
    """The clear answer of least energy in a longer duration than that of the optimum without bodies (`free`).

    Args:
        best: the best clear outcome so far; None if there is none.
    """
    assert free.outcome is not None
    least = 0.0 if best is None else best.curve.duration / SLOWER
    move = replace(move, duration=max(SLOWER * free.outcome.curve.duration, least), max_duration=None)
    context = replace(context, settings=replace(context.settings, objective="energy"))
    try:
        found = reshaped(context, move, timing, lambda: None)
    except Infeasible:
        return Candidate(None)
    return kept_clear(context, move, timing, lambda: None, found, ())


def repaired_clear(context: Context, search: ClearSearch, task: Task, outcome: Outcome) -> Candidate:
    """A curve that keeps clear and is valid by the judge: solved again under tightened limits if it breaks one.

    Args:
        search: the search that found it. task: its problem. outcome: proven to keep clear.
    """
    limits = task.limits
    for _ in range(REPAIRS):
        judged = context.judge.of(outcome.curve)
        certificate = judged.within
        if certificate.valid:
            return Candidate(judged.trajectory, 0, outcome=outcome)
        limits = certificate.tightened(limits)
        again = search.under(replace(task, limits=limits), outcome)
        if again is None:
            break
        outcome = again
    return Candidate(None, 0, True, NOTHING)


def _lines(
    context: Context, move: Move, retimed: Callable[[], RetimeSolution | None], timing: Timing | None,
    warm: Sequence[Trajectory], task: Task, reference: float,
) -> list[Line]:  # fmt: skip
    """Initial curves: the given trajectories that are proven clear, and last the first path, slowed evenly to a given
    duration, or else in its timing of least energy.
    """
    lines = [Line.of(t) for t in (*warm, *([move.input] if move.input else [])) if _is_proven(context, t)]
    line = retimed() if move.duration is None else None
    if line is not None:
        lines.append(Line.of(line.trajectory))
    elif timing is not None:
        duration = float(np.clip(timing.duration, *task.durations))  # exactly the duration asked for, if it is fixed
        lines.append(Line.of(context.judge.slowed(timing, duration).trajectory))
    else:
        lines.append(Line.along(path_of(move), reference))
    return lines


def _is_proven(context: Context, trajectory: Trajectory) -> bool:
    clearance = context.judge(trajectory).clearance
    return clearance is None or clearance.proven
