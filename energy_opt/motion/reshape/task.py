"""The input of a reshaping, the problems of one shape, first guesses, and the ranking of outcomes.

A task says what is asked for and does not depend on the number of control points. A level is one shape with its
functions. Their combination is a model, which is solved; so one task is solved on a coarse and on a fine level.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from energy_opt.motion.limits.base import Limit, values_of
from energy_opt.motion.path import JointPath
from energy_opt.motion.reshape.curve import SPENT, Curve, Outcome, between, fitted
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
        self.shape, self.nodes = shape, nodes
        u = shape.grid[0][:, None]
        self._value = cache(lambda curves: Batch(nodes.value, curves * len(u)).fixing(1, np.tile(u, (curves, 1))))

    def shares(self, points: np.ndarray, duration: float, task: Task) -> tuple[np.ndarray, dict[int, np.ndarray]]:
        """Costs of curves that take `duration` s, and the share of its bound that each limit uses at every place.

        Args:
            points: (C, controls, n) control points.

        Returns:
            The costs (C,), standby included; shares by the limit's number, (C, sites or nodes, columns), 1 at the
            bound. Limits without a bound on a derivative and without symbolic constraints have none.
        """
        s, count = self.shape, len(points)
        w = s.grid[1]
        z = np.empty((count, len(w), 3 * s.joints + 1))
        z[..., :-1] = np.concatenate([m @ points for m in s.matrices[:3]], axis=2)
        z[..., -1] = duration
        values = np.concatenate([task.parameters, values_of(task.limits, task.width)])
        rate, limited = self._value(count)(z.reshape(-1, z.shape[2]), values)
        limited = limited.reshape(count, len(w), -1)
        shares, used = {}, 0
        for number, limit in enumerate(task.limits):
            if limit.order:
                moved = s.sites[limit.order - 1] @ points
                shares[number] = np.abs(moved) / duration**limit.order / limit.bound
            if limit.scale.size:
                of_limit = limited[..., used : used + limit.scale.size]
                shares[number] = (of_limit if limit.one_sided else np.abs(of_limit)) / limit.scale
                used += limit.scale.size
        return rate.reshape(count, -1) @ w, shares

    def excess(self, points: np.ndarray, duration: float, task: Task) -> tuple[np.ndarray, np.ndarray]:
        """Costs (C,) as `shares` gives them, and each curve's worst excess over a limit as a share of the bound (C,).

        Numeric constraints of limits count, clearance from bodies does not.
        """
        costs, shares = self.shares(points, duration, task)
        out = np.full(len(points), -np.inf)
        for share in shares.values():
            out = np.maximum(out, share.max(axis=(1, 2)) - 1)
        for limit in task.limits:
            if type(limit).excess_at is not Limit.excess_at:
                out = np.maximum(out, [limit.excess_at(q) for q in self.shape.matrices[0] @ points])
        return costs, out


FREE = 0.02  # share of a bound that a step of sequential quadratic programming may exceed, to be repaired later
SLACK = 0.01  # the same for a constraint at a place, as beside bodies and in tubes, during a search
# A search is given up after SOON iterations if MORE steps that save as much as the last one would leave it above this
# multiple of its rival's cost. Multiples from 1 to 1.1 lose no optimum in `benchmarks/starts.py`.
SOON, MORE, HOPELESS = 4, 3.0, 1.05
FEASIBLE = 1e-4  # an outcome with a larger excess over a bound counts as infeasible
PASSED = 200  # places of a path that a guess is fitted to
FEWEST = 100  # least places of a guess at which it may pass via points; a file may have two samples
EARLIEST = 0.02  # first time u at which a guess passes via points; the last one is as long before the goal
REPAIRABLE = 0.05  # share of a bound: an excess that more control points, or IPOPT, may still repair


def at_most(cost: float, times: float) -> float:
    """`times` a cost; of a cost below zero, as much above it. Rounded kinks take costs of slow moves below zero."""
    return cost + (times - 1) * abs(cost)


@dataclass(frozen=True)
class Line:
    """A first guess: positions q (M, n) at u (M,) in [0, 1], and a duration [s]."""

    u: np.ndarray
    q: np.ndarray
    duration: float

    @classmethod
    def of(cls, trajectory: Trajectory) -> Line:
        """The first guess that follows a trajectory."""
        t = trajectory.time - trajectory.time[0]
        return cls(t / t[-1], trajectory.position, trajectory.duration)

    @classmethod
    def along(cls, path: JointPath, duration: float) -> Line:
        """The first guess that passes a path smoothly from rest to rest in `duration` s."""
        u = np.linspace(0, 1, PASSED)
        return cls(u, path(u**3 * (10 - 15 * u + 6 * u**2)), duration)


@dataclass(frozen=True)
class Task:
    """One reshaping.

    Attributes:
        parameters: the model's values, in the order of `PowerModel.values`.
        durations: [s] least and largest T, equal if it is given.
        offset: cost per second that is the same for all paths (W for energy).
        width: factor of the widths over which kinks, as of dry friction, are smoothed.
        open: ends and via points that move with the curve to where they cost least.
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
        """The same task in exactly `duration` s."""
        return replace(self, durations=(duration, duration))

    def within(self, curve: Curve) -> Curve:
        """A curve with its duration clipped to the allowed range."""
        return replace(curve, duration=float(np.clip(curve.duration, *self.durations)))

    def model(self, level: Level) -> Model:
        """The problem on a level, for sequential quadratic programming."""
        given = self.ends, self.limits, self.parameters, self.durations, self.offset, self.width, self.open
        return Model(level.shape, level.nodes, *given)

    def path_cost(self, level: Level, curve: Curve) -> float:
        """The part of a curve's cost that depends on the path; the curve is of the level's shape."""
        cost, _ = level.shares(curve.points[None], curve.duration, self)
        return float(cost[0]) - self.offset * curve.duration

    def polished(self, level: Level, found: Outcome) -> Outcome:
        """The outcome `found`, solved again by IPOPT from its curve, which is of the level's shape."""
        scale = 1 / max(abs(self.cost(found)), 0.01 * abs(found.cost), 1e-6)
        return polished(self.model(level).scaled(scale), found.curve)

    def descended(
        self, model: Model, guess: Curve, iterations: int, *, trust: float, tolerance: float,
        give: float = FREE, stopped: Callable[[], bool] = lambda: False, rival: float = np.inf,
        arrived: Callable[[Outcome], bool] | None = None,
    ) -> Outcome:  # fmt: skip
        """Result of sequential quadratic programming on the task's model from a guess.

        Args:
            iterations, trust, tolerance, give, stopped: see `sqp.descend`.
            rival: cost of an optimum that is known; a search that is far above it is given up (`HOPELESS`).
            arrived: True for an outcome after which the search need not go on.
        """
        lower, upper = model.box
        point = model.at_curve(replace(guess, points=np.clip(guess.points, lower, upper)))
        scale = 1 / max(abs(point.cost), 1e-6)
        model = model.scaled(scale)
        now = begin(replace(point, cost=scale * point.cost, slope=scale * point.slope))
        last = now.point.cost

        def ended() -> bool:
            nonlocal last
            cost, saved = now.point.cost, last - now.point.cost
            last = cost
            if arrived is not None and arrived(model.outcome(now.point, now.iterations, False)):
                return True
            hopeless = 0 < rival < np.inf and cost - MORE * max(saved, 0.0) > HOPELESS * scale * rival
            return stopped() or (now.iterations >= SOON and hopeless)

        descend(
            model, now, iterations, trust, tolerance=tolerance, give=give, slack=min(give, SLACK),
            stopped=ended,
        )  # fmt: skip
        return model.outcome(now.point, now.iterations, now.converged, "sqp" if now.iterations < iterations else SPENT)

    def curve(self, shape: Shape, line: Line) -> Curve:
        """The curve of a shape nearest to a line, with the task's ends."""
        duration = float(np.clip(line.duration, *self.durations))
        return fitted(shape, line.u, line.q, self.ends, duration, self._nearest(line))

    def _nearest(self, line: Line) -> np.ndarray:
        """The times u (vias,), one after the other, at which a line's samples are nearest to the via points in the sum.

        If the samples nearest to each point are in order, these are they.
        """
        u = line.u if len(line.u) >= FEWEST else np.union1d(line.u, np.linspace(0, 1, FEWEST))
        u = u[(u >= EARLIEST) & (u <= 1 - EARLIEST)]
        q = np.column_stack([np.interp(u, line.u, x) for x in line.q.T])
        least, before = np.zeros(len(u)), []
        for via in self.ends.via:
            # the best time of the point before, if this point is passed at the k-th time
            best = np.maximum.accumulate(np.where(least == np.minimum.accumulate(least), np.arange(len(u)), 0))
            best = np.concatenate([[0], best[:-1]])
            before.append(best)
            least = np.where(np.arange(len(u)) < len(before), np.inf, least[best] + np.abs(q - via).sum(axis=1))
        at, k = np.zeros(self.vias, dtype=int), int(np.argmin(least))
        for i in reversed(range(self.vias)):
            at[i], k = k, int(before[i][k])
        return np.asarray(u[at])

    def between(self, a: Curve, b: Curve, share: float) -> Curve:
        """The mixture (1 - share) a + share b of two curves of one shape, moved so that it passes the via points."""
        mixed = between(a, b, share)
        if not self.vias:
            return mixed
        return replace(mixed, points=a.shape.passing(mixed.points[None], mixed.via_u[None], self.ends.via)[0])

    def cost(self, outcome: Outcome) -> float:
        """The part of an outcome's cost that depends on the path."""
        return outcome.cost - self.offset * outcome.curve.duration

    def promise(self, outcome: Outcome) -> float:
        """The part of the cost that depends on the path, increased by the excess over limits."""
        return at_most(self.cost(outcome), 1 + max(outcome.broken, 0.0))

    def coarse_rank(self, outcome: Outcome) -> tuple[bool, float]:
        """Sort key of coarse outcomes: by `promise` if their excess may still be repaired, else by their excess."""
        repairable = outcome.broken <= REPAIRABLE
        return not repairable, self.promise(outcome) if repairable else outcome.broken

    def rank(self, outcome: Outcome) -> tuple[bool, float]:
        """Sort key: feasible outcomes first, by cost; infeasible ones by their excess."""
        feasible = outcome.broken <= FEASIBLE
        return not feasible, self.cost(outcome) if feasible else outcome.broken
