"""The reshaping problem as a nonlinear program: control points in, energy and limits out, exact derivatives.

Unknowns x = (free control points, point by point; T; times of via points). At a node u_k, z_k = (q, q', q'', T) is
affine in x, z_k = L_k x + z0, and L_k touches only the six control points of the node's knot span and T. So with the
node functions' derivatives g_k and C_k

    gradient  sum_k w_k L_k^T g_k            Hessian  sum_k L_k^T C_k L_k

where L_k = (basis values) kron (identity over joints): both sums are small batched products, and the Hessian is banded
but for the row of T. Nothing is differentiated here. Constraints, those of a bound as shares of it:

    q^(k)_ij / (bound_j T^k)    control points of joint j's k-th derivative, in [-1, 1]
    g_j(z_k) / scale_j          what limits bound at nodes, in [-1, 1] or below 1
    f_r(q(u_r))                 numeric constraints at places of their own, within their bounds
    q(u_i) - Q_i                via points at unknown u_i, 0

q'_ij is the i-th control point of joint j's derivative. A spline lies in the hull of its control points, so these
constraints hold a limit everywhere, not at nodes only; and there is one of them for every degree of freedom, so that a
limit which is active along an arc gives independent constraints.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from energy_opt.motion.limits.base import Limit, PlaceRows
from energy_opt.motion.reshape.layout import LOCAL, Ends, Pattern
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.motion.reshape.places import Placed
from energy_opt.numerics.batch import Batch


class ReshapeProgram:
    """One nonlinear program in the form that `ipopt.solve` takes.

    Args:
        limits: what `rows` number.
        rows: (R, 3) integers: limit, site of its derivative's control polygon or node, joint or column.
        places: numeric constraints.
        parameters: the model's values and the limits'; scale: what the cost is multiplied by.
        fixed: T is given; the solver then takes it for a constant, and the Hessian's column of T is left empty.
    """

    def __init__(
        self,
        pattern: Pattern,
        nodes: NodeFunctions,
        ends: Ends,
        limits: Sequence[Limit],
        rows: np.ndarray,
        parameters: np.ndarray,
        scale: float,
        fixed: bool = False,
        places: Sequence[PlaceRows] = (),
    ) -> None:
        s = self.shape = pattern.shape
        self.pattern, self.ends, self.parameters, self.scale = pattern, ends, parameters, scale
        self.fixed = fixed
        n = s.joints
        _, w = s.grid
        orders = np.array([limit.order for limit in limits])
        linear = orders[rows[:, 0]] > 0
        self._linear, self._hot = rows[linear], rows[~linear]
        self._power = orders[self._linear[:, 0]]  # of 1 / T
        widths = [limit.scale.size for limit in limits]
        offsets = np.cumsum([0, *widths])[:-1]
        self._column = offsets[self._hot[:, 0]] + self._hot[:, 2]  # among the node functions' limited values
        self._bound = _picked([limit.bound for limit in limits], self._linear)
        self._hot_scale = _picked([limit.scale for limit in limits], self._hot)
        self._hot_lower = np.where(np.array([limit.one_sided for limit in limits])[self._hot[:, 0]], -np.inf, -1.0)
        self._width = sum(widths)
        self._hot_nodes = np.unique(self._hot[:, 1])
        self._needed = np.union1d(np.flatnonzero(w), self._hot_nodes)
        self._quad = np.flatnonzero(w)
        self._cost = Batch(nodes.cost, len(self._quad))
        self._curvature = Batch(nodes.curvature, len(self._needed))
        self._limited = Batch(nodes.limited, len(self._hot_nodes)) if len(self._hot_nodes) else None
        self._which = np.searchsorted(self._hot_nodes, self._hot[:, 1])
        self._scatter = pattern.scatter(pattern.index[self._needed])
        self._slope = np.zeros((s.basis.controls, n))  # d(control points)/dT, of the pinned ends
        self._slope[: s.pinned] = np.outer(s.end_slopes[0], ends.v_start)
        self._slope[s.basis.controls - s.pinned :] = np.outer(s.end_slopes[1], ends.v_goal)
        self._z_slope = np.stack([m @ self._slope for m in s.matrices], axis=1)  # (K, 4, n)
        self._placed = [Placed(place_rows, pattern, self._slope) for place_rows in places]
        _, site, joint = self._linear.T
        self._coefficients = np.zeros((len(site), LOCAL))  # of the touched control points, per unit of bound
        first = np.zeros(len(site), dtype=int)
        for k in (1, 2, 3):
            here = self._power == k
            start, local = s.site_local[k - 1]
            first[here], self._coefficients[here] = start[site[here]], local[site[here]]
        self._coefficients /= self._bound[:, None]
        touched = first[:, None] + np.arange(LOCAL)
        self._touched = touched, joint[:, None]
        inside = (touched >= s.pinned) & (touched < s.pinned + s.free)
        self._row_index = np.where(inside, (touched - s.pinned) * n + joint[:, None], -1)
        self._row_slope = np.sum(self._coefficients * self._slope[self._touched], axis=1)
        self._at = b""
        self._gather()
        self._build_jacobian()

    def _gather(self) -> None:
        """What every evaluation uses, gathered once."""
        s, needed = self.shape, self._needed
        u, w = s.grid
        self._u = {"quad": u[self._quad, None], "hot": u[self._hot_nodes, None], "needed": u[needed, None]}
        self._weight, self._needed_weight = w[self._quad], w[needed, None]
        self._z = np.empty((len(u), 3 * s.joints + 1))
        self._down = s.stacked.reshape(len(u), 3, -1)[self._quad].reshape(3 * len(self._quad), -1).T.copy()
        self._local = s.local[needed, :3]  # (K, 3, 6)
        self._local_t = self._local.transpose(0, 2, 1).copy()
        slope = self._z_slope[needed, :3].reshape(len(needed), -1)
        self._by_time = np.concatenate([slope, np.ones((len(needed), 1))], axis=1)  # dz/dT (K, 3n + 1)
        index = self.pattern.index[needed]
        self._inside = index >= 0
        self._place = index[self._inside]
        self._row_inside = self._row_index >= 0
        self._row_place = self._row_index[self._row_inside]

    @property
    def count(self) -> int:
        """Number of constraints."""
        return len(self._linear) + len(self._hot) + self._place_count + self.shape.joints * self.shape.vias

    @property
    def _place_count(self) -> int:
        return sum(len(placed.rows.place) for placed in self._placed)

    @property
    def row_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of all constraints, (count,) each."""
        one, none = np.ones(len(self._linear)), np.zeros(self.shape.joints * self.shape.vias)
        placed = [placed.rows for placed in self._placed]
        return (
            np.concatenate([-one, self._hot_lower, *(each.lower for each in placed), none]),
            np.concatenate([one, np.ones(len(self._hot)), *(each.upper for each in placed), none]),
        )

    def broken_places(self, x: np.ndarray) -> float:
        """By how much the numeric constraints leave their bounds at most; -inf where there are none."""
        self._move(x)
        found = ((placed.value, placed.rows) for placed in self._placed if placed.value.size)
        return max((float(np.max([r.lower - f, f - r.upper])) for f, r in found), default=-np.inf)

    def points(self, x: np.ndarray) -> np.ndarray:
        """All control points (controls, n)."""
        s, t = self.shape, x[self.pattern.time]
        out = t * self._slope
        out[: s.pinned] += self.ends.start
        out[s.basis.controls - s.pinned :] += self.ends.goal
        out[s.pinned : s.basis.controls - s.pinned] += x[: self.pattern.time].reshape(s.free, s.joints)
        return out

    def _move(self, x: np.ndarray) -> None:
        """Evaluate the curve at x, once for all functions that want it."""
        key = x.tobytes()
        if key == self._at:
            return
        self._at = key
        self.duration = float(x[self.pattern.time])
        self._points = self.points(x)
        self._z[:, :-1] = (self.shape.stacked @ self._points).reshape(len(self._z), -1)
        self._z[:, -1] = self.duration
        # derivatives with respect to u that linear constraints bound, as shares of their bounds at T = 1
        self._moved = np.einsum("rl,rl->r", self._coefficients, self._points[self._touched])
        rate, slope = self._cost(self._z[self._quad], self._u["quad"], self.parameters)
        self._f = self.scale * float(self._weight @ rate[:, 0])
        self._g = self.scale * self._weight[:, None] * slope
        if self._limited is not None:
            self._values, jac = self._limited(self._z[self._hot_nodes], self._u["hot"], self.parameters)
            self._values_z = jac.reshape(len(self._hot_nodes), -1, self._width)  # column-major: (z, column)
        for placed in self._placed:
            placed.move(self._points)

    def cost(self, x: np.ndarray) -> float:
        self._move(x)
        return self._f

    def gradient(self, x: np.ndarray) -> np.ndarray:
        self._move(x)
        s, n = self.shape, self.shape.joints
        out = np.zeros(s.unknowns)
        by_point = self._down @ self._g[:, :-1].reshape(-1, n)
        out[: self.pattern.time] = by_point[s.pinned : s.basis.controls - s.pinned].ravel()
        out[self.pattern.time] = self._g[:, -1].sum() + np.sum(by_point * self._slope)
        return out

    def rows(self, x: np.ndarray) -> np.ndarray:
        self._move(x)
        parts = [self._moved / self.duration**self._power]
        if len(self._hot):
            parts.append(self._values[self._which, self._column] / self._hot_scale)
        parts += [placed.value for placed in self._placed]
        if self.shape.vias:
            parts.append((self._via(x, 0) - self.ends.via).ravel())
        return np.concatenate(parts)

    def _via(self, x: np.ndarray, order: int) -> np.ndarray:
        """q or its derivatives at the via times, (vias, n)."""
        return self.shape.basis.matrix(x[self.pattern.time + 1 :], order) @ self._points

    def _build_jacobian(self) -> None:
        """The Jacobian's pattern, and where each row's entries go: its six control points or all of a node's, and T."""
        s, n, t = self.shape, self.shape.joints, self.pattern.time
        touched = [self._row_index, self.pattern.index[self._hot[:, 1]], *(placed.unknowns for placed in self._placed)]
        columns = [np.hstack([index, np.full((len(index), 1), t)]).ravel() for index in touched]
        at_row, base = [], 0
        for index in touched:
            at_row.append(np.repeat(base + np.arange(len(index)), index.shape[1] + 1))
            base += len(index)
        for i in range(s.vias):
            for j in range(n):
                columns.append(np.concatenate([np.arange(j, t, n), [t, t + 1 + i]]))
                at_row.append(np.full(len(columns[-1]), base + i * n + j))
        flat_r, flat_c = np.concatenate(at_row), np.concatenate(columns)
        self._kept = flat_c >= 0
        r, c = flat_r[self._kept], flat_c[self._kept]
        order = np.lexsort((r, c))
        self._order = order
        self.jacobian_pattern = ca.Sparsity.triplet(self.count, s.unknowns, r[order].tolist(), c[order].tolist())
        self.hessian_pattern = self.pattern.hessian

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        self._move(x)
        s, n, t = self.shape, self.shape.joints, self.duration
        order = self._power
        by_point = self._coefficients / (t**order)[:, None]
        by_time = (self._row_slope - order * self._moved / t) / t**order
        parts = [np.concatenate([by_point, by_time[:, None]], axis=1).ravel()]
        if len(self._hot):
            slope = self._values_z[self._which, :, self._column] / self._hot_scale[:, None]  # (R, nz)
            parts.append(self._through_nodes(slope, self._hot[:, 1]).ravel())
        parts += [placed.slopes().ravel() for placed in self._placed]
        if s.vias:
            basis = s.basis.matrix(x[self.pattern.time + 1 :])
            speed = self._via(x, 1)
            inner = slice(s.pinned, s.basis.controls - s.pinned)
            for i in range(s.vias):
                for j in range(n):
                    parts.append(basis[i, inner])
                    parts.append(np.array([basis[i] @ self._slope[:, j], speed[i, j]]))
        return np.concatenate(parts)[self._kept][self._order]

    def _through_nodes(self, slope: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """Row vectors d/dz (R, nz) at nodes -> d/d(touched control points, T), (R, 6n + 1)."""
        n = self.shape.joints
        parts = slope[:, :-1].reshape(-1, 3, n)
        by_point = np.einsum("rdi,rda->ria", self.shape.local[nodes, :3], parts).reshape(len(slope), -1)
        by_time = slope[:, -1] + np.sum(parts * self._z_slope[nodes, :3], axis=(1, 2))
        return np.concatenate([by_point, by_time[:, None]], axis=1)

    def _time_column(self, local: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """The Hessian's column of T, (controls n + 1,): that of the nodes (K, 6n + 1) and of the linear constraints."""
        size, t, time = self.shape.unknowns, self.duration, self.pattern.time
        column = np.bincount(self._place, local[:, :-1][self._inside], size)
        column[time] = local[:, -1].sum()
        # b x / T^k has second derivatives -k b / T^(k+1) with (x, T) and k (k + 1) b x / T^(k+2) with T.
        if len(multipliers):
            order = self._power
            share = multipliers / t**order
            cross = -(order * share / t)[:, None] * self._coefficients
            column += np.bincount(self._row_place, cross[self._row_inside], size)
            column[time] += np.sum(share * order * ((order + 1) * self._moved / t - 2 * self._row_slope) / t)
        return column[: time + 1]

    def hessian(self, x: np.ndarray, factor: float, multipliers: np.ndarray) -> np.ndarray:
        self._move(x)
        s, n = self.shape, self.shape.joints
        needed, time = self._needed, self.pattern.time
        lam = np.zeros((len(s.grid[0]), self._width))
        first = len(self._linear)
        used = first + len(self._hot)
        np.add.at(lam, (self._hot[:, 1], self._column), multipliers[first:used] / self._hot_scale)
        weight = self.scale * factor * self._needed_weight
        (blocks,) = self._curvature(self._z[needed], self._u["needed"], self.parameters, weight, lam[needed])
        nz, count = 3 * n + 1, len(needed)
        c = blocks.reshape(count, nz, nz)
        core = c[:, : 3 * n, : 3 * n].reshape(count, 3, n * 3 * n)
        half = np.matmul(self._local_t, core).reshape(count, LOCAL, n, 3, n)
        block = np.matmul(half.transpose(0, 1, 2, 4, 3), self._local[:, None, None])  # (K, 6, n, n, 6)
        out = self._scatter @ block.reshape(-1)
        if not self.fixed:
            local = self._through_nodes(np.matmul(c, self._by_time[:, :, None])[:, :, 0], needed)
            out[self.pattern.lookup[: time + 1, time]] += self._time_column(local, multipliers[:first])
        for placed in self._placed:
            share, column = placed.hessian(multipliers[used : used + len(placed.rows.place)])
            used += len(placed.rows.place)
            out += share
            if not self.fixed:
                out[self.pattern.lookup[: time + 1, time]] += column
        for i in range(s.vias):
            via = time + 1 + i
            m = multipliers[used + i * n : used + (i + 1) * n]
            basis = s.basis.matrix(x[via : via + 1], 1)[0]
            inner = slice(s.pinned, s.basis.controls - s.pinned)
            out[self.pattern.lookup[:time, via]] += np.outer(basis[inner], m).ravel()
            out[self.pattern.lookup[time, via]] += basis @ self._slope @ m
            out[self.pattern.lookup[via, via]] += (s.basis.matrix(x[via : via + 1], 2) @ self._points @ m)[0]
        return out


def _picked(bounds: Sequence[np.ndarray], rows: np.ndarray) -> np.ndarray:
    """The bound that belongs to each of the constraints (R, 3), of limits' bounds per joint or column."""
    out = np.zeros(len(rows))
    for number, bound in enumerate(bounds):
        here = rows[:, 0] == number
        if here.any():
            out[here] = bound[rows[here, 2]]
    return out
