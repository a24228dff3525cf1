"""Standard moves as a nonlinear program: via points, spans, ramps and rises in, energy and limits out.

Unknowns x = (P_1 ... P_K, L_1 ... L_{K+1}, tau_0 ... tau_{K+1}, u_0 ... u_{K+1}) of a `chain.Chain`. Energy is
integrated by Gauss-Lobatto nodes in every polynomial piece, where motor torque is limited too; the node functions are
those of reshaping, at T = 1. With z_k(x), weight h_k(x), time t_k(x), rate e, its gradient g and Hessian C,

    cost      sum_k h_k e_k
    gradient  sum_k (e_k dh_k + h_k (J_k^T g_k))
    Hessian   sum_k (h_k J_k^T C_k J_k + dh_k (J_k^T g_k)^T + (J_k^T g_k) dh_k^T + e_k d2h_k + h_k g_k d2z_k)

where the last two terms are one second derivative by CasADi, with e and h g held. Constraints, as shares of their
bound: speed on every line, acceleration and jerk of every ramp in closed form, other limited quantities at nodes;
pieces that do not overlap; and the duration. Positions need no constraints: the motion stays within the hull of its
corners, which have bounds.

Numeric constraints (see `limits.base.PlaceConstraints`) are distances between bodies at places of the motion. A place
stays at its share of its piece while the unknowns change. With J_k = dq_k/dx, a constraint's gradient g gives g^T J_k,
and a place's Hessian H gives J_k^T H J_k, plus the curvature of q_k itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from energy_opt.motion.limits.base import Limit, PlaceConstraints, box_of, values_of
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.numerics.batch import Batch
from energy_opt.profiles.chain import Chain

NODES = (4, 6, 4, 8)  # Gauss-Lobatto nodes of a rise, hold, fall and line, both ends included
SHARP = 0.002  # [s] rise of a trapezoid's acceleration: one step of a controller at 500 Hz
SHORTEST = 0.02  # [s] least duration of any ramp
APART = 1e-3  # [s] least length of a line and of a held acceleration: shorter pieces make their constraints inaccurate


class Placed:
    """The constraints of one limit at places of a chain (see the module).

    Args:
        constraints: values and derivatives by positions q (K, n). x: symbols of the unknowns. symbols: the chain in
            terms of x. chain: numbers, which determine each place's share of its piece.
    """

    def __init__(self, constraints: PlaceConstraints, x: ca.SX, symbols: Chain, chain: Chain) -> None:
        self.constraints = constraints
        pieces, shares = chain.places(constraints.u * chain.duration)
        q = ca.horzcat(*(symbols.at(int(piece), float(s))[0] for piece, s in zip(pieces, shares, strict=True)))
        pull = ca.SX.sym("pull", q.numel())
        slope = ca.densify(ca.jacobian(ca.vec(q), x))
        bent = ca.densify(ca.hessian(ca.dot(pull, ca.vec(q)), x)[0])
        self._position = ca.Function("position", [x], [ca.densify(q), slope])
        self._bent = ca.Function("bent", [x, pull], [bent])

    def move(self, x: np.ndarray) -> None:
        """Compute positions, values and gradients at unknowns x (N,)."""
        q, slope = self._position(x)
        self._x, self._q = x, np.asarray(q.full()).T.copy()
        self._slope = np.asarray(slope.full()).reshape(*self._q.shape, -1)  # (K, n, unknowns)
        self.value = self.constraints.value(self._q)
        self._gradient = self.constraints.gradient(self._q)

    def slopes(self) -> np.ndarray:
        """Derivatives (R, unknowns) of all constraints: the gradient by q times dq/dx of the place."""
        return np.asarray(np.matmul(self._gradient[:, None, :], self._slope[self.constraints.place])[:, 0])

    def hessian(self, multipliers: np.ndarray) -> np.ndarray:
        """The constraints' part of the Hessian of the Lagrangian, (unknowns, unknowns).

        With multipliers l, gradients g_r by q, and the Hessian H_k of place k: sum_k J_k^T H_k J_k + sum_r l_r g_r ·
        d2q/dx2.
        """
        h = self.constraints.hessian(self._q, multipliers)
        pull = np.zeros_like(self._q)
        np.add.at(pull, self.constraints.place, multipliers[:, None] * self._gradient)
        curved = np.einsum("kai,kab,kbj->ij", self._slope, h, self._slope, optimize=True)
        return np.asarray(curved + np.asarray(self._bent(self._x, pull.ravel()).full()))


def lobatto(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights (count,) of Gauss-Lobatto quadrature on [0, 1].

    It is exact for polynomials of degree 2 count - 3.
    """
    inner = np.polynomial.legendre.Legendre.basis(count - 1)
    x = np.concatenate([[-1.0], np.sort(inner.deriv().roots().real), [1.0]])
    return (x + 1) / 2, 1 / (count * (count - 1) * inner(x) ** 2)


