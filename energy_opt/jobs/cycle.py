"""The assembly of a cycle: motions and waits in order, and where the arm waits for the remaining time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.effects import Payload
from energy_opt.formats.controller_program import Part
from energy_opt.jobs.legs import Job, Leg, Step
from energy_opt.motion.judge.energy import DENSER, NONE, Energy, Past, Scorer
from energy_opt.motion.plan.efforts import used
from energy_opt.motion.trajectory import Trajectory, standing
from energy_opt.poses.estimate import holding
from energy_opt.poses.pose import Pose
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

SHORTEST_WAIT = 1e-8  # [s] a shorter wait is only the rounding of motions to nanoseconds


@dataclass(frozen=True)
class Answer:
    """A leg's motion, its energy and status.

    Attributes:
        source: its origin: `chosen` of a solve's result; "scaled" or "toppra", its first path's timing;
            "resumed", an earlier run.
    """

    trajectory: Trajectory
    energy: Energy
    source: str
    status: str = "solved"


@dataclass(frozen=True)
class Piece(Part):
    """A part of the cycle: the motion of a leg, or a wait.

    Attributes:
        steps: the job's steps that it does; empty for remaining time.
        at: place of the step whose payload and scene hold.
        energy: J, standby included.
        source: of a motion as in `Answer`, else "wait".
        begins: source of a motion's first path; empty for a wait.
        past: what came before it in the cycle.
    """

    steps: tuple[int, ...] = ()
    at: int = 0
    energy: float = 0.0
    source: str = "wait"
    status: str = "solved"
    begins: str = ""
    past: Past = NONE


class Scorers:
    """Scorers of the job's model under each payload; their models share one structure.

    Attributes:
        robot: the arm. model: the given one with zero payload, so that all payloads share what is built.
    """

    def __init__(self, robot: Robot, model: PowerModel) -> None:
        self.robot, self.model = robot, model.replaced(Payload(mass=0.0, com=[0.0, 0.0, 0.0]))
        self._kept: dict[tuple[object, ...], Scorer] = {}

    def of(self, step: Step, brakes: bool = False) -> Scorer:
        """The scorer under the payload of a step; `brakes`: while they hold the arm."""
        (mass, *com), key = step.payload, (step.payload, brakes)
        if key not in self._kept:
            model = self.model.replaced(Payload(mass=mass, com=com))
            self._kept[key] = Scorer(self.robot, model.overhead if brakes else model)
        return self._kept[key]


def efforts(robot: Robot, models: Sequence[PowerModel], motions: Iterable[tuple[Step, Trajectory]]) -> np.ndarray:
    """The largest share (n,) of each joint's torque limit that motions use under any of the models."""
    scorers = [Scorers(robot, model) for model in models]
    shares = [used(trajectory, [s.of(step) for s in scorers], robot.limits.effort) for step, trajectory in motions]
    return np.max([np.zeros(robot.n), *shares], axis=0)


@dataclass(frozen=True)
class Choice:
    """The choice of positions for a job's poses.

    Attributes:
        ends: positions (n,) [rad] at the end of each step that has a pose; poses: these, in the base frame.
        branches: number of positions considered for each.
        energy: J of the cycle when the choice was made, by the model that it was planned with.
        greedy: the same of the cycle with the nearest branches; None if not solved, or infeasible.
        solves: number of cycles solved.
        tool: the value of --tool.
    """

    ends: Mapping[int, np.ndarray]
    poses: Mapping[int, Pose]
    branches: Mapping[int, int]
    energy: float
    greedy: float | None
    solves: int
    tool: str | None = None


@dataclass(frozen=True)
class Rest:
    """Where the arm waits for the remaining time: after step `after`, at `power` W."""

    after: int
    power: float


def standing_power(scorers: Scorers, step: Step, brakes: bool) -> float:
    """Power [W] of standing at a step's end; with brakes only the overhead."""
    return float(holding([scorers.of(step, brakes)], step.goal[None])[0])


def cheapest_rest(job: Job, scorers: Scorers) -> Rest:
    """The place where waiting costs least; among equals the latest."""
    rests = [Rest(k, standing_power(scorers, step, job.brakes)) for k, step in enumerate(job.steps) if step.stop]
    return min(reversed(rests), key=lambda rest: rest.power)


@dataclass(frozen=True)
class Plan:
    """The parts of a cycle: its legs' motions, and `left` s of waiting at `rest`."""

    legs: tuple[Leg, ...]
    answers: tuple[Answer, ...]
    rest: Rest
    left: float

    def under(self, job: Job, scorers: Scorers, factor: int = DENSER) -> Plan:
        """The same motions and waits, scored by other models.

        Args:
            job: of the plan. scorers: of the other models. factor: how much denser than the samples the grid is.
        """
        pairs = zip(self.legs, self.answers, strict=True)
        answers = tuple(replace(a, energy=scorers.of(leg.step).energy(a.trajectory, factor)) for leg, a in pairs)
        power = standing_power(scorers, job.steps[self.rest.after], job.brakes)
        return replace(self, answers=answers, rest=replace(self.rest, power=power))


def assembled(job: Job, scorers: Scorers, plan: Plan) -> tuple[Piece, ...]:
    """All pieces of a cycle in order.

    Args:
        job: its steps. scorers: for the energy of waits. plan: the motions, the waits and the time left over.
    """
    by_step = {leg.steps[0]: (leg, answer) for leg, answer in zip(plan.legs, plan.answers, strict=True)}
    rest = plan.rest
    out: list[Piece] = []

    def wait(name: str, steps: tuple[int, ...], k: int, seconds: float, brakes: bool) -> None:
        step = job.steps[k]
        still = standing(job.robot.joints, step.goal, seconds)
        out.append(Piece(still, name, True, "brakes" if brakes else "", step.payload, steps, k))

    for k, step in enumerate(job.steps):
        more = plan.left if k == rest.after and plan.left > SHORTEST_WAIT else 0.0
        if step.wait is not None:
            wait(step.name, (k,), k, step.wait, step.brakes)
        elif k in by_step:
            leg, answer = by_step[k]
            out.append(
                Piece(
                    answer.trajectory, leg.name, False, "", step.payload, leg.steps, k, answer.energy.total,
                    answer.source, answer.status, leg.begins,
                )
            )  # fmt: skip
        if more:
            wait("time left over", (), k, more, job.brakes)
    return _in_order(job, scorers, out)


def _in_order(job: Job, scorers: Scorers, pieces: Sequence[Piece]) -> tuple[Piece, ...]:
    """The pieces with their pasts, and the energies that depend on these."""
    past, out = NONE, []
    for piece in pieces:
        scorer = scorers.of(job.steps[piece.at], piece.mode == "brakes")
        energy, after = piece.energy, Past(past.time + piece.trajectory.duration)
        if piece.waits or scorer.depends_on_past:
            found, after = scorer.energy_after(past, piece.trajectory)
            energy = found.total
        out.append(replace(piece, energy=energy, past=past))
        past = after
    return tuple(out)


def energy_of(job: Job, scorers: Scorers, plan: Plan) -> float:
    """Energy [J] of a whole cycle; arguments are those of `assembled`."""
    return sum(piece.energy for piece in assembled(job, scorers, plan))
