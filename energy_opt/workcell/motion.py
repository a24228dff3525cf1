"""The motions of a cell's arms: one move by its duration, and all parts of a cycle, one after the other.

Energies and torques of one arm are under the mean of its models, by which it is planned, and under the first of them,
under which results are stated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from energy_opt.cell.curve import MotionCurve
from energy_opt.effects import DcLink, Regeneration, StoreEffect
from energy_opt.jobs.cycle import Answer, Scorers, efforts
from energy_opt.jobs.legs import Leg, Step
from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.power.known import assumes_no_regeneration
from energy_opt.power.mixture import Mixture
from energy_opt.robot import Robot
from energy_opt.schedule import Hull
from energy_opt.schedule.problem import SAME
from energy_opt.workcell.link import through_link

ROUNDED = 1e-9  # [s] times that differ by less are the same


@dataclass(frozen=True)
class Part:
    """One step of the cycle: its name, its start [s] from the cycle's begin, its duration [s], and its motion.

    A wait is at rest.
    """

    name: str
    start: float
    duration: float
    trajectory: Trajectory


def at_rest(trajectory: Trajectory) -> Trajectory:
    """A motion from rest to rest with velocity and acceleration of exactly 0 at its ends."""
    velocity, acceleration = trajectory.velocity.copy(), trajectory.acceleration.copy()
    velocity[[0, -1]] = acceleration[[0, -1]] = 0.0
    return Trajectory(trajectory.joints, trajectory.time, trajectory.position, velocity, acceleration)


class PeriodicMotion:
    """All parts of a robot's cycle, in order; the last ends where the first begins, one cycle later."""

    def __init__(self, parts: Sequence[Part], cycle: float) -> None:
        self.parts, self.cycle = tuple(part for part in parts if part.duration > ROUNDED), cycle
        times, pieces = [], []
        for part in self.parts:
            t = part.trajectory
            curve = MotionCurve(t.time, t.position, t.velocity, t.acceleration)
            pieces.append(curve.bernstein)
            scale = part.duration / t.duration  # 1, except for rounding
            times.append(part.start + (t.time[:-1] - t.time[0]) * scale)
        self.begin = self.parts[0].start
        self.time = np.append(np.concatenate(times), self.begin + cycle)
        self._curve = MotionCurve.of_pieces(self.time, np.concatenate(pieces, axis=1))

    def part_at(self, time: float) -> Part:
        """The part that runs at a time [s]."""
        at = self.begin + (time - self.begin) % self.cycle
        return [part for part in self.parts if part.start <= at + ROUNDED][-1]

    def sample_times(self, begin: float, end: float) -> np.ndarray:
        """Times (M,) [s] of its pieces' ends within [begin, end] [s]."""
        first, last = (int(np.floor((x - self.begin) / self.cycle)) for x in (begin, end))
        times = np.concatenate([self.time + k * self.cycle for k in range(first, last + 1)])
        return times[(times >= begin) & (times <= end)]

    def pieces(self, time: np.ndarray) -> np.ndarray:
        """Bernstein coefficients (6, M - 1, n) between times (M,), whose spacing is at most that of the pieces."""
        middle = (time[:-1] + time[1:]) / 2
        shift = self.cycle * np.floor((middle - self.begin) / self.cycle)
        k = np.clip(np.searchsorted(self.time, middle - shift, side="right") - 1, 0, len(self.time) - 2)
        low, length = self.time[k] + shift, np.diff(self.time)[k]
        ends = [np.clip((x - low) / length, 0.0, 1.0) for x in (time[:-1], time[1:])]
        return self._curve.cut(k, *ends)

    def at(self, time: np.ndarray) -> np.ndarray:
        """Positions (M, n) at times (M,) [s]."""
        return self._curve.positions(self.begin + (np.asarray(time) - self.begin) % self.cycle)


@dataclass
class ArmMove:
    """A motion from rest to rest, by duration.

    Attributes:
        place: index of its step in the robot's table; leg, timing: its first path and that path's fastest timing.
        shortest, longest: [s] bounds of its duration.
        answers: best known trajectories by duration [s]; slowed: the fastest timing, slowed evenly.
        tried: durations [s] at which it was optimized.
    """

    place: int
    leg: Leg
    timing: Timing
    shortest: float
    longest: float
    answers: dict[float, Answer] = field(default_factory=dict)
    slowed: dict[float, Answer] = field(default_factory=dict)
    tried: set[float] = field(default_factory=set)

    def was_tried(self, duration: float) -> bool:
        """True if it was optimized at a duration [s]."""
        return any(abs(duration / tried - 1) < SAME for tried in self.tried)

    def beside(self, duration: float, worth: float) -> list[float]:
        """Durations [s] between a known one and its neighbours at which more than `worth` [J] may be saved.

        Energy is convex over the duration: between two optimized durations it lies above the lines through their
        neighbours, if these are optimized too.
        """
        hull = Hull.of([(d, answer.energy.total) for d, answer in self.answers.items()])
        d, e = hull.durations, hull.energies
        known = [self.was_tried(at) for at in d.tolist()]
        chosen = int(np.argmin(np.abs(d - duration)))
        out = []
        for k in range(max(chosen - 1, 0), min(chosen + 1, len(d) - 1)):  # between d[k] and d[k + 1]
            middle = float(np.sqrt(d[k] * d[k + 1]))
            least = -np.inf
            for one, two in ((k, k - 1), (k + 1, k + 2)):
                if 0 <= two < len(d) and known[one] and known[two]:
                    least = max(least, e[one] + (middle - d[one]) * (e[one] - e[two]) / (d[one] - d[two]))
            if hull.value(middle) - least > worth:
                out.append(middle)
        return out


