"""The choice among candidates and baselines: all are judged alike, and the valid one of least energy is the answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.judge.certificate import ALLOWED, Certificate
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.plan.candidates import Candidate, repaired_timing
from energy_opt.motion.plan.context import Context, Judged, path_of
from energy_opt.motion.plan.refusals import too_short
from energy_opt.motion.plan.standing import with_rests
from energy_opt.motion.result import Baseline, Optimality, Result, SolverReport
from energy_opt.motion.retime.solve import GLOBAL_GAP, ROUNDING, RetimeSolution
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Trajectory

SLOW = 200.0  # a duration of more times the shortest gives a warning about its unit
HARDLY = 1e-5  # an answer that is faster than TOPP-RA's timing by a smaller share is compared with that timing itself
# A timing that breaks a limit by an excess is slowed by shares of it: accelerations and jerk need 0.5 and less, speeds
# 1, torques more. MOST: share of the duration by which it is slowed at most.
SHARES, MOST = (0.6, 1.2, 2.4), 0.05


@dataclass(frozen=True)
class Work:
    """Candidates for a move's answer.

    Attributes:
        timing: the fastest timing of the first path; None if it has none.
        solution: the least-energy timing of the first path, as solved; None unless the move is retimed.
        reshaped, retimed: None if they were not asked for or not found.
        warm: further trajectories that a search was started from.
        retiming: solves for the first path's timing of least energy, which is needed if nothing reshaped is better than
            the baselines.
    """

    timing: Timing | None
    solution: RetimeSolution | None
    reshaped: Candidate | None
    retimed: Candidate | None
    warm: Sequence[Trajectory]
    retiming: Callable[[], RetimeSolution | None] = lambda: None

    @property
    def candidates(self) -> list[tuple[str, Trajectory]]:
        """The trajectories found, the mode that was asked for first."""
        candidates = (("reshape", self.reshaped), ("retime", self.retimed))
        return [(name, m.trajectory) for name, m in candidates if m is not None and m.trajectory is not None]

    @property
    def asked(self) -> Candidate:
        """The candidate of the mode that was asked for."""
        return self.reshaped or self.retimed or Candidate(None)


def choose(
    context: Context, move: Move, work: Work, build_seconds: float, solve_seconds: float,
    baselines: list[tuple[str, Judged]] | None = None,
) -> Result:  # fmt: skip
    """The result of the best candidate.

    Args:
        build_seconds, solve_seconds: time spent on building functions, and on solving; reported only.
        baselines: the baselines of the answer's duration, if they are known already.

    Raises:
        Infeasible: no candidate is valid.
    """
    duration = _duration(move, work)
    if baselines is None:
        baselines = baselines_of(context, move, work.timing, duration)
    further = [(name, judged.trajectory.on_nanoseconds()) for name, judged in baselines]
    further += [("warm", t.on_nanoseconds()) for t in work.warm]
    # a proxy objective asks for its own optimum, so baselines of less energy do not replace it
    found, more = least(
        context, move, work, further if context.settings.objective in ("energy", "time") or context.stopped() else []
    )
    iterations = more + sum(
        candidate.iterations for candidate in (work.reshaped, work.retimed) if candidate is not None
    )
    if found is None:
        first = work.timing
        if first is not None and move.longest is not None and move.longest < first.duration:
            error = too_short(move, first.duration, context.judge.slowed(first, first.duration).within)
            if context.cell is not None and move.mode == "reshape":  # the time of the first path around the bodies
                error.args = (f"{error.args[0]}; --objective time may find a shorter one",)
            raise error
        said = work.asked.message or "no trajectory within limits was found"
        deadline = context.settings.deadline or context.progress.deadline
        if context.progress.cut and deadline is not None:
            said = f"no trajectory within limits was found in {deadline:g} s; a longer --deadline may help"
        elif first is None:
            _refuse_first_path(context, move)
        raise Infeasible(said, limit="duration")
    name, best = found
    if abs(best.trajectory.duration - duration) > 1e-9:  # a saving is stated at equal durations
        baselines = baselines_of(context, move, work.timing, best.trajectory.duration)
    interrupted, message = context.progress.interrupted(), work.asked.message
    late = context.progress.cut and not interrupted
    if late:
        message = "the search ended at its deadline with this best proven answer"
    context.progress.found(best.energy.loss)
    report = SolverReport(
        context.settings.solver, iterations, build_seconds, solve_seconds, context.workshop.compiled, work.asked.starts
    )
    return Result(
        status="solved" if (work.asked.converged or late) and not interrupted else "not_converged",
        robot=context.robot.name,
        mode=move.mode,
        chosen=name,
        trajectory=best.filled,
        energy=best.energy,
        baselines=tuple(_baseline(name, judged) for name, judged in baselines),
        certificate=best.stated,
        optimality=_optimality(move, best, work.solution),
        solver=report,
        message="interrupted; the best so far" if interrupted else message,
        interrupted=interrupted,
        warnings=tuple(_warnings(context, move, work.timing)),
        progress=tuple(context.progress.losses),
    )


def with_trajectory(
    context: Context, move: Move, timing: Timing | None, result: Result, trajectory: Trajectory
) -> Result:
    """The result with another trajectory and the baselines of its duration; without a lower bound.

    Args:
        timing: the fastest timing of the move's first path; None if it has none.
        trajectory: of the same move, valid or not: `certificate` says so.
    """
    judged = context.judge(trajectory)
    baselines = baselines_of(context, move, timing, trajectory.duration)
    return replace(
        result,
        trajectory=judged.filled,
        energy=judged.energy,
        certificate=judged.stated,
        baselines=tuple(_baseline(name, found) for name, found in baselines),
        optimality=Optimality("local"),
    )


def least(
    context: Context, move: Move, work: Work, further: Sequence[tuple[str, Trajectory]]
) -> tuple[tuple[str, Judged] | None, int]:
    """The valid candidate of least energy with its name, among the work's and `further`; None if none is valid.

    With the objective "time" the shortest duration comes first. With any objective but energy, the mode that was asked
    for comes before a candidate of less energy.

    Args:
        further: other trajectories with their names, as of baselines; those that do not fit the move do not count.

    Returns:
        The candidate, and the iterations spent on the retimed path.
    """
    objective = context.settings.objective
    energy_counts = objective == "energy"
    judged = [(name, context.judge(t)) for name, t in (*work.candidates, *further) if fits_move(move, t)]

    def rank(candidate: tuple[str, Judged]) -> tuple[float, bool, float]:
        name, found = candidate
        shortest = round(found.trajectory.duration, 9) if objective == "time" else 0.0  # [s], to a nanosecond
        return shortest, not energy_counts and name != move.mode, found.energy.total

    def valid() -> tuple[str, Judged] | None:
        return next((v for v in sorted(judged, key=rank) if v[1].certificate.valid), None)

    best, iterations = valid(), 0
    # a retiming cannot be better than a curve, except in a tube that is too narrow for its control points, or where a
    # kink of the user's own limit stopped the search
    settings = context.settings
    freer = best is not None and best[0] == "reshape" and settings.tube is None and not settings.own_limits
    beaten = freer or (best is not None and not energy_counts)
    solution = None if work.retimed is not None or beaten or context.stopped() else work.retiming()
    # its energy is by its own quadrature
    if solution is not None and (best is None or solution.energy < best[1].energy.total):
        repaired = repaired_timing(context, move, solution)
        iterations = repaired.iterations
        if repaired.trajectory is not None and fits_move(move, repaired.trajectory):
            judged.append(("retime", context.judge(repaired.trajectory)))
            best = valid()
    if energy_counts and best is not None and move.mode == "reshape":
        best = best[0], with_rests(context, best[1])
    return best, iterations


def _refuse_first_path(context: Context, move: Move) -> None:
    """Refuse a move for which no motion was found with the reason why its first path has no timing.

    Raises:
        Infeasible: that reason; nothing is raised if there is none.
    """
    try:
        context.fastest(path_of(move))
    except Infeasible as error:
        error.args = (f"{error.args[0]}; reshaping found no motion within limits either", *error.args[1:])
        raise


def _duration(move: Move, work: Work) -> float:
    """The answer's duration [s], as far as it is known before judging."""
    if move.duration is not None:
        return move.duration
    if work.candidates:
        return work.candidates[0][1].duration
    solution = work.solution or (None if move.duration is not None else work.retiming())
    if solution is not None:
        return solution.trajectory.duration
    return work.timing.duration if work.timing is not None else np.inf


