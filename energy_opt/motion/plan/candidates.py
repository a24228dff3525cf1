"""Candidates for a move's answer: the least-energy timing of the first path, and a reshaped curve.

Solvers hold limits at nodes and points, the judge everywhere. So each candidate that the judge finds beyond a limit is
solved again with that bound reduced.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.via import distinct
from energy_opt.motion.move import Move
from energy_opt.motion.plan.context import Context, path_of
from energy_opt.motion.plan.refusals import never_held, too_short
from energy_opt.motion.reshape.curve import Curve, Outcome
from energy_opt.motion.reshape.layout import Ends
from energy_opt.motion.reshape.search import Kept, Reshaper, trajectory_of
from energy_opt.motion.reshape.task import FEASIBLE, Line, Task
from energy_opt.motion.retime.solve import RetimeSolution, retime
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Trajectory

REPAIRS = 10  # most times that limits are tightened after the judge finds a violation; each time removes 3/4 of a peak
LONGEST = 30.0  # upper bound of a free duration, as a multiple of the fastest timing of the first path
SHORTEST = 0.2  # lower bound of a free duration, as a multiple of the same
SAMPLES = 200  # samples of a first guess
# times the least time of the first path: in less, some joint is at a limit nearly all the time
NEAR_FASTEST = 1.02
NONE = "no start of the reshaping led to a trajectory within limits"
# [rad/s, m/s] if all joints are slower in the mean, widths of kinks are smaller in proportion, down to this share: wide
# ones round away the friction of moves that take 20 times as long as necessary
SLOW, NARROWEST = 0.15, 0.1
SMALL = 1e-2  # [rad, m] on smaller moves rounding errors may be larger than the solver's last steps


@dataclass(frozen=True)
class Candidate:
    """A candidate trajectory (None if the search failed), the effort spent, and a message if a solver gave up.

    Attributes:
        converged: False if a solver gave up, as `message` says. starts: of the search.
        outcome: the curve that it comes from, for searches nearby; None if there is none.
        optima: coarse optima of the search, those of other valleys included.
    """

    trajectory: Trajectory | None
    iterations: int = 0
    converged: bool = True
    message: str = ""
    starts: int = 0
    outcome: Outcome | None = None
    optima: tuple[Outcome, ...] = ()


def stopped_by_rounding(context: Context, move: Move, line: RetimeSolution | None, curve: Candidate) -> Candidate:
    """The curve, marked as converged where rounding errors alone stop the solver: on a tiny move, or in a tube.

    In a tube of a tenth of a millimetre, the path itself is known, and the answer costs no more than its best timing.

    Args:
        line: the least-energy timing of that path; None if there is none. curve: a candidate whose solver gave up.
    """
    if line is None or not line.converged:
        return curve
    if not move.via and np.abs(move.goal - move.start).max() < SMALL:
        said = f"on a move of less than {SMALL:g} rad rounding errors are larger than the solver's last steps"
    elif context.settings.tube is not None and repaired_timing(context, move, line).converged:
        said = "the answer is no worse than the best timing of the path that the tube is about"
    else:
        return curve
    return replace(curve, converged=True, message=f"{curve.message}; {said}")


def least_energy_timing(context: Context, move: Move, timing: Timing) -> RetimeSolution | None:
    """The least-energy timing of the first path; None if a reshaped move's duration is too short for it.

    Raises:
        Infeasible: a retimed move cannot be so fast.
    """
    try:
        return _retimed(context, move, timing, context.limits)
    except Infeasible:
        if move.mode == "retime":
            raise
        return None


def _retimed(context: Context, move: Move, timing: Timing, limits: tuple[Limit, ...]) -> RetimeSolution:
    return retime(
        context.robot, context.model, path_of(move), duration=move.duration, max_duration=move.max_duration,
        shortest=timing, limits=limits,
    )  # fmt: skip


def repaired_timing(context: Context, move: Move, first: RetimeSolution) -> Candidate:
    """The least-energy timing of the first path, valid by the judge: `first`, solved again if it breaks a limit."""
    solution, limits, iterations = first, context.limits, first.iterations
    for _ in range(REPAIRS):
        certificate = context.judge(solution.trajectory).within
        if certificate.valid:
            break
        limits = certificate.tightened(limits)
        try:
            solution = _retimed(context, move, context.fastest(path_of(move), limits), limits)
        except Infeasible:
            break
        iterations += solution.iterations
    certificate = context.judge(solution.trajectory).within
    if certificate.valid:
        return Candidate(solution.trajectory, iterations, solution.converged, solution.message)
    return Candidate(solution.trajectory, iterations, False, broken("retimed", certificate))


def broken(how: str, certificate: Certificate) -> str:
    """The message that a move breaks a limit; `how`: "retimed" or "reshaped", `certificate`: of that motion."""
    worst = certificate.worst
    return (
        f"the {how} move breaks the {worst['limit']} limit of {worst['joint']} at {worst['time']:.4g} s by "
        f"{certificate.violation:.1e} of its bound; kept the best trajectory within limits"
    )


def reference_time(context: Context, move: Move, timing: Timing | None) -> float:
    """A typical duration [s] of the move: the fastest on its first path, or an estimate if that has no timing."""
    if timing is not None and timing.path.moves:
        return timing.duration
    distance = np.abs(move.goal - move.start)
    shortest = [float((distance / limit.bound).max()) ** (1 / limit.order) for limit in context.limits if limit.order]
    return max(2 * max(shortest), 0.1)


def task_of(context: Context, move: Move, reference: float, duration: float | None) -> Task:
    """The reshaping problem of a move.

    Args:
        reference: [s] typical duration of the move; multiples of it bound a free duration.
        duration: exactly so long, s; None: free, up to the move's `max_duration`.
    """
    if duration is not None:
        durations = (duration, duration)
    else:
        longest = move.max_duration or LONGEST * reference
        durations = (min(SHORTEST * reference, longest), longest)
    v_start, v_goal = move.end_velocities
    via = np.array(distinct(move)).reshape(-1, context.robot.n)
    ends = Ends(np.asarray(move.start), np.asarray(move.goal), v_start, v_goal, via)
    counts = duration is not None and context.settings.objective == "energy"
    offset = context.model.constant_power(context.robot.n) if counts else 0.0
    along = path_of(move)(np.linspace(0, 1, SAMPLES))
    speed = np.inf if duration is None else np.abs(np.diff(along, axis=0)).sum(axis=0).max() / duration
    return Task(ends, context.limits, context.values, durations, offset, float(np.clip(speed / SLOW, NARROWEST, 1.0)))


def reshaped(
    context: Context,
    move: Move,
    timing: Timing | None,
    retimed: Callable[[], RetimeSolution | None],
    warm: Sequence[Trajectory] = (),
    kept: Kept | None = None,
    worth: Callable[[Curve], bool] | None = None,
) -> Candidate:
    """The curve of least objective that the search finds, valid by the judge.

    Args:
        retimed: solves for the least-energy timing of the first path; None if there is none.
        warm: further trajectories to start from.
        kept: coarse results of the starts at other durations of the same move.
        worth: returns whether an optimum is worth solving in full; if not, it is returned without a trajectory.

    Raises:
        Infeasible: no curve holds the limits, or none in the duration asked for.
    """
    # of a free duration, the best timing of the first path shows about how long the answer takes
    settings, free_time = context.settings, context.settings.objective == "time"
    reference = reference_time(context, move, timing)
    task = task_of(context, move, reference, None if free_time else move.duration)
    path_timing = retimed() if move.duration is None and not free_time and not warm else None
    known = path_timing.trajectory if path_timing is not None else next(iter(warm), None)
    guess = 2 * reference if known is None else known.duration
    lines = [Line.along(path_of(move), guess), *(Line.of(t) for t in (*warm, *([move.input] if move.input else [])))]
    reshaper = context.reshaper(settings.objective)
    answer = reshaper.search(task, lines, settings.starts, settings.seed, context.stopped, kept, worth)
    if not answer.wanted:
        return Candidate(None, answer.iterations, starts=answer.starts, outcome=answer.optima[0], optima=answer.optima)
    # without a feasible start: from the first path's timing, from the fastest move, and directly from that timing
    best, spent, starts = answer.best, answer.iterations, answer.starts
    line = retimed() if best is None and not context.stopped() else None
    fast = timing is not None and task.durations[1] < NEAR_FASTEST * timing.duration
    # no spline of few points is so fast; see `busy_joints`
    if line is not None and fast and settings.objective == "energy":
        return Candidate(None, spent, False, NONE, starts)
    if line is not None:  # this timing holds the limits, so search from it
        again = reshaper.search(task, [Line.of(line.trajectory)], 1, settings.seed, context.stopped)
        best, spent, starts = again.best, spent + again.iterations, starts + again.starts
    if best is None and not context.stopped():
        other = line is not None or any(abs(t.duration - task.durations[1]) <= 1e-9 for t in warm)
        best, more = _from_the_fastest(context, move, task, lines, other, reference, timing)
        spent += more
    if best is None and line is not None and not context.stopped():  # few control points did not suffice
        last = reshaper.solved(task.curve(reshaper.fine(task.vias).shape, Line.of(line.trajectory)), task)
        best, spent, starts = last if last.broken <= FEASIBLE else None, spent + last.iterations, starts + 1
    if best is None:
        return Candidate(None, spent, False, NONE, starts)
    best, trajectory, certificate, more = repaired(context, reshaper, best, task)
    spent += more
    if free_time and move.duration is not None:
        if trajectory.duration > move.duration * (1 + 1e-9):
            _refuse_too_short(context, move, timing, trajectory, certificate)
            return Candidate(None, spent, False, NONE, starts)
        trajectory = trajectory_of(replace(best.curve, duration=move.duration), context.robot.joints)
        certificate = context.judge(trajectory).within
    if not certificate.valid:
        return Candidate(None, spent, False, broken("reshaped", certificate), starts)
    message = "" if best.converged else f"{best.why}; {certificate.tightest}"
    return Candidate(trajectory, spent, best.converged, message, starts, best, answer.optima)


def repaired(
    context: Context, reshaper: Reshaper, best: Outcome, task: Task
) -> tuple[Outcome, Trajectory, Certificate, int]:
    """Tighten the limits that the judge finds broken, and solve again from there, until the judge finds none.

    Args:
        best: what the search found. task: the problem that it solves.

    Returns:
        The last outcome, its trajectory and certificate (valid or not), and the iterations spent.
    """
    limits, spent = task.limits, 0
    for turn in range(REPAIRS + 1):
        judged = context.judge.of(best.curve)
        trajectory, certificate = judged.trajectory, judged.within
        if certificate.valid or turn == REPAIRS or context.stopped():
            break
        limits = certificate.tightened(limits)
        best = reshaper.solved(best.curve, replace(task, limits=limits))
        spent += best.iterations
    return best, trajectory, certificate, spent


def _refuse_too_short(
    context: Context, move: Move, timing: Timing | None, trajectory: Trajectory, certificate: Certificate
) -> None:
    """Refuse a duration that neither the first path's timing nor a trajectory, which takes longer, is fast enough for.

    Raises:
        Infeasible: with the shorter of the two durations.
    """
    if timing is not None and timing.duration < trajectory.duration:
        first = context.judge(timing.trajectory(context.robot.joints)).certificate
        if first.valid and timing.duration <= (move.longest or np.inf):
            return
        if first.valid:
            raise too_short(move, timing.duration, first)
    if certificate.valid:
        raise too_short(move, trajectory.duration, certificate)


def _from_the_fastest(
    context: Context,
    move: Move,
    task: Task,
    lines: Sequence[Line],
    fallback: bool,
    reference: float,
    timing: Timing | None,
) -> tuple[Outcome | None, int]:
    """The move started from the fastest one, if the usual starts failed; also returns the iterations spent.

    Raises:
        Infeasible: there is no `fallback`, and the fastest move takes longer than asked for, or breaks a limit
            however slow it is.
    """
    fast = context.reshaper("time")
    longest = LONGEST * max(reference, task.durations[1])
    free = replace(task, durations=(SHORTEST * reference, longest), offset=0.0)
    longer = [replace(line, duration=3 * max(reference, line.duration)) for line in lines]
    answer = fast.search(free, longer, 2, context.settings.seed, context.stopped)
    best, spent = answer.best, answer.iterations
    if best is None:
        if fallback or context.stopped():
            return None, spent
        if timing is not None and timing.duration > task.durations[1]:
            fastest = timing.trajectory(context.robot.joints)
            raise too_short(move, timing.duration, context.judge(fastest).certificate)
        raise never_held(context.judge(_evenly_slowed(context, lines[0])).certificate)
    best, trajectory, certificate, more = repaired(context, fast, best, free)
    spent += more
    if trajectory.duration > task.durations[1] * (1 + 1e-9):
        if not fallback:
            _refuse_too_short(context, move, timing, trajectory, certificate)
        return None, spent
    duration = float(np.clip(trajectory.duration, *task.durations))
    start = replace(best.curve, duration=duration)
    found = context.reshaper(context.settings.objective).solved(start, task, context.stopped)
    spent += found.iterations
    return found if found.broken <= FEASIBLE else replace(found, curve=start), spent


def _evenly_slowed(context: Context, line: Line) -> Trajectory:
    t = 20 * line.duration * line.u
    v = np.gradient(line.q, t, axis=0)
    return Trajectory(context.robot.joints, t, line.q, v, np.gradient(v, t, axis=0))