def nearest(known: dict[float, Any], duration: float) -> float:
    """The key of `known` nearest to a duration [s]."""
    return min(known, key=lambda d: abs(d - duration))


def at_link(model: PowerModel, robot: Robot, share: float = 1.0) -> PowerModel:
    """The model before the DC link of a cell's supply, which stores this share of what reaches it.

    The supply replaces the model's own store, and the assumption of `careful` that nothing returns. The efficiency of
    any other model stays: it is the share of the braking energy that reaches the link.
    """
    members = []
    for _, one in model.weighted:
        drive = next((effect for effect in one.effects if effect.stage == "drive"), None)
        if drive is not None and (isinstance(drive, StoreEffect) or assumes_no_regeneration(one, robot)):
            one, drive = one.without(drive.name), None
        if share < 1:
            own = drive if isinstance(drive, Regeneration) else Regeneration(efficiency=1.0)
            part = Regeneration(efficiency=share * float(own.values["efficiency"][0]), **own.choices)
            one = one.kept(lambda effect: effect.stage != "drive").replaced(part)
        members.append(one)
    return Mixture.of(members, [weight for weight, _ in model.weighted]) if members[1:] else members[0]


class Scoring:
    """The scorers of an arm; `mixed`: its model is the mean of several.

    Args:
        robot: the arm's. model: of the arm. capacity: [J] of the arm's own link; None: its model says what returns.

    Attributes:
        replaced: the model's effects that the link replaces.
    """

    def __init__(self, robot: Robot, model: PowerModel, capacity: float | None) -> None:
        self.robot, self.mixed, self.capacity = robot, len(model.weighted) > 1, capacity
        self.model = model if capacity is None else at_link(model, robot)
        self.replaced = tuple(dict.fromkeys(e.name for e in model.effects if e not in self.model.effects))
        self._of = Scorers(robot, self.model), Scorers(robot, self.model.weighted[0][1])

    def of(self, first: bool) -> Scorers:
        """The scorers of the first model or of the mean; with a link, all braking energy that reaches it returns."""
        return self._of[first]

    def energy(self, step: Step, trajectory: Trajectory, lossless: bool = False, first: bool = False) -> Energy:
        """Energy of a motion, with what its own link loses if it is empty at first; arguments are those of `of`."""
        found = self.of(first).of(step).energy(trajectory)
        if lossless or self.capacity is None:
            return found
        lost = float(through_link(self._taken(step, trajectory, first), self.capacity)[1].sum())
        by_effect = {**found.by_effect, DcLink.name: lost}
        return replace(found, total=found.total + lost, loss=found.loss + lost, by_effect=by_effect)

    def scored(self, move: ArmMove, answer: Answer) -> Answer:
        """An answer of a move with its energy from the arm's own link, if there is one."""
        if self.capacity is None:
            return answer
        return replace(answer, energy=self.energy(move.leg.step, answer.trajectory))

    def used_again(self, moves: Sequence[ArmMove], cycle: float) -> float:
        """Share of the braking energy that the arm's own link stores: the least of three paces of evenly slowed moves.

        At the slowest, the moves fill a cycle [s]; at the fastest, they are at their limits.
        """
        if self.capacity is None:
            return 1.0
        slowest = max(1.0, cycle / max(sum(move.shortest for move in moves), ROUNDED))
        return min((self._stored(moves, slowest**power) for power in (0.0, 0.5, 1.0)), default=1.0)

    def _stored(self, moves: Sequence[ArmMove], slower: float) -> float:
        """Share of the braking energy that the link stores if moves take `slower` times their shortest time."""
        braked, lost = 0.0, 0.0
        for move in moves:
            timing = move.timing.slowed(move.timing.duration * min(slower, move.longest / move.shortest))
            taken = self._taken(move.leg.step, timing.trajectory(self.robot.joints))
            braked -= float(taken.clip(max=0).sum())
            lost += float(through_link(taken, self.capacity or 0.0)[1].sum())
        return 1 - lost / braked if lost else 1.0

    def _taken(self, step: Step, trajectory: Trajectory, first: bool = False) -> np.ndarray:
        """Energies [J] that the drives take between the instants of a dense grid, (N - 1,)."""
        scorer = self.of(first).of(step)
        dense = scorer.dense(trajectory)
        bus = dense.power - scorer.model.constant_power(scorer.robot.n)
        return np.diff(cumulative_trapezoid(bus, dense.time, initial=0))

    def stated(self, step: Step, answer: Answer) -> float:
        """Energy [J] of an answer under the first model."""
        return self.energy(step, answer.trajectory, first=True).total if self.mixed else answer.energy.total

    def between(self, step: Step, known: dict[float, Answer], durations: np.ndarray, duration: float) -> float:
        """Energy [J] of a move under the first model at a duration [s], linear between those of its answers.

        Args:
            step: of the move, for its payload. known: its answers by duration [s].
            durations: (K,) [s] ascending, those between which to interpolate.
        """
        k = int(np.clip(np.searchsorted(durations, duration * (1 - SAME)), 1, max(len(durations) - 1, 1)))
        ends = durations[k - 1 : k + 1].tolist()
        return float(np.interp(duration, ends, [self.stated(step, known[nearest(known, end)]) for end in ends]))

    def efforts(self, motions: Sequence[tuple[Step, Trajectory]]) -> tuple[np.ndarray, np.ndarray]:
        """The largest share (n,) of each joint's torque limit that motions use: under the first model, the others."""
        models = [model for _, model in self.model.weighted]
        return efforts(self.robot, models[:1], motions), efforts(self.robot, models[1:], motions)