def fits_move(move: Move, trajectory: Trajectory) -> bool:
    """Does a trajectory have the ends and the duration that the move asks for?"""
    ends = np.abs(np.stack([trajectory.position[0] - move.start, trajectory.position[-1] - move.goal])).max()
    speeds = np.abs(trajectory.velocity[[0, -1]] - np.stack(move.end_velocities)).max()
    if ends > 1e-9 or speeds > 1e-9:
        return False
    d = trajectory.duration
    if move.duration is not None:
        return bool(abs(d - move.duration) <= 1e-9 * move.duration)
    return move.max_duration is None or d <= move.max_duration * (1 + 1e-9)


def baselines_of(context: Context, move: Move, timing: Timing | None, duration: float) -> list[tuple[str, Judged]]:
    """The baselines by name, judged: "toppra", the fastest timing; "scaled", this slowed evenly to `duration` s; and
    "input", the user's own trajectory, if given. Without a `timing` of the first path, only the last one.
    """
    out: list[tuple[str, Trajectory]] = []
    if timing is not None:
        toppra = context.judge.slowed(timing, timing.duration).trajectory
        same = -HARDLY <= duration / timing.duration - 1 <= ROUNDING
        scaled = toppra if same else context.judge.slowed(timing, duration).trajectory
        out += [("toppra", toppra), ("scaled", scaled)]
    if move.input is not None:
        out.append(("input", move.input))
    return [(name, context.judge(trajectory)) for name, trajectory in out]


