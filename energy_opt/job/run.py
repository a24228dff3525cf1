"""A job from its steps to a cycle: shares of time, solved legs, waits, and what the plain ways of running it take."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.effects import Payload
from energy_opt.errors import Infeasible
from energy_opt.job.allocate import Front, Shares, allocate, modelled
from energy_opt.job.cycle import (
    Answer,
    Piece,
    Scorers,
    assembled,
    cheapest_rest,
    energy_of,
    last_rest,
    standing_power,
)
from energy_opt.job.file import Job, Step
from energy_opt.job.fronts import fastest_timing, front_of
from energy_opt.job.legs import Leg, legs_of
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.move import Settings
from energy_opt.motion.plan.planner import Planner
from energy_opt.motion.timing.law import Timing
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel

AGAIN = 1e-2  # of a leg's duration: shares that change less are not worth solving again
Known = Callable[[Leg, float], Trajectory | None]


@dataclass(frozen=True)
class Plain:
    """A plain way to run the job: its energy [J], None where a limit or a body is in its way."""

    name: str
    energy: float | None


@dataclass(frozen=True)
class JobResult:
    """A job as it is to be run.

    Attributes:
        pieces: motions and waits in order; their durations add up to the cycle.
        baselines: "fastest_then_wait" and "evenly_slowed".
        bound: J that no timing of the legs' first paths and no share of the time goes below; None where not proven.
        interrupted: stopped early: legs that had not been solved run evenly slowed.
    """

    job: Job
    pieces: tuple[Piece, ...]
    baselines: tuple[Plain, ...]
    bound: float | None
    scorers: Scorers
    interrupted: bool = False

    def scorer(self, step: Step) -> Scorer:
        """Scores motions under a step's payload."""
        return self.scorers.of(step)

    @property
    def energy(self) -> float:
        """J of the whole cycle."""
        return energy_of(self.pieces)

    @property
    def solved(self) -> bool:
        """Did every leg end as solved?"""
        return not self.interrupted and all(piece.status == "solved" for piece in self.pieces)


class _Worker:
    """Solves legs: one planner for all payloads."""

    def __init__(self, job: Job, model: PowerModel, settings: Settings, stopped: Callable[[], bool]) -> None:
        model = model.replaced(Payload(mass=0.0, com=[0.0, 0.0, 0.0]))
        self.job, self.scorers, self.stopped = job, Scorers(job.robot, model), stopped
        self._planner = Planner(job.robot, model, settings, batch=True, stopped=stopped)

    def planner(self, leg: Leg) -> Planner:
        """The planner under a leg's payload."""
        self._planner.set_model(self.scorers.of(leg.step).model)
        return self._planner

    def timing(self, leg: Leg) -> Timing:
        """The fastest of the leg's first path."""
        planner = self.planner(leg)
        return fastest_timing(self.job.robot, self.scorers.of(leg.step).model, leg, planner.limits())

    def front(self, leg: Leg, timing: Timing) -> Front:
        """The leg's front over the timing of its first path."""
        return front_of(leg, timing, self.scorers.of(leg.step), self.planner(leg).limits())

    def slowed(self, leg: Leg, timing: Timing, duration: float, name: str = "scaled") -> Answer:
        """The leg's fastest timing, slowed evenly; not solved where it is beyond a limit."""
        trajectory = timing.slowed(duration).trajectory(self.job.robot.joints)
        valid = self.planner(leg).certify(trajectory).valid
        energy = self.scorers.of(leg.step).energy(trajectory)
        return Answer(trajectory, energy, name, "solved" if valid else "infeasible")

    def solved(self, leg: Leg, timing: Timing, duration: float, known: Trajectory | None) -> Answer:
        """The leg in `duration` s with the least energy that is found."""
        planner = self.planner(leg)
        if known is not None and planner.certify(known).valid:
            return Answer(known, planner.score(known), "resumed")
        try:
            result = planner.solve(leg.move(duration))
        except Infeasible as error:
            slowed = self.slowed(leg, timing, duration)
            if slowed.status == "solved":
                return slowed
            raise Infeasible(f"{leg.name}: {error}", joint=error.joint, limit=error.limit) from None
        return Answer(result.trajectory, result.energy, result.chosen, result.status)


