"""A job from its steps to a cycle: shares of time, solved legs, waits, and the plain baselines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput, Infeasible, at_least
from energy_opt.jobs.allocate import Front, Shares, allocate
from energy_opt.jobs.cycle import (
    Choice,
    Piece,
    Plan,
    Rest,
    Scorers,
    assembled,
    cheapest_rest,
    energy_of,
    standing_power,
)
from energy_opt.jobs.file import Job
from energy_opt.jobs.legs import Leg, legs_of, slope_of_slowing
from energy_opt.jobs.reshare import BEFORE, reshared
from energy_opt.jobs.rests import with_rests
from energy_opt.jobs.work import Answers, Cells, Worker
from energy_opt.motion import Planner, Settings
from energy_opt.motion.move import turns_between
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import standing
from energy_opt.power import PowerModel
from energy_opt.power.assumptions import Assumption

SHARING = 0.05  # approximate share of the work for sharing the time, and as much again for first paths


@dataclass(frozen=True, eq=False)
class JobResult:
    """A solved job.

    Attributes:
        plan: its motions and waits.
        baselines: "fastest_then_wait" and "evenly_slowed"; None where a limit or a body forbids it.
        bound: J, a lower bound over all timings of the legs' first paths and shares of the time; None if not proven.
        robust: under several models the minimised value (kind, total, lower_bound or None), and the baselines' [J].
        cells: bodies that were kept clear of, by step.
        interrupted: stopped early: legs that had not been solved run evenly slowed.
        models: energies of the cycle under other models: name, total [J], and against the evenly slowed one
            saving_joules and saving_total_percent.
        assumptions: assumed values that were not given, with their source.
        break_even_friction: share of the effort limits at which dry friction, added to the model, ends the saving
            against the evenly slowed cycle; None if no share below 0.2 does.
        travel: joints that travel more than 1.5 times the distance of a step: step, joint, path, straight [rad, m].
        choice: the choice of positions, if steps end at poses of the tool.
    """

    job: Job
    plan: Plan
    baselines: Mapping[str, Plan | None]
    bound: float | None
    scorers: Scorers
    cells: Cells
    interrupted: bool = False
    models: tuple[dict[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()
    assumptions: tuple[Assumption, ...] = ()
    break_even_friction: float | None = None
    travel: tuple[Mapping[str, object], ...] = ()
    choice: Choice | None = None
    robust: dict[str, Any] | None = None

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """Motions and waits in order; their durations add up to the cycle."""
        return assembled(self.job, self.scorers, self.plan)

    @property
    def energy(self) -> float:
        """Energy [J] of the whole cycle."""
        return sum(piece.energy for piece in self.pieces)

    @property
    def standby(self) -> float:
        """Overhead [J] of the whole cycle, with the supply's losses of it."""
        first = self.job.steps[0]
        still = standing(self.job.robot.joints, first.goal, self.job.cycle_time)
        return self.scorers.of(first, brakes=True).energy(still).total

    @cached_property
    def energies(self) -> dict[str, float | None]:
        """Energies [J] of the baselines."""
        plans = self.baselines.items()
        return {name: None if plan is None else energy_of(self.job, self.scorers, plan) for name, plan in plans}

    @property
    def slowed(self) -> float | None:
        """Energy of the cycle slowed evenly [J], or where that is not possible, done fastest; None where neither is."""
        return next((energy for energy in reversed(self.energies.values()) if energy is not None), None)

    @property
    def cell(self) -> Cell | None:
        """The cell of most of the moves."""
        cells = [self.cells.of(leg.step) for leg in self.plan.legs]
        return max(cells, key=cells.count, default=None)

    @property
    def solved(self) -> bool:
        """True if every leg was solved."""
        return not self.interrupted and all(piece.status == "solved" for piece in self.pieces)


