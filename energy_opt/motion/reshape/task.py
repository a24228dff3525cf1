"""What is asked of a reshaping, the problems of one shape, first guesses, and how outcomes are ranked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.motion.limits.base import Limit, values_of
from energy_opt.motion.reshape.curve import Curve, Outcome, fitted
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.model import Model
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.motion.reshape.open import FIXED, Open
from energy_opt.motion.reshape.polish import polished
from energy_opt.motion.reshape.sqp import begin, descend
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.batch import Batch


class Level:
    """All problems of one shape."""

    def __init__(self, shape: Shape, nodes: NodeFunctions) -> None:
        self.shape, self._nodes = shape, nodes
        self._value = Batch(nodes.value, len(shape.grid[0]))

    def model(
        self, ends: Ends, limits: Sequence[Limit], parameters: np.ndarray, durations: tuple[float, float],
        offset: float, width: float = 1.0, open_: Open = FIXED,
    ) -> Model:  # fmt: skip
        """The problem for sequential quadratic programming."""
        return Model(self.shape, self._nodes, ends, limits, parameters, durations, offset, width, open_)

    def shares(
        self, curve: Curve, parameters: np.ndarray, limits: Sequence[Limit], width: float = 1.0
    ) -> tuple[float, dict[int, np.ndarray]]:
        """Cost, and the share of its bound that each limit uses at every place, (sites or nodes, columns) by number."""
        s = self.shape
        u, w = s.grid
        q = [m @ curve.points for m in s.matrices[:3]]
        z = np.hstack([*q, np.full((len(u), 1), curve.duration)])
        rate, limited = self._value(z, u[:, None], np.concatenate([parameters, values_of(limits, width)]))
        shares, used = {}, 0
        for number, limit in enumerate(limits):
            if limit.order:
                moved = s.sites[limit.order - 1] @ curve.points
                shares[number] = np.abs(moved) / curve.duration**limit.order / limit.bound
            if limit.scale.size:
                values = limited[:, used : used + limit.scale.size]
                shares[number] = (values if limit.one_sided else np.abs(values)) / limit.scale
                used += limit.scale.size
        return float(w @ rate[:, 0]), shares

    def standing(self, q: np.ndarray, duration: float, parameters: np.ndarray, limits: Sequence[Limit]) -> np.ndarray:
        """What standing at each of q (M, n) costs, by the second (M,)."""
        count, rates = len(self.shape.grid[0]), []
        values, z = np.concatenate([parameters, values_of(limits)]), np.zeros((count, 3 * self.shape.joints + 1))
        z[:, -1] = duration
        for first in range(0, len(q), count):
            block = q[first : first + count]
            z[: len(block), : self.shape.joints] = block
            rates.append(self._value(z, np.full((count, 1), 0.5), values)[0][: len(block), 0] / duration)
        return np.concatenate(rates)

    def excess(self, curve: Curve, parameters: np.ndarray, limits: Sequence[Limit]) -> tuple[float, float]:
        """Cost, and the worst excess over a limit; planes between bodies aside, as they are no limit of their own."""
        cost, shares = self.shares(curve, parameters, limits)
        placed = [limit.excess_at(self.shape.matrices[0] @ curve.points) for limit in limits]
        return cost, max([float(share.max()) - 1 for share in shares.values()] + placed)


FREE = 0.02  # share of a bound that a step of sequential quadratic programming may exceed it by, to be repaired later
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

    `width` multiplies the widths over which kinks, as of dry friction, are smoothed. What is `open` moves with the
    curve to where that costs least.
    """

    ends: Ends
    limits: tuple[Limit, ...]
    parameters: np.ndarray
    durations: tuple[float, float]
    offset: float
    width: float = 1.0
    open: Open = FIXED

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
            model, now, iterations, trust, tolerance=tolerance, give=give, slack=min(give, SLACK), loose=loose,
            stopped=stopped,
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