class Program:
    """One program in the form that `ipopt.solve` takes.

    Args:
        vias: number of via points. smooth: rises are free (S-curve), else `SHARP` (trapezoid).
        ends: start and goal (n,); durations: bounds of the whole, s; parameters: the model's values.
        near: the chain at which the limits' numeric constraints are built; None: without them. `reach` [rad]: largest
            move of via points from there.

    Attributes:
        scale: factor of the cost.
    """

    def __init__(
        self,
        vias: int,
        smooth: bool,
        nodes: NodeFunctions,
        ends: tuple[np.ndarray, np.ndarray],
        limits: Sequence[Limit],
        parameters: np.ndarray,
        durations: tuple[float, float],
        near: Chain | None = None,
        reach: float = np.inf,
    ) -> None:
        self._vias, self._ends, self.scale = vias, ends, 1.0
        self._parameters = np.concatenate([parameters, values_of(limits)])
        n, k = len(ends[0]), vias
        self.size = n * k + 3 * k + 5
        x = ca.SX.sym("x", self.size)
        symbols = Chain.of(x, ends, k)
        ramps, rises = symbols.ramps, symbols.rises
        z, h, t = _nodes(symbols)
        self._count = z.shape[1]
        linear = [*(rest - APART for rest in symbols.rests), *(ramps[i] - 2 * rises[i] - APART for i in range(k + 2))]
        peaks = [change / (ramps[i] - rises[i]) for i, change in enumerate(symbols.changes)]
        # the largest values of each derivative
        largest = {1: symbols.lines, 2: peaks, 3: [peak / rises[i] for i, peak in enumerate(peaks)]}
        shares = [_bounded(y, limit.bound) for limit in limits if limit.order for y in largest[limit.order]]
        same = [ramps[0] - ramps[1], rises[0] - rises[1]] if k == 0 else []  # one move has one acceleration
        share = ca.vertcat(*shares)
        closed = ca.vertcat(*linear, symbols.duration, *same, share)
        low = [0.0] * len(linear) + [durations[0]] + [0.0] * len(same) + [-1.0] * share.numel()
        high = [np.inf] * len(linear) + [durations[1]] + [0.0] * len(same) + [1.0] * share.numel()
        bounds = np.concatenate([np.zeros(0), *(limit.scale for limit in limits)])
        lowest = [np.full(limit.scale.size, -np.inf if limit.one_sided else -1.0) for limit in limits]
        self._width, self._bounded = len(bounds), np.flatnonzero(np.isfinite(bounds))
        self._bounds = bounds[self._bounded]
        least_share = np.tile(np.concatenate(lowest)[self._bounded], self._count)
        asked = [] if near is None else [limit.places(near.along) for limit in limits]
        self.placed = [
            Placed(constraints, x, symbols, near)
            for constraints in asked
            if constraints is not None and near is not None
        ]
        self.row_bounds = (
            np.concatenate([low, least_share, *(placed.constraints.lower for placed in self.placed)]),
            np.concatenate([high, np.ones(len(least_share)), *(placed.constraints.upper for placed in self.placed)]),
        )
        low_corner, high_corner = (np.tile(side, k) for side in box_of(limits, n))
        if near is not None and self.placed:
            around = np.clip(near.corners[1:-1].ravel(), low_corner, high_corner)
            low_corner, high_corner = np.maximum(low_corner, around - reach), np.minimum(high_corner, around + reach)
        least = np.concatenate([np.full(k + 1, SHORTEST), np.full(k + 2, SHORTEST), np.full(k + 2, SHARP)])
        most = np.full(len(least), max(durations[1], SHORTEST))
        if not smooth:
            most[-(k + 2) :] = SHARP
        self.box = np.concatenate([low_corner, least]), np.concatenate([high_corner, most])

        jz, jh = ca.jacobian(ca.vec(z), x), ca.jacobian(h, x)
        pull, weight = ca.SX.sym("pull", z.numel()), ca.SX.sym("weight", h.numel())
        bent = ca.hessian(ca.dot(pull, ca.vec(z)) + ca.dot(weight, h), x)[0]
        lam = ca.SX.sym("lam", closed.numel())
        self._closed_count = closed.numel()
        self._place = ca.Function("place", [x], [ca.densify(y) for y in (z, h, t, jz, jh)])
        self._bent = ca.Function("bent", [x, pull, weight], [ca.densify(bent)])
        self._closed_of = ca.Function("closed", [x], [ca.densify(closed), ca.densify(ca.jacobian(closed, x))])
        self._closed_bent = ca.Function("closed_bent", [x, lam], [ca.densify(ca.hessian(ca.dot(lam, closed), x)[0])])
        self._cost, self._limited, self._curvature = (
            Batch(f, self._count) for f in (nodes.cost, nodes.limited, nodes.curvature)
        )
        self.jacobian_pattern = ca.Sparsity.dense(len(self.row_bounds[0]), self.size)
        self.hessian_pattern = ca.Sparsity.upper(self.size)
        self._at = b""

    def chain(self, x: np.ndarray) -> Chain:
        """The chain of unknowns x (N,): corners between the ends, then spans, ramps and rises."""
        n, k = len(self._ends[0]), self._vias
        corners = np.vstack([self._ends[0], x[: n * k].reshape(k, n), self._ends[1]])
        spans, ramps, rises = np.split(x[n * k :], [k + 1, 2 * k + 3])
        return Chain(corners, spans, ramps, rises)

    @staticmethod
    def unknowns(chain: Chain) -> np.ndarray:
        """The unknowns (N,) of a chain; the inverse of `chain`."""
        return np.concatenate([chain.corners[1:-1].ravel(), chain.spans, chain.ramps, chain.rises])

    def _move(self, x: np.ndarray) -> None:
        """Evaluate all nodes at x, once for all functions that use them."""
        key = x.tobytes()
        if key == self._at:
            return
        self._at = key
        z, h, t, jz, jh = (np.asarray(y.full()) for y in self._place(x))
        self._z, self._t = z.T.copy(), t.reshape(-1, 1)
        self._h, self._jh = h.ravel(), jh
        self._jz = jz.reshape(self._count, -1, self.size)
        rate, slope = self._cost(self._z, self._t, self._parameters)
        self._e, self._g = rate[:, 0].copy(), slope.copy()
        values, jac = self._limited(self._z, self._t, self._parameters)
        self._values = values.copy()
        self._values_z = jac.reshape(self._count, -1, self._width).copy()
        self._pulled = np.matmul(self._g[:, None, :], self._jz)[:, 0]  # J_k^T g_k
        closed, slope_closed = self._closed_of(x)
        self._closed, self._closed_x = np.asarray(closed.full()).ravel(), np.asarray(slope_closed.full())
        for placed in self.placed:
            placed.move(x)

    def cost(self, x: np.ndarray) -> float:
        """Energy at unknowns x (N,), scaled, without the work that depends only on the ends."""
        self._move(x)
        return self.scale * float(self._h @ self._e)

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """The cost's gradient (unknowns,), see the module."""
        self._move(x)
        return self.scale * np.asarray(self._e @ self._jh + self._h @ self._pulled)

    def constraints(self, x: np.ndarray) -> np.ndarray:
        """All constraints (R,): closed forms, shares of bounds at nodes, and numeric constraints."""
        self._move(x)
        held = (self._values[:, self._bounded] / self._bounds).ravel()
        return np.concatenate([self._closed, held, *(placed.value for placed in self.placed)])

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Derivatives of the constraints by all unknowns x (N,), column by column."""
        self._move(x)
        slope = self._values_z[:, :, self._bounded] / self._bounds
        at_nodes = np.matmul(slope.transpose(0, 2, 1), self._jz).reshape(-1, self.size)
        by_place = [placed.slopes() for placed in self.placed]
        return np.vstack([self._closed_x, at_nodes, *by_place]).T.ravel()  # CasADi's order: by columns

    def hessian(self, x: np.ndarray, factor: float, multipliers: np.ndarray) -> np.ndarray:
        """Upper triangle of the Hessian of `factor` times the cost plus the multipliers times the constraints.

        Args:
            x: (N,) unknowns. factor: of the cost. multipliers: (R,) of the constraints.
        """
        self._move(x)
        s = self.scale * factor
        ends = np.cumsum([self._closed_count, self._count * len(self._bounded), *(len(p.value) for p in self.placed)])
        closed, held, *by_place = np.split(multipliers, ends[:-1])
        lam = np.zeros((self._count, self._width))
        lam[:, self._bounded] = held.reshape(self._count, -1) / self._bounds
        (blocks,) = self._curvature(self._z, self._t, self._parameters, (s * self._h)[:, None], lam)
        nz = self._z.shape[1]
        core = np.matmul(blocks.reshape(self._count, nz, nz), self._jz)
        out = np.einsum("kzi,kzj->ij", self._jz, core, optimize=True)
        cross = s * self._jh.T @ self._pulled
        pull = s * self._h[:, None] * self._g + np.einsum("kzj,kj->kz", self._values_z, lam)
        out += cross + cross.T
        out += np.asarray(self._bent(x, pull.ravel(), s * self._e).full())
        out += np.asarray(self._closed_bent(x, closed).full())
        for placed, part in zip(self.placed, by_place, strict=True):
            out += placed.hessian(part)
        return np.concatenate([out[: j + 1, j] for j in range(self.size)])


def _bounded(values: ca.SX, bounds: np.ndarray) -> ca.SX:
    """Values as shares of their bounds; those without a bound are omitted."""
    finite = np.flatnonzero(np.isfinite(bounds))
    return values[finite.tolist()] / ca.DM(bounds[finite])


def _nodes(chain: Chain) -> tuple[ca.SX, ca.SX, ca.SX]:
    """z (3n + 1, M), weight (M,) and time (M,) of all quadrature nodes, piece by piece."""
    zs, hs, ts = [], [], []
    for piece in range(chain.count):
        for share, weight in zip(*lobatto(NODES[piece % 4]), strict=True):
            q, v, a, t = chain.at(piece, float(share))
            zs.append(ca.vertcat(q, v, a, 1.0))
            hs.append(weight * chain.length(piece))
            ts.append(t)
    return ca.horzcat(*zs), ca.vertcat(*hs), ca.vertcat(*ts)