def run_job(
    job: Job,
    model: PowerModel,
    settings: Settings | None = None,
    *,
    cell: CellRequest | None = None,
    stopped: Callable[[], bool] = lambda: False,
    answers: Answers | None = None,
    progress: Callable[[str, float], None] = lambda text, share: None,
    room: Mapping[str, Any] = MappingProxyType({}),
    worker: Worker | None = None,
) -> JobResult:
    """Share the cycle's time over its legs for least energy, and solve them.

    Args:
        cell: bodies to keep clear of in addition to the scenes of steps; by default the arm's own.
        stopped: called between solves; True ends the work with the best so far.
        answers: those of the worker, if it is a new one.
        progress: called with the present task and the finished share of the work.
        room: shares of the limits' bounds that the legs may use, by the limits' names.
        worker: solves the legs, with what it knows of them at other cycle times; by default a new one.

    Raises:
        Infeasible: a leg cannot be done, or the cycle is too short; says which step binds and what would work.
    """
    if job.open:
        raise BadInput(f"{job.steps[job.open[0]].name}: its joint positions are still to be chosen; use run_posed")
    cells = Cells(job, cell or CellRequest())
    work = worker or Worker(job, model, settings or Settings(), cells, stopped, room, answers=answers)
    work.check_poses()
    progress("first paths", 0.0)
    asked = legs_of(job.steps)
    given = tuple(work.with_first_path(leg) for leg in asked)
    legs, timings = fast_enough(job, work, given)
    time = job.cycle_time - job.waiting
    shortest = _shortest(job, legs, timings)
    rest = cheapest_rest(job, work.scorers)
    plain = _plain(work, legs, timings, shortest, time)

    def plan_of(durations: np.ndarray, first: float, last: float, alone: bool = False) -> Plan:
        """Every leg solved; `first` and `last` are shares of the work, `alone` is that of `Worker.solved`.

        Motions last whole nanoseconds: durations are rounded, and the longest takes the rest of their sum.
        """
        even = np.round(durations, 9)
        if len(even):
            even[int(np.argmax(even))] += durations.sum() - even.sum()
        out = []
        for k, (leg, timing, duration) in enumerate(zip(legs, timings, even.tolist(), strict=True)):
            progress(f"{k + 1}/{len(legs)} {leg.name}: {duration:.3f} s", first + (last - first) * k / len(legs))
            if stopped():
                out.append(work.slowed(leg, timing, duration))
                continue
            out.append(work.solved(leg, timing, duration, alone))
        return Plan(legs, tuple(out), rest, time - sum(answer.trajectory.duration for answer in out))

    energy = partial(energy_of, job, work.scorers)
    progress("sharing the cycle's time", SHARING)
    fronts, shares = shares_of(job, work, legs, timings, rest)
    retimed = all(leg.mode == "retime" for leg in legs)
    best = plan_of(shares.durations, 2 * SHARING, 1.0 if retimed else BEFORE, worker is None)
    if not retimed and not stopped():
        best = reshared(work, best, timings, fronts, shares, plan_of)
    for other in (with_rests(work, best, plain["evenly_slowed"]), *plain.values()):
        if other is not None and energy(other) < energy(best):
            best = other
    bound = None
    # of legs alone; what came before may take power from a leg, as warm joints and full stores do
    if shares.bound is not None and retimed and not work.scorers.of(job.steps[0]).depends_on_past:
        waits = [step for step in job.steps if step.wait is not None]
        bound = shares.bound + sum(standing_power(work.scorers, step, step.brakes) * (step.wait or 0) for step in waits)
        bound = min(bound, energy(best))  # joints that friction holds while they turn round may save a little more
    pairs = list(zip(asked, given, legs, strict=True))
    turning = [
        f"{leg.name}: {said}" for leg in asked if len(leg.points) == 2 and leg.initial_path is None
        for said in turns_between(job.robot, *leg.points)
    ]  # fmt: skip
    changed = [leg.name for before, _, leg in pairs if before.mode != leg.mode]
    faster = [leg.name for _, before, leg in pairs if before is not leg]
    around = {id(at): at for at in (work.cells.of(leg.step) for leg in legs) if at is not None}.values()
    warnings = (
        *job.remarks,
        *dict.fromkeys(said for at in around for said in at.warnings),
        *turning,
        *(f"{name}: its path is not free of contact, so the step is reshaped" for name in changed),
        *(f"{name}: its first path is too slow; that of its fastest reshaped move is used instead" for name in faster),
    )
    return JobResult(job, best, plain, bound, work.scorers, work.cells, stopped(), warnings=warnings)


def shares_of(
    job: Job, work: Worker, legs: Sequence[Leg], timings: Sequence[Timing], rest: Rest
) -> tuple[list[Front], Shares]:
    """The fronts of the legs' first paths, and the shares of the cycle's time over these for least energy.

    Raises:
        Infeasible: the cycle, or the time of a leg, is too short.
    """
    time, shortest = job.cycle_time - job.waiting, _shortest(job, legs, timings)
    spare = time - float(shortest.sum())  # time that one leg may take beyond its shortest duration
    fronts = [work.front(*each) for each in zip(legs, timings, shortest + spare, strict=True)]
    scorers = [work.scorers.of(leg.step) for leg in legs]
    guess = slope_of_slowing(legs, timings, scorers, time / shortest.sum()) if legs else None
    return fronts, allocate(fronts, time, rest.power, guess)


def fast_enough(job: Job, work: Worker, legs: tuple[Leg, ...]) -> tuple[tuple[Leg, ...], list[Timing]]:
    """The legs and their fastest timings; if first paths are too slow, along those of their fastest reshaped moves."""
    timings = [work.timing(leg) for leg in legs]
    durations = [max(timing.duration, leg.least) for leg, timing in zip(legs, timings, strict=True)]
    late = sum(durations) > job.cycle_time - job.waiting
    pairs = [
        work.quickest(leg, timing) if late or duration > leg.most else (leg, timing)
        for leg, timing, duration in zip(legs, timings, durations, strict=True)
    ]
    return tuple(leg for leg, _ in pairs), [timing for _, timing in pairs]


