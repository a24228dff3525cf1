"""A reshaping problem at a curve: cost, gradient, shares of limits, and nearby bodies.

Unknowns are the free control points, point by point; then T, unless it is given, the steps of the ends along their
free directions, and the via points' times.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from energy_opt.motion.limits.base import Limit, PlaceConstraints, box_of, values_of
from energy_opt.motion.limits.clearance import ClearanceConstraints
from energy_opt.motion.reshape.curve import Curve, Outcome
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.motion.reshape.open import FIXED, Open, Passed, passed
from energy_opt.numerics.batch import Batch
from energy_opt.numerics.quadratic import Constraints

# [m] bodies get constraints that are nearer than this and what they keep, and this much more for each rad that joints
# may turn
NEAREST, ARM = 0.006, 0.5
DIFFERENCE = 1e-5  # [rad, m] step of the difference quotient of an end's work


@dataclass
class Point:
    """A curve and its evaluation at all K nodes, of which Q have a quadrature weight.

    Attributes:
        points, duration, via_u: the curve, see `Curve`.
        z: (K, 3 n + 1) variables of the nodes: q, q', q'', T.
        cost: scaled, and without `offset` times T if T is given.
        slope: (Q, 3 n + 1) derivatives of the cost with respect to z.
        linear: (L,) control points of derivatives as signed shares of their bounds.
        hot: (K, m) limited quantities at nodes as signed shares of their bounds.
        used: (L + K m,) shares of both, without sign for limits with two sides.
        hot_slope: (K, 3 n + 1, m) their derivatives with respect to z, in their own units.
        via: (vias, n) [rad, m] errors at via points. passed: bounds of the step there.
        along: (directions, n) tangents of the ends that may move.
        placed: of each limit with numeric constraints: its number, the constraints, positions (P, n) of its places, and
            values (R,).
    """

    points: np.ndarray
    duration: float
    via_u: np.ndarray
    z: np.ndarray
    cost: float
    slope: np.ndarray
    linear: np.ndarray
    hot: np.ndarray
    used: np.ndarray
    hot_slope: np.ndarray
    via: np.ndarray
    passed: list[Passed]
    along: np.ndarray
    placed: list[tuple[int, PlaceConstraints, np.ndarray, np.ndarray]] = field(default_factory=list)


class Evaluation:
    """One problem of a shape: ends, limits, the model's values and the bounds of T.

    Args:
        parameters: the model's values, in the order of `PowerModel.values`.
        durations: [s] least and largest T; T is given if they are equal.
        offset: cost per second that is the same for all paths (W for energy); it is left out of a point's cost if T is
            given, so that relative tolerances refer to what a path can change.
        width: factor of the widths of smoothed kinks.
        open_: ends and via points that may move on surfaces.
    """

    def __init__(
        self, shape: Shape, nodes: NodeFunctions, ends: Ends, limits: Sequence[Limit], parameters: np.ndarray,
        durations: tuple[float, float], offset: float = 0.0, width: float = 1.0, open_: Open = FIXED,
    ) -> None:  # fmt: skip
        s = self.shape = shape
        # `of`: for every direction in which an end may move, which of the moving ends it belongs to
        self.open, self.moving = open_, open_.ends
        self.of = np.repeat(np.arange(len(self.moving)), [surface.count for _, surface in self.moving]).astype(int)
        directions = len(self.of)
        self.ends, self.limits, self.scale = ends, tuple(limits), 1.0
        self.fixed = durations[0] == durations[1]
        self.durations = durations
        self.clearance: ClearanceConstraints | None = None
        self._constant: dict[float, Constraints] = {}  # constraints on derivatives at a fixed duration, for all copies
        self.offset = offset if self.fixed else 0.0
        self._at_places, self._none = (b"", np.zeros((0, 0))), np.zeros((0, s.joints))
        self._values = np.concatenate([parameters, values_of(limits, width)])
        u, w = s.grid
        self._quad, self._breaks = np.flatnonzero(w), np.flatnonzero(w == 0)
        # limits with numeric constraints, and their numbers
        self._at_curve = [(k, x) for k, x in enumerate(self.limits) if type(x).places is not Limit.places]
        self._weight, self._u, self._window = w[self._quad], u[:, None], s.window(u)
        self._quad_windows = self._windows_of(self._quad)
        self._cost = Batch(nodes.cost, len(self._quad)).fixing(1, self._u[self._quad], self._values)
        self._curvature = Batch(nodes.curvature, len(self._quad)).fixing(1, self._u[self._quad], self._values)
        self._nodes = nodes
        self.box = box_of(limits, s.joints)
        # unknowns behind the band of control points: T, steps of the ends, times of via points
        self.border = (0 if self.fixed else 1) + directions + s.vias
        self.toward = slice(self.border - s.vias - directions, self.border - s.vias)  # columns of the border
        self._set_linear()
        self._set_hot()
        # an end velocity v is v T per unit of u, so pinned control points change with T
        controls, n = s.basis.controls, s.joints
        self._pinned_slope = np.zeros((controls, n))  # d(control points)/dT
        self._pinned_slope[: s.pinned] = np.outer(s.end_slopes[0], ends.v_start)
        self._pinned_slope[controls - s.pinned :] = np.outer(s.end_slopes[1], ends.v_goal)
        self._still = not self._pinned_slope.any()
        self._z_slope = np.concatenate(
            [(s.stacked @ self._pinned_slope).reshape(len(u), -1), np.ones((len(u), 1))], axis=1
        )
        self._linear_slope = self._per * self._derivatives(self._pinned_slope)
        # from derivatives at the quadrature nodes down to control points: the free ones, and all
        stacked = s.stacked.reshape(len(u), 3, -1)[self._quad].reshape(3 * len(self._quad), -1)
        self._down = stacked.T[s.pinned : controls - s.pinned].copy()
        self._down_all = stacked.T.copy()
        # all pinned control points of an end move with it, so that those of its derivatives that are given stay
        self.share = np.zeros((len(self.moving), controls))  # share of each control point that moves with the end
        for k, (end, _) in enumerate(self.moving):
            self.share[k, : s.pinned] = 1.0 if end == 0 else 0.0
            self.share[k, controls - s.pinned :] = 0.0 if end == 0 else 1.0
        self.end_z = (self.share @ s.stacked.T).reshape(-1, len(u), 3)
        if self.moving:
            along = [[np.kron(site @ share[:, None], np.eye(n)) for site in self._sites] for share in self.share]
            none = np.zeros((0, n))
            self.end_linear = np.stack([self._per[:, None] * np.concatenate([none, *by_order]) for by_order in along])
            u = np.linspace(0, 1, 6 * controls)[:, None]  # the curve's response to an end's step off its tangent
            pinned = np.zeros((s.pinned, 1)), np.ones((s.pinned, 1))
            goal = s.basis.fit(u[:, 0], u**3 * (10 - 15 * u + 6 * u**2), *pinned)[:, 0]
            self._carried = [1 - goal if end == 0 else goal for end, _ in self.moving]

    def _windows_of(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Basis values (K, 3, 6) and windows (K,) of nodes."""
        return self.shape.local[nodes, :3], self._window[nodes]

    def _set_linear(self) -> None:
        """Set the constraints on derivatives as linear functions of all control points, and their bounds."""
        n = self.shape.joints
        held = [limit for limit in self.limits if limit.order]
        self._sites = [self.shape.sites[limit.order - 1] for limit in held]
        linear = self.shape.linear([limit.order for limit in held])
        self._linear_first, self._linear_joint, self._linear_local = linear
        counts = [len(self.shape.sites[limit.order - 1]) for limit in held]
        self.order = np.repeat([limit.order for limit in held], np.array(counts, dtype=int) * n)
        bounds = [np.tile(1 / limit.bound, count) for count, limit in zip(counts, held, strict=True)]
        self._per = np.concatenate([np.zeros(0), *bounds])
        self._by_time = 0.0, self._per
        self._site_rows = np.concatenate([np.zeros((0, self.shape.basis.controls)), *self._sites])

    def _derivatives(self, points: np.ndarray) -> np.ndarray:
        """Bounded derivatives (L,) of control points, times powers of T."""
        return (self._site_rows @ points).ravel()

    def _set_hot(self) -> None:
        """Set the limits at nodes."""
        held = [limit for limit in self.limits if limit.scale.size]
        self._hot_scale = np.concatenate([np.zeros(0), *(limit.scale for limit in held)])
        one = [np.full(limit.scale.size, limit.one_sided) for limit in held]
        self._hot_one = np.concatenate([np.zeros(0, dtype=bool), *one])
        always = [limit.everywhere & np.isfinite(limit.scale) for limit in held]
        self._hot_always = np.concatenate([np.zeros(0, dtype=bool), *always])
        limited = Batch(self._nodes.limited, len(self._u)) if len(self._hot_scale) else None
        self._limited = limited and limited.fixing(1, self._u, self._values)

    def at(self, points: np.ndarray, duration: float, via_u: np.ndarray, far: float = np.inf) -> Point:
        """Evaluate a curve.

        Args:
            points, duration, via_u: the curve, see `Curve`.
            far: [rad, m] most that control points will move next: it decides which pairs of bodies are measured.
        """
        s, n = self.shape, self.shape.joints
        z = np.empty((len(self._u), 3 * n + 1))
        z[:, :-1] = (s.stacked @ points).reshape(len(z), -1)
        z[:, -1] = duration
        rate, slope = self._cost(z[self._quad])
        cost = self.scale * (float(self._weight @ rate[:, 0]) - self.offset * duration)
        if self._by_time[0] != duration:
            self._by_time = duration, self._per / duration**self.order
        linear = self._by_time[1] * self._derivatives(points)
        for end, surface in self.moving:  # of the work of an end only the change counts
            before = self.ends.goal if end else self.ends.start
            cost += self.scale * self._sign(end) * float(np.diff(surface.work(np.stack([before, points[end]])))[0])
        if self._limited is None:
            hot, hot_slope = np.zeros((len(z), 0)), np.zeros((len(z), 3 * n + 1, 0))
        else:
            value, jac = self._limited(z)
            hot = value / self._hot_scale
            hot_slope = jac.reshape(len(z), -1, len(self._hot_scale)).copy()
        via = along = self._none
        bounds: list[Passed] = []
        if s.vias:
            via, bounds = passed(self.open, self.ends.via, s.basis.matrix(via_u) @ points)
        if self.moving:
            along = np.vstack([surface.along(points[end]) for end, surface in self.moving])
        slope = (self.scale * self._weight)[:, None] * slope
        used = np.concatenate([np.abs(linear), np.where(self._hot_one, hot, np.abs(hot)).ravel()])
        out = Point(points, duration, via_u, z, cost, slope, linear, hot, used, hot_slope, via, bounds, along)
        # numeric constraints are renewed at each curve; bodies out of reach of the next step get none
        held: list[tuple[int, Limit]] = list(self._at_curve)
        if self.clearance is not None:
            reach = min(self.clearance.reach, NEAREST + ARM * far)
            held.append((len(self.limits), replace(self.clearance, reach=reach)))
        for number, limit in held:
            constraints = limit.places(lambda u: self._matrix(u) @ points)
            if constraints is not None:
                q = self._matrix(constraints.u) @ points
                out.placed.append((number, constraints, q, constraints.value(q)))
        return out

    @staticmethod
    def _sign(end: int) -> float:
        """Sign of an end's work in the cost: positive at the goal, negative at the start."""
        return 1.0 if end else -1.0

    def at_curve(self, curve: Curve, far: float = np.inf) -> Point:
        """Evaluate a curve."""
        return self.at(curve.points, curve.duration, curve.via_u, far)

    def keeping(self, clearance: ClearanceConstraints | None) -> Self:
        """The same problem with other clearance constraints."""
        out = copy(self)
        out.clearance = clearance
        return out

    def scaled(self, scale: float) -> Self:
        """The same problem with its cost multiplied by another number."""
        out = copy(self)
        out.scale = scale
        return out

    def outcome(self, point: Point, iterations: int, converged: bool, status: str = "sqp") -> Outcome:
        """The outcome of a search that ended at a point, in the objective's unit and with all of its cost."""
        curve = Curve(self.shape, point.points, point.duration, point.via_u)
        cost = point.cost / self.scale + self.offset * point.duration
        return Outcome(curve, cost, self.excess(point), converged, status, iterations)

    def _matrix(self, u: np.ndarray) -> np.ndarray:
        """The basis at places u; the last one is cached."""
        key = u.tobytes()
        if self._at_places[0] != key:
            self._at_places = key, self.shape.basis.matrix(u)
        return self._at_places[1]

    def moved(self, point: Point, d: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
        """Control points, duration and via times after a step d (N + k,), in the order of the module's unknowns."""
        s, n = self.shape, self.shape.joints
        points = point.points.copy()
        points[s.pinned : len(points) - s.pinned] += d[: s.size].reshape(-1, n)
        duration, border = point.duration, d[s.size :]
        if not self.fixed:
            duration = float(np.clip(duration + border[0], *self.durations))
            points += (duration - point.duration) * self._pinned_slope
        for k, (end, surface) in enumerate(self.moving):
            step = border[self.toward][self.of == k] @ point.along[self.of == k]
            points += self.share[k][:, None] * step
            points += self._carried[k][:, None] * (surface.reached(point.points[end], step) - points[end])
        via_u = np.clip(point.via_u + border[len(border) - s.vias :], 0, 1) if s.vias else point.via_u
        return points, duration, via_u

    def passing(self, points: np.ndarray, via_u: np.ndarray) -> np.ndarray:
        """Control points of a curve that is moved so that it passes its via points at their times."""
        s = self.shape
        if not s.vias:
            return points
        q = s.basis.matrix(via_u) @ points
        off, _ = passed(self.open, self.ends.via, q)
        points = s.passing(points[None], via_u[None], q - off)[0]
        inner = slice(s.pinned, len(points) - s.pinned)
        points[inner] = np.clip(points[inner], *self.box)
        return points

    def broken(self, point: Point, give: float, slack: float) -> float:
        """The sum of all excesses, which the merit function prices.

        Args:
            give: share of a bound by which limits at nodes and control points may be exceeded without a price.
            slack: the same of numeric constraints, in their own unit. Errors at via points count in full.
        """
        out, count = 0.0, len(point.linear)
        if not point.used.max(initial=0.0) <= 1 + give:  # NaN counts as broken
            over = np.maximum(point.used - 1 - give, 0)
            out = float(over[:count].sum()) + float(over[count:].sum())
        out += float(np.abs(point.via).sum()) if point.via.size else 0.0
        for _, constraints, _, value in point.placed:
            out += float(np.maximum(np.maximum(constraints.lower - value, value - constraints.upper) - slack, 0).sum())
        return out

    def deepest(self, point: Point) -> float:
        """The largest excess of a numeric constraint, in its own unit."""
        parts = (
            np.maximum(constraints.lower - value, value - constraints.upper)
            for _, constraints, _, value in point.placed
        )
        return max((float(part.max(initial=0.0)) for part in parts), default=0.0)

    def excess(self, point: Point) -> float:
        """The worst excess over a limit's bound, without clearances, or the largest error at a via point."""
        return max(float(point.used.max(initial=0)) - 1, float(np.abs(point.via).max(initial=0)))

    def gradient(self, point: Point) -> np.ndarray:
        """The cost's gradient (N + k,): N coordinates of free control points, then the k unknowns behind them."""
        s, n = self.shape, self.shape.joints
        by_node = point.slope[:, :-1].reshape(-1, n)
        out = np.zeros(s.size + self.border)
        out[: s.size] = (self._down @ by_node).ravel()
        if not self.fixed:
            pinned = 0.0 if self._still else float(np.sum((self._down_all @ by_node) * self._pinned_slope))
            out[s.size] = point.slope[:, -1].sum() + pinned
        if self.moving:
            by_end = np.stack([self.by_end(point, k) for k in range(len(self.moving))])
            out[s.size :][self.toward] = np.sum(point.along * by_end[self.of], axis=1)
        return out

    def by_end(self, point: Point, k: int) -> np.ndarray:
        """The cost's gradient (n,) with respect to the k-th end that may move, the free control points held."""
        end, surface = self.moving[k]
        n, q = self.shape.joints, point.points[end]
        steps = DIFFERENCE * np.eye(n)
        plus, minus = surface.work(np.vstack([q + steps, q - steps])).reshape(2, n)
        work = self.scale * self._sign(end) * (plus - minus) / (2 * DIFFERENCE)
        return np.asarray(work + self.end_z[k][self._quad].ravel() @ point.slope[:, :-1].reshape(-1, n))
