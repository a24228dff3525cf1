"""The reshaping problem as a nonlinear program: control points in, energy and limits out, exact derivatives.

Unknowns x = (free control points, point by point; T; times of via points). At a node u_k, z_k = (q, q', q'', T) is
affine in x, z_k = L_k x + z0, and L_k touches only the six control points of the node's knot span and T. So with the
node functions' derivatives g_k and C_k

    gradient  sum_k w_k L_k^T g_k            Hessian  sum_k L_k^T C_k L_k

where L_k = (basis values) kron (identity over joints): both sums are small batched products, and the Hessian is banded
but for the row of T. Nothing is differentiated here. Rows, all as shares of their bound in [-1, 1]:

    q'_ij / (V_j T)    q''_ij / (A_j T^2)    q'''_ij / (J_j T^3)    tau_m,j(z_k) / tau_j
    via points: q(u_i) - Q_i = 0 at an unknown u_i

q'_ij is the i-th control point of joint j's derivative. A spline lies in the hull of its control points, so these rows
hold a limit everywhere, not at nodes only; and there is one of them for every degree of freedom, so that a limit which
is active along an arc gives independent rows.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.motion.reshape.layout import LOCAL, Ends, Pattern
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.numerics.batch import Batch

EFFORT = 4  # the kind of a torque row; kinds 1 to 3 are derivatives of position


class Program:
    """One nonlinear program in the form that `ipopt.solve` takes.

    Args:
        rows: (R, 3) integers: kind (1 velocity, 2 acceleration, 3 jerk, 4 effort), site (for effort: node), joint.
        bounds: (4, n) velocity, acceleration, jerk and effort limits that rows are shares of.
        parameters: the model's values; scale: what the cost is multiplied by.
        fixed: T is given; the solver then takes it for a constant, and the Hessian's column of T is left empty.
    """

    def __init__(
        self,
        pattern: Pattern,
        nodes: NodeFunctions,
        ends: Ends,
        rows: np.ndarray,
        bounds: np.ndarray,
        parameters: np.ndarray,
        scale: float,
        fixed: bool = False,
    ) -> None:
        s = self.shape = pattern.shape
        self.pattern, self.ends, self.parameters, self.scale = pattern, ends, parameters, scale
        self.fixed = fixed
        n = s.joints
        _, w = s.grid
        linear = rows[:, 0] != EFFORT
        rows = np.vstack([rows[linear], rows[~linear]])
        self._linear, self._effort = rows[: linear.sum()], rows[linear.sum() :]
        self._bounds = bounds[rows[:, 0] - 1, rows[:, 2]]
        self._hot = np.unique(self._effort[:, 1])
        self._needed = np.union1d(np.flatnonzero(w), self._hot)
        self._quad = np.flatnonzero(w)
        self._cost = Batch(nodes.cost, len(self._quad))
        self._curvature = Batch(nodes.curvature, len(self._needed))
        self._torque = Batch(nodes.torque, len(self._hot)) if len(self._hot) else None
        self._which = np.searchsorted(self._hot, self._effort[:, 1])
        self._scatter = pattern.scatter(self._needed)
        self._slope = np.zeros((s.basis.controls, n))  # d(control points)/dT, of the pinned ends
        self._slope[: s.pinned] = np.outer(s.end_slopes[0], ends.v_start)
        self._slope[s.basis.controls - s.pinned :] = np.outer(s.end_slopes[1], ends.v_goal)
        self._z_slope = np.stack([m @ self._slope for m in s.matrices], axis=1)  # (K, 4, n)
        kind, site, joint = self._linear.T
        self._coefficients = np.zeros((len(kind), LOCAL))  # of the touched control points, per unit of bound
        first = np.zeros(len(kind), dtype=int)
        for k in (1, 2, 3):
            here = kind == k
            start, local = s.site_local[k - 1]
            first[here], self._coefficients[here] = start[site[here]], local[site[here]]
        self._coefficients /= self._bounds[: len(kind), None]
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
        self._u = {"quad": u[self._quad, None], "hot": u[self._hot, None], "needed": u[needed, None]}
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
        """Number of rows."""
        return len(self._linear) + len(self._effort) + self.shape.joints * self.shape.vias

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
        # derivatives with respect to u that linear rows bound, as shares of their bounds at T = 1
        self._moved = np.einsum("rl,rl->r", self._coefficients, self._points[self._touched])
        rate, slope = self._cost(self._z[self._quad], self._u["quad"], self.parameters)
        self._f = self.scale * float(self._weight @ rate[:, 0])
        self._g = self.scale * self._weight[:, None] * slope
        if self._torque is not None:
            tau, jac = self._torque(self._z[self._hot], self._u["hot"], self.parameters)
            self._tau, self._tau_z = tau, jac.reshape(len(self._hot), -1, self.shape.joints)  # column-major: (z, joint)

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
        out = self._moved / self.duration ** self._linear[:, 0]
        if len(self._effort):
            tau = self._tau[self._which, self._effort[:, 2]] / self._bounds[len(out) :]
            out = np.concatenate([out, tau])
        if self.shape.vias:
            out = np.concatenate([out, (self._via(x, 0) - self.ends.via).ravel()])
        return out

    def _via(self, x: np.ndarray, order: int) -> np.ndarray:
        """q or its derivatives at the via times, (vias, n)."""
        return self.shape.basis.matrix(x[self.pattern.time + 1 :], order) @ self._points

    def _build_jacobian(self) -> None:
        """The Jacobian's pattern, and where each row's entries go: its six control points or all of a node's, and T."""
        s, n, t = self.shape, self.shape.joints, self.pattern.time
        linear, hot = len(self._linear), len(self._effort)
        touched = (self._row_index, self.pattern.index[self._effort[:, 1]])
        columns = [np.hstack([index, np.full((len(index), 1), t)]).ravel() for index in touched]
        rows = [np.repeat(np.arange(linear), LOCAL + 1), np.repeat(linear + np.arange(hot), LOCAL * n + 1)]
        base = linear + hot
        for i in range(s.vias):
            for j in range(n):
                columns.append(np.concatenate([np.arange(j, t, n), [t, t + 1 + i]]))
                rows.append(np.full(len(columns[-1]), base + i * n + j))
        flat_r, flat_c = np.concatenate(rows), np.concatenate(columns)
        self._kept = flat_c >= 0
        r, c = flat_r[self._kept], flat_c[self._kept]
        order = np.lexsort((r, c))
        self._order = order
        self.jacobian_pattern = ca.Sparsity.triplet(self.count, s.unknowns, r[order].tolist(), c[order].tolist())
        self.hessian_pattern = self.pattern.hessian

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        self._move(x)
        s, n, t = self.shape, self.shape.joints, self.duration
        kind = self._linear[:, 0]
        by_point = self._coefficients / (t**kind)[:, None]
        by_time = (self._row_slope - kind * self._moved / t) / t**kind
        parts = [np.concatenate([by_point, by_time[:, None]], axis=1).ravel()]
        if len(self._effort):
            slope = self._tau_z[self._which, :, self._effort[:, 2]] / self._bounds[len(kind) :, None]  # (R, nz)
            parts.append(self._through_nodes(slope, self._effort[:, 1]).ravel())
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
        """The Hessian's column of T, (controls n + 1,): that of the nodes (K, 6n + 1) and of the linear rows."""
        size, t, time = self.shape.unknowns, self.duration, self.pattern.time
        column = np.bincount(self._place, local[:, :-1][self._inside], size)
        column[time] = local[:, -1].sum()
        # b x / T^k has second derivatives -k b / T^(k+1) with (x, T) and k (k + 1) b x / T^(k+2) with T.
        if len(multipliers):
            kind = self._linear[:, 0]
            share = multipliers / t**kind
            cross = -(kind * share / t)[:, None] * self._coefficients
            column += np.bincount(self._row_place, cross[self._row_inside], size)
            column[time] += np.sum(share * kind * ((kind + 1) * self._moved / t - 2 * self._row_slope) / t)
        return column[: time + 1]

    def hessian(self, x: np.ndarray, factor: float, multipliers: np.ndarray) -> np.ndarray:
        self._move(x)
        s, n = self.shape, self.shape.joints
        needed, time = self._needed, self.pattern.time
        lam = np.zeros((len(s.grid[0]), n))
        first = len(self._linear)
        effort = slice(first, first + len(self._effort))
        np.add.at(lam, (self._effort[:, 1], self._effort[:, 2]), multipliers[effort] / self._bounds[effort])
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
        for i in range(s.vias):
            via = time + 1 + i
            first_via = first + len(self._effort) + i * n
            m = multipliers[first_via : first_via + n]
            basis = s.basis.matrix(x[via : via + 1], 1)[0]
            inner = slice(s.pinned, s.basis.controls - s.pinned)
            out[self.pattern.lookup[:time, via]] += np.outer(basis[inner], m).ravel()
            out[self.pattern.lookup[time, via]] += basis @ self._slope @ m
            out[self.pattern.lookup[via, via]] += (s.basis.matrix(x[via : via + 1], 2) @ self._points @ m)[0]
        return out