def _shortest(job: Job, legs: Sequence[Leg], timings: Sequence[Timing]) -> np.ndarray:
    """Shortest durations (L,) [s] of the legs' first paths.

    Raises:
        Infeasible: they do not fit into the cycle, or one into the time of its leg.
    """
    time = job.cycle_time - job.waiting
    shortest = np.array([max(t.duration, leg.least) for t, leg in zip(timings, legs, strict=True)])
    for leg, least in zip(legs, shortest.tolist(), strict=True):
        if least > leg.most * (1 + 1e-12):
            raise Infeasible(
                f"{leg.name}: max_duration = {leg.most:g} s is too short; it takes {at_least(least)} s at least",
                limit="duration",
                shortest_duration=least,
            )
    if shortest.sum() <= time + 1e-12 * job.cycle_time:
        return shortest
    needed = float(shortest.sum() + job.waiting)
    text = f"the cycle of {job.cycle_time:g} s is too short: "
    if legs:
        longest = legs[int(np.argmax(shortest))]
        text += (
            f"its moves take {shortest.sum():.4g} s at least and it waits {job.waiting:.4g} s, "
            f"{at_least(needed)} s in all; the longest is {longest.name} with {shortest.max():.4g} s"
        )
        held = [leg.name for leg, timing in zip(legs, timings, strict=True) if leg.least > timing.duration]
        if held:
            free = sum(timing.duration for timing in timings)
            text += f"; without min_duration of {', '.join(held)} its moves take {at_least(free)} s at least"
    else:
        text += f"it waits {at_least(needed)} s"
    raise Infeasible(text, limit="duration", shortest_duration=needed)


def _plain(
    work: Worker, legs: tuple[Leg, ...], timings: Sequence[Timing], shortest: np.ndarray, time: float
) -> dict[str, Plan | None]:
    """The plain cycles: at full speed and then waiting, or all slowed evenly."""
    out: dict[str, Plan | None] = {}
    steps = work.job.steps
    rest = Rest(len(steps) - 1, standing_power(work.scorers, steps[-1], work.job.brakes))  # at the end
    # one factor for all legs, also for those at their least duration
    factor = time / shortest.sum() if shortest.sum() > 0 else 1.0
    most = np.array([leg.most for leg in legs])
    for name, durations in (("fastest_then_wait", shortest), ("evenly_slowed", np.minimum(factor * shortest, most))):
        answers = tuple(
            work.slowed(leg, timing, float(duration), "toppra" if name == "fastest_then_wait" else "scaled")
            for leg, timing, duration in zip(legs, timings, durations, strict=True)
        )
        valid = all(answer.status == "solved" for answer in answers)
        out[name] = Plan(legs, answers, rest, float(time - durations.sum())) if valid else None
    return out


class RoughCycles:
    """Solves cycles of one job roughly for different end positions; all share what the first has built.

    A cycle is near the optimum in a fraction of a solve's time; nothing is proven. The first motions of a cycle are
    sketched. Those of a neighbour are bent to the new ends and settle to the nearest optimum: one sequential quadratic
    program for each leg. Bodies are considered only for legs whose motions touch something.

    Args:
        model: its payload is replaced by those of the job's steps.
        stopped: called between solves.
    """

    def __init__(self, model: PowerModel, settings: Settings, job: Job, stopped: Callable[[], bool]) -> None:
        self._model, self._settings, self._stopped = model, settings, stopped
        quick = replace(settings, solver="sqp")
        self.scorers = Scorers(job.robot, model)
        self._planner = Planner(job.robot, self.scorers.model, quick, stopped=stopped)

    def cycle(self, job: Job, cells: Cells, near: Plan | None = None) -> tuple[Plan, float]:
        """A cycle of a job without open ends, and its energy [J].

        Args:
            cells: bodies that the arm keeps clear of.
            near: a cycle of the same steps with other ends, whose durations are kept.

        Raises:
            Infeasible: nothing within limits was found for a leg, or the cycle is too short.
        """
        work = Worker(job, self._model, self._settings, cells, self._stopped, planner=self._planner)
        legs = tuple(legs_of(job.steps))
        rest = cheapest_rest(job, self.scorers)
        if near is None:
            legs, timings = fast_enough(job, work, legs)
            durations = shares_of(job, work, legs, timings, rest)[1].durations
        else:
            durations = np.array([answer.trajectory.duration for answer in near.answers])
        before = [None] * len(legs) if near is None else near.answers
        answers = tuple(map(work.rough, legs, np.round(durations, 9).tolist(), before))
        left = job.cycle_time - job.waiting - sum(answer.trajectory.duration for answer in answers)
        plan = Plan(legs, answers, rest, max(left, 0.0))
        return plan, energy_of(job, self.scorers, plan)
