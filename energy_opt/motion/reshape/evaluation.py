"""A reshaping problem at a curve: its cost and gradient, shares of limits, and what is near.

Unknowns are the free control points, point by point, and
behind them T, unless it is given, the goal's steps along what a pose leaves free, and the via points' times.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Protocol, Self

import numpy as np

from energy_opt.motion.limits.base import Limit, PlaceConstraints, box_of, values_of
from energy_opt.motion.limits.clearance import ClearanceConstraints
from energy_opt.motion.reshape.curve import Curve, Outcome
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.numerics.batch import Batch

NEAREST, ARM = 0.01, 0.5  # [m] nearer bodies get constraints, and more for each rad that joints will turn
DIFFERENCE = 1e-5  # [rad, m] of what ending somewhere costs


def bending(f: Callable[[np.ndarray], np.ndarray], q: np.ndarray, along: np.ndarray, step: float = 1e-3) -> np.ndarray:
    """Second derivatives (k, k, ...) at q (n,) of a function of positions (M, n), along k directions (k, n)."""
    i, j = np.triu_indices(len(along))
    one, other = step * along[i], step * along[j]
    around = np.vstack([q + a * one + b * other for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))])
    value = f(around)
    value = value.reshape(4, len(i), *value.shape[1:])
    out = np.zeros((len(along), len(along), *value.shape[2:]))
    out[i, j] = out[j, i] = (value[0] - value[1] - value[2] + value[3]) / (4 * step**2)
    return out


class OpenGoal(Protocol):
    """A goal that may move on a surface of positions, `count` directions wide: those at which the tool has its pose."""

    count: int

    def along(self, q: np.ndarray) -> np.ndarray:
        """Orthonormal tangents (count, n) at q (n,), which follow q smoothly."""

    def bend(self, q: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Second derivatives (count, count, n) of the surface by steps along the tangents."""

    def reached(self, q: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The positions (n,) on the surface, within its ranges, that are next to q + step (n,)."""

    def work(self, q: np.ndarray) -> np.ndarray:
        """What ending at positions q (K, n) costs beside the objective's integral, (K,)."""

    def ranges(self, q: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """What is bounded: values (R,), their slopes (R, count) along the tangents, and lowest and highest values."""


@dataclass
class Point:
    """A curve with what was evaluated there; `placed`: limits, their numeric constraints, positions and values."""

    points: np.ndarray
    duration: float
    via_u: np.ndarray
    z: np.ndarray
    cost: float
    slope: np.ndarray  # (K, nz) of the cost's rate, weighted
    linear: np.ndarray  # signed shares of bounds
    hot: np.ndarray  # (nodes, columns) signed shares
    hot_slope: np.ndarray  # (nodes, nz, columns)
    via: np.ndarray  # (vias, n) what is off
    along: np.ndarray  # (directions, n) of the goal
    placed: list[tuple[int, PlaceConstraints, np.ndarray, np.ndarray]] = field(
        default_factory=list
    )  # limit, constraints, q, values


class Evaluation:
    """One problem of a shape: ends, limits, the model's values and the bounds of T.

    Args:
        width: what widths of smoothed kinks are multiplied by; offset: what it costs per second whatever the path.
        goal: where the goal is free to move; the move then ends at rest.
    """

    def __init__(
        self, shape: Shape, nodes: NodeFunctions, ends: Ends, limits: Sequence[Limit], parameters: np.ndarray,
        durations: tuple[float, float], offset: float = 0.0, width: float = 1.0, goal: OpenGoal | None = None,
    ) -> None:  # fmt: skip
        s = self.shape = shape
        self.goal, directions = goal, 0 if goal is None else goal.count
        self.ends, self.limits, self.offset, self.scale = ends, tuple(limits), offset, 1.0
        self.fixed = durations[0] == durations[1]
        self.durations = durations
        self.clearance: ClearanceConstraints | None = None
        self.offset = offset if self.fixed else 0.0
        self._at_places = b"", np.zeros((0, 0))
        self._values = np.concatenate([parameters, values_of(limits, width)])
        u, w = s.grid
        self._quad, self._breaks = np.flatnonzero(w), np.flatnonzero(w == 0)
        self._weight, self._u, self._window = w[self._quad], u[:, None], s.window(u)
        self._cost = Batch(nodes.cost, len(self._quad))
        self._curvature = Batch(nodes.curvature, len(self._quad))
        self._nodes = nodes
        self.box = box_of(limits, s.joints)
        self.border = (0 if self.fixed else 1) + directions + s.vias
        self.toward = slice(self.border - s.vias - directions, self.border - s.vias)  # of the border
        self._set_linear()
        self._set_hot()
        controls, n = s.basis.controls, s.joints
        self._pinned_slope = np.zeros((controls, n))  # d(control points)/dT
        self._pinned_slope[: s.pinned] = np.outer(s.end_slopes[0], ends.v_start)
        self._pinned_slope[controls - s.pinned :] = np.outer(s.end_slopes[1], ends.v_goal)
        self._still = not self._pinned_slope.any()
        self._z_slope = np.concatenate(
            [(s.stacked @ self._pinned_slope).reshape(len(u), -1), np.ones((len(u), 1))], axis=1
        )
        self._linear_slope = self._per * (self._linear_all @ self._pinned_slope.ravel())
        stacked = s.stacked.reshape(len(u), 3, -1)[self._quad].reshape(3 * len(self._quad), -1)
        self._down = stacked.T[s.pinned : controls - s.pinned].copy()
        self._down_all = stacked.T.copy()
        self._goal_z = s.stacked[:, -s.pinned :].sum(axis=1).reshape(len(u), 3)  # by what is the goal
        if goal is not None:
            linear = self._linear_all.toarray().reshape(-1, controls, n)
            self._goal_linear = self._per[:, None] * linear[:, -s.pinned :].sum(axis=1)
            u = np.linspace(0, 1, 6 * controls)[:, None]  # how the curve follows what the goal bends off its tangent
            pinned = np.zeros((s.pinned, 1)), np.ones((s.pinned, 1))
            self._carried = s.basis.fit(u[:, 0], u**3 * (10 - 15 * u + 6 * u**2), *pinned)[:, 0]

    def _set_linear(self) -> None:
        """Rows of bounds on derivatives: as functions of all control points, and their squares."""
        n = self.shape.joints
        held = [limit for limit in self.limits if limit.order]
        linear = self.shape.linear(tuple(limit.order for limit in held))
        self._linear_all, self._linear_first, self._linear_joint, self._linear_local = linear
        counts = [len(self.shape.sites[limit.order - 1]) for limit in held]
        self.order = np.repeat([limit.order for limit in held], np.array(counts, dtype=int) * n)
        bounds = [np.tile(1 / limit.bound, count) for count, limit in zip(counts, held, strict=True)]
        self._per = np.concatenate([np.zeros(0), *bounds])

    def _set_hot(self) -> None:
        """What is limited at nodes."""
        held = [limit for limit in self.limits if limit.scale.size]
        self._hot_scale = np.concatenate([np.zeros(0), *(limit.scale for limit in held)])
        one = [np.full(limit.scale.size, limit.one_sided) for limit in held]
        self._hot_one = np.concatenate([np.zeros(0, dtype=bool), *one])
        always = [np.full(limit.scale.size, limit.everywhere) for limit in held]
        self._hot_always = np.concatenate([np.zeros(0, dtype=bool), *always])
        self._limited = Batch(self._nodes.limited, len(self._u)) if len(self._hot_scale) else None

    def at(self, points: np.ndarray, duration: float, via_u: np.ndarray, far: float = np.inf) -> Point:
        """Everything at a curve; control points will go at most `far` [rad, m] next."""
        s, n = self.shape, self.shape.joints
        z = np.empty((len(self._u), 3 * n + 1))
        z[:, :-1] = (s.stacked @ points).reshape(len(z), -1)
        z[:, -1] = duration
        rate, slope = self._cost(z[self._quad], self._u[self._quad], self._values)
        cost = self.scale * (float(self._weight @ rate[:, 0]) - self.offset * duration)
        linear = self._per * (self._linear_all @ points.ravel()) / duration**self.order
        if self.goal is not None:
            cost += self.scale * float(np.diff(self.goal.work(np.stack([self.ends.goal, points[-1]])))[0])
        hot, hot_slope = np.zeros((len(z), 0)), np.zeros((len(z), 3 * n + 1, 0))
        if self._limited is not None:
            value, jac = self._limited(z, self._u, self._values)
            hot = value / self._hot_scale
            hot_slope = jac.reshape(len(z), -1, len(self._hot_scale)).copy()
        via = s.basis.matrix(via_u) @ points - self.ends.via if s.vias else np.zeros((0, n))
        along = np.zeros((0, n)) if self.goal is None else self.goal.along(points[-1])
        slope = self.scale * self._weight[:, None] * slope
        out = Point(points, duration, via_u, z, cost, slope, linear, hot, hot_slope, via, along)
        held: list[Limit] = list(self.limits)
        if self.clearance is not None:
            reach = min(self.clearance.reach, NEAREST + ARM * far)
            held.append(replace(self.clearance, reach=reach))
        for number, limit in enumerate(held):
            rows = limit.places(lambda u: self._matrix(u) @ points)
            if rows is not None:
                q = self._matrix(rows.u) @ points
                out.placed.append((number, rows, q, rows.value(q)))
        return out

    def at_curve(self, curve: Curve, far: float = np.inf) -> Point:
        """Everything at a curve."""
        return self.at(curve.points, curve.duration, curve.via_u, far)

    def keeping(self, clearance: ClearanceConstraints | None) -> Self:
        """The same problem with other constraints between bodies."""
        out = copy(self)
        out.clearance = clearance
        return out

    def outcome(self, point: Point, iterations: int, converged: bool, status: str = "sqp") -> Outcome:
        """What a search came to."""
        curve = Curve(self.shape, point.points, point.duration, point.via_u)
        cost = point.cost / self.scale + self.offset * point.duration
        return Outcome(curve, cost, self.excess(point), converged, status, iterations)

    def _matrix(self, u: np.ndarray) -> np.ndarray:
        """The basis at places, the last of which are kept."""
        key = u.tobytes()
        if self._at_places[0] != key:
            self._at_places = key, self.shape.basis.matrix(u)
        return self._at_places[1]

    def moved(self, point: Point, d: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
        """Control points, duration and via times after a step."""
        s, n = self.shape, self.shape.joints
        points = point.points.copy()
        points[s.pinned : len(points) - s.pinned] += d[: s.size].reshape(-1, n)
        duration, border = point.duration, d[s.size :]
        if not self.fixed:
            duration = float(np.clip(duration + border[0], *self.durations))
            points += (duration - point.duration) * self._pinned_slope
        if self.goal is not None:
            step = border[self.toward] @ point.along
            points[-s.pinned :] += step
            points += self._carried[:, None] * (self.goal.reached(point.points[-1], step) - points[-1])
        return points, duration, np.clip(point.via_u + border[len(border) - s.vias :], 0, 1)

    def broken(self, point: Point, give: float, slack: float) -> float:
        """The sum of all excesses: of shares of bounds beyond `give`, of numeric constraints beyond `slack`."""
        out = float(np.maximum(np.abs(point.linear) - 1 - give, 0).sum())
        out += float(np.maximum(np.where(self._hot_one, point.hot, np.abs(point.hot)) - 1 - give, 0).sum())
        out += float(np.abs(point.via).sum())
        for _, rows, _, value in point.placed:
            out += float(np.maximum(np.maximum(rows.lower - value, value - rows.upper) - slack, 0).sum())
        return out

    def deepest(self, point: Point) -> float:
        """The largest excess of a numeric row, in its own unit."""
        parts = (np.maximum(rows.lower - value, value - rows.upper) for _, rows, _, value in point.placed)
        return max((float(part.max(initial=0.0)) for part in parts), default=0.0)

    def excess(self, point: Point) -> float:
        """The worst excess over a limit's bound, clearances aside; and by how much a via point is missed."""
        out = [float(np.abs(point.linear).max(initial=0)) - 1, float(np.abs(point.via).max(initial=0))]
        out.append(float(np.where(self._hot_one, point.hot, np.abs(point.hot)).max(initial=0)) - 1)
        return max(out)

    def gradient(self, point: Point) -> np.ndarray:
        """Of the cost, (N + k,)."""
        s, n = self.shape, self.shape.joints
        by_node = point.slope[:, :-1].reshape(-1, n)
        out = np.zeros(s.size + self.border)
        out[: s.size] = (self._down @ by_node).ravel()
        if not self.fixed:
            pinned = 0.0 if self._still else float(np.sum((self._down_all @ by_node) * self._pinned_slope))
            out[s.size] = point.slope[:, -1].sum() + pinned
        if self.goal is not None:
            out[s.size :][self.toward] = point.along @ self._by_goal(point)
        assert s.vias == 0 or self.border
        return out

    def _by_goal(self, point: Point) -> np.ndarray:
        """The cost's gradient (n,) by the goal, the free control points held."""
        assert self.goal is not None
        n, q = self.shape.joints, point.points[-1]
        steps = DIFFERENCE * np.eye(n)
        plus, minus = self.goal.work(np.vstack([q + steps, q - steps])).reshape(2, n)
        work = self.scale * (plus - minus) / (2 * DIFFERENCE)
        return work + self._goal_z[self._quad].ravel() @ point.slope[:, :-1].reshape(-1, n)

    def hot_share(self, point: Point) -> np.ndarray:
        """Shares of bounds at nodes as far as they count, (nodes, columns)."""
        return np.where(self._hot_one, point.hot, np.abs(point.hot))

    def linear_after(self, point: Point, d: np.ndarray) -> np.ndarray:
        """Signed shares of bounds of derivatives after a step."""
        points, duration, _ = self.moved(point, d)
        return np.asarray(self._per * (self._linear_all @ points.ravel()) / duration**self.order)