def within_limits(timing: Timing, judge: Callable[[Timing], Certificate]) -> Timing:
    """The fastest timing, slowed to the next whole nanosecond, so that a move can be asked for in its duration.

    It is slowed a little more if it breaks a limit between the grid points of its program.

    Args:
        timing: the fastest of a path. judge: gives the certificate of its trajectory.
    """
    if np.any(timing.control[[0, -1]]):
        return timing
    whole = timing.slowed(float(np.ceil(timing.duration * 1e9) / 1e9))
    excess = judge(whole).violation
    for more in (share * excess for share in SHARES if ALLOWED < excess <= MOST / share):
        slower = timing.slowed(float(np.ceil(timing.duration * (1 + more) * 1e9) / 1e9))
        if judge(slower).within_limits:
            return slower
    return whole


def _baseline(name: str, judged: Judged) -> Baseline:
    certificate = judged.certificate
    holds = certificate.violation, certificate.valid
    return Baseline(name, judged.filled, judged.energy, *holds, certificate.peak_power)


def _optimality(move: Move, best: Judged, solution: RetimeSolution | None) -> Optimality:
    """How near the answer is to the least energy of all timings of its path; it may be a baseline's timing."""
    if move.mode != "retime" or solution is None or solution.lower_bound is None:
        return Optimality("local")
    total = best.energy.total
    # slower than standstill, friction may give slightly less energy than the bound
    bound = min(solution.lower_bound, total)
    gap = 100 * (total - bound) / max(abs(total), 1e-12)
    return Optimality("global" if gap <= GLOBAL_GAP else "local", bound, gap)


def is_at_rest(move: Move, settings: Settings) -> bool:
    """True if the move has nothing to reshape: it ends where it begins, and no tube keeps it near a path."""
    if settings.tube is not None and move.path is not None and move.path.moves:
        return False
    return bool(not move.via and not np.any(move.end_velocities) and np.abs(move.goal - move.start).max() < 1e-12)


def _warnings(context: Context, move: Move, timing: Timing | None) -> list[str]:
    """Warnings of the robot, and of what is left out of energies, a duration of hundreds of times the shortest, and a
    path that ends where it begins and keeps its shape, although reshaping is asked for.
    """
    out = list(context.robot.warnings)
    meter = [effect.name for effect in context.model.effects if effect.stage == "meter"]
    if meter:
        out.append(f"{', '.join(meter)}: of the meter, not of the arm; left out of all energies")
    if timing is None or not timing.path.moves:
        return out
    if move.duration is not None and move.duration >= SLOW * timing.duration:
        out.append(
            f"the duration of {move.duration:g} s is {move.duration / timing.duration:.3g} times the shortest on the "
            f"first path, {timing.duration:.3g} s; expected seconds (are these milliseconds? "
            f"{move.duration / 1000:g} s then)"
        )
    if move.mode == "reshape" and is_at_rest(move, context.settings):
        out.append(
            "the path ends where it begins: its shape is kept, as standing still would cost least; "
            "--tube lets it change"
        )
    return out
