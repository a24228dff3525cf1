"""What is asked of a reshaping, first guesses of it, and how its outcomes are ranked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.motion.limits.base import Limit
from energy_opt.motion.reshape.curve import Curve, Outcome, fitted
from energy_opt.motion.reshape.evaluation import OpenGoal
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.level import Level
from energy_opt.motion.reshape.model import Model
from energy_opt.motion.reshape.polish import polished
from energy_opt.motion.reshape.sqp import begin, descend
from energy_opt.motion.trajectory import Trajectory

FREE = 0.02  # share of a bound that a step of sequential quadratic programming may exceed it by, to be mended later
SLACK = 0.01  # the same of a constraint at a place, as beside bodies and in tubes, while a search goes on
FEASIBLE = 1e-4  # an outcome with a larger excess over a bound counts as infeasible


@dataclass(frozen=True)
class Line:
    """A first guess: positions q (M, n) at u (M,) in [0, 1], and a duration [s]."""

    u: np.ndarray
    q: np.ndarray
    duration: float

    @classmethod
    def of(cls, trajectory: Trajectory) -> Line:
        """A trajectory's."""
        t = trajectory.time - trajectory.time[0]
        return cls(t / t[-1], trajectory.position, trajectory.duration)


@dataclass(frozen=True)
class Task:
    """One reshaping: ends, limits, the model's values, bounds on T and the cost per second that no path changes.

    `width` multiplies the widths over which kinks, as of dry friction, are smoothed. Where the goal is `open`, it moves
    with the curve to where that costs least.
    """

    ends: Ends
    limits: tuple[Limit, ...]
    parameters: np.ndarray
    durations: tuple[float, float]
    offset: float
    width: float = 1.0
    open: OpenGoal | None = None

    @property
    def fixed(self) -> bool:
        """Is the duration given?"""
        return self.durations[0] == self.durations[1]

    @property
    def vias(self) -> int:
        """Number of via points."""
        return len(self.ends.via)

    def lasting(self, duration: float) -> Task:
        """The same in exactly `duration` s."""
        return replace(self, durations=(duration, duration))

    def within(self, curve: Curve) -> Curve:
        """A curve in a duration that is allowed."""
        return replace(curve, duration=float(np.clip(curve.duration, *self.durations)))

    def model(self, level: Level) -> Model:
        """The problem on a level."""
        return level.model(self.ends, self.limits, self.parameters, self.durations, self.offset, self.width, self.open)

    def polished(self, level: Level, found: Outcome) -> Outcome:
        """An outcome solved again by IPOPT from where it is."""
        model = self.model(level)
        model.scale = 1 / max(abs(self.cost(found)), 0.01 * abs(found.cost), 1e-6)
        return polished(model, found.curve)

    def descended(
        self, level: Level, guess: Curve, iterations: int, *, trust: float, tolerance: float, loose: float = 1e-6,
        give: float = FREE, stopped: Callable[[], bool] = lambda: False,
    ) -> Outcome:  # fmt: skip
        """What sequential quadratic programming comes to on a level from a guess."""
        model = self.model(level)
        lower, upper = model.box
        guess = replace(guess, points=np.clip(guess.points, lower, upper))
        point = model.at_curve(guess)
        model.scale = 1 / max(abs(point.cost), 1e-6)
        now = begin(model.at_curve(guess))
        descend(
            model, now, iterations, trust, tolerance=tolerance, give=give, slack=SLACK, loose=loose, stopped=stopped
        )  # fmt: skip
        return model.outcome(now.point, now.iterations, now.converged)

    def curve(self, shape: Shape, line: Line) -> Curve:
        """The curve of a shape that is nearest to a line, with the task's ends."""
        duration = float(np.clip(line.duration, *self.durations))
        places = np.linspace(0, 1, self.vias + 2)[1:-1]
        for i, via in enumerate(self.ends.via):  # where the guess passes nearest, in order
            k = int(np.argmin(np.abs(line.q - via).sum(axis=1)))
            places[i] = np.clip(line.u[k], 0.02, 0.98)
        return fitted(shape, line.u, line.q, self.ends, duration, np.sort(places))

    def cost(self, outcome: Outcome) -> float:
        """What the path can change of an outcome's cost."""
        return outcome.cost - self.offset * outcome.curve.duration

    def promise(self, outcome: Outcome) -> float:
        """What the path can change of the cost of a curve that may not hold the limits yet: more by its excess."""
        return self.cost(outcome) * (1 + max(outcome.broken, 0.0))

    def rank(self, outcome: Outcome) -> tuple[bool, float]:
        """Feasible outcomes first, by cost; infeasible ones by how far they are off."""
        feasible = outcome.broken <= FEASIBLE
        return not feasible, self.cost(outcome) if feasible else outcome.broken