def run_job(
    job: Job,
    model: PowerModel,
    settings: Settings | None = None,
    *,
    stopped: Callable[[], bool] = lambda: False,
    known: Known = lambda leg, duration: None,
    answered: Callable[[Leg, float, Trajectory], None] = lambda leg, duration, trajectory: None,
    progress: Callable[[str], None] = lambda text: None,
) -> JobResult:
    """Share the cycle's time over its legs for least energy, and solve them.

    Args:
        stopped: asked between solves; True ends the work with the best so far.
        known: an earlier run's answer to a leg of that duration, which is judged again before it is taken.
        answered: told every answer.
        progress: told what is being done.

    Raises:
        Infeasible: a leg cannot be done, or the cycle is too short; says which step binds and what would work.
    """
    work = _Worker(job, model, settings or Settings(), stopped)
    legs = legs_of(job.steps)
    timings = [work.timing(leg) for leg in legs]
    time = job.cycle_time - job.waiting
    shortest = np.array([max(t.duration, leg.least) for t, leg in zip(timings, legs, strict=True)])
    _check_time(job, legs, shortest, time)
    rest = cheapest_rest(job, work.scorers)
    plain = _plain(work, legs, timings, shortest, time)

    def answers_to(durations: np.ndarray) -> list[Answer]:
        out = []
        for k, (leg, timing, duration) in enumerate(zip(legs, timings, durations.tolist(), strict=True)):
            progress(f"{k + 1}/{len(legs)} {leg.name}: {duration:.3f} s")
            if stopped():
                out.append(work.slowed(leg, timing, duration))
                continue
            out.append(work.solved(leg, timing, duration, known(leg, duration)))
            answered(leg, duration, out[-1].trajectory)
        return out

    def cycle(answers: Sequence[Answer]) -> tuple[Piece, ...]:
        left = time - sum(answer.trajectory.duration for answer in answers)
        return assembled(job, work.scorers, legs, answers, rest, left)

    progress("sharing the cycle's time")
    fronts = [work.front(leg, timing) for leg, timing in zip(legs, timings, strict=True)]
    shares = allocate(fronts, time, rest.power)
    answers = answers_to(shares.durations)
    best = cycle(answers)
    retimed = all(leg.mode == "retime" for leg in legs)
    if not retimed and not stopped():
        durations = _anew(fronts, shares, answers, time, rest.power)
        if np.abs(durations / shares.durations - 1).max() > AGAIN:
            best = min(best, cycle(answers_to(durations)), key=energy_of)
    for pieces in plain.values():
        if pieces is not None and energy_of(pieces) < energy_of(best):
            best = pieces
    bound = None if shares.bound is None or not retimed else shares.bound + _declared_waits(job, work.scorers)
    baselines = tuple(Plain(name, None if p is None else energy_of(p)) for name, p in plain.items())
    return JobResult(job, best, baselines, bound, work.scorers, stopped())


def _declared_waits(job: Job, scorers: Scorers) -> float:
    """J of the waits that the job asks for."""
    return sum(standing_power(scorers, step, step.brakes) * step.wait for step in job.steps if step.wait is not None)


def _check_time(job: Job, legs: Sequence[Leg], shortest: np.ndarray, time: float) -> None:
    if shortest.sum() <= time * (1 + 1e-12):
        return
    longest = legs[int(np.argmax(shortest))]
    needed = float(shortest.sum() + job.waiting)
    raise Infeasible(
        f"the cycle of {job.cycle_time:g} s is too short: its moves take {shortest.sum():.4g} s at least and it waits "
        f"{job.waiting:.4g} s, {needed:.6g} s in all; the longest is {longest.name} with {shortest.max():.4g} s",
        limit="duration",
        shortest_duration=needed,
    )


def _plain(
    work: _Worker, legs: Sequence[Leg], timings: Sequence[Timing], shortest: np.ndarray, time: float
) -> dict[str, tuple[Piece, ...] | None]:
    """The cycle as it is run without thought: at full speed and then waiting, or all slowed evenly."""
    job, out = work.job, {}
    rest = last_rest(job, work.scorers)
    # what a least duration holds back takes no part in slowing down
    factor = time / shortest.sum() if shortest.sum() > 0 else 1.0
    most = np.array([leg.most for leg in legs])
    for name, durations in (("fastest_then_wait", shortest), ("evenly_slowed", np.minimum(factor * shortest, most))):
        answers = [
            work.slowed(leg, timing, float(duration), "toppra" if name == "fastest_then_wait" else "scaled")
            for leg, timing, duration in zip(legs, timings, durations, strict=True)
        ]
        valid = all(answer.status == "solved" for answer in answers)
        left = float(time - durations.sum())
        out[name] = assembled(job, work.scorers, legs, answers, rest, left) if valid else None
    return out


def _anew(
    fronts: Sequence[Front], shares: Shares, answers: Sequence[Answer], time: float, waiting: float
) -> np.ndarray:
    """Durations (L,) [s] under fronts that are scaled to what reshaping saved: losses go with time as before."""
    standby = np.array([a.energy.standby / a.trajectory.duration for a in answers])
    overhead = np.array([a.energy.total - a.energy.loss for a in answers])  # standby and what the ends decide
    ratio = np.array([a.energy.loss for a in answers]) / np.maximum(shares.energies - overhead, 1e-12)
    ratio = np.clip(ratio, 0.05, 1.0)
    holding = standby + ratio * (np.array([front.holding for front in fronts]) - standby)
    return modelled(fronts, ratio * shares.saved, holding, time, waiting)
