"""IPOPT on a model's problem, from the result of sequential quadratic programming.

The unknowns are steps from that curve. Cost, constraints and derivatives are the model's; a constraint on the k-th
derivative is stated at its nearer bound, so that its Hessian has no entry but that of T:

    s A x / (b T_0^k) - (T / T_0)^k <= 0        s: sign of the bound, T_0: initial duration of the curve
"""

from __future__ import annotations

from copy import copy

import casadi as ca
import numpy as np

from energy_opt.motion.reshape.curve import Curve, Outcome
from energy_opt.motion.reshape.evaluation import Point
from energy_opt.motion.reshape.model import VIA, Model
from energy_opt.motion.reshape.sqp import box
from energy_opt.numerics import ipopt
from energy_opt.numerics.quadratic import Constraints

BARRIER, TOLERANCE = 1e-6, 1e-6  # first barrier parameter, and the tolerance
ITERATIONS = 500  # most of all rounds; with 160, 3 of 10 moves with the tool on a line ended without convergence
# excess share at which a limit becomes a constraint, and share at which others are added with it
BROKEN, NEAR = 1e-7, 0.7
# [rad, m] largest move of control points in a round, so that limits that are not held are not exceeded by much
LOCAL = 0.3


class PolishProgram:
    """The problem in the form that `ipopt.solve` takes.

    Args:
        side: (L,) 1 or -1 if a derivative's constraint is held at that bound, else 0.
        hot: (nodes, columns) constraints at nodes that are held.
    """

    def __init__(self, model: Model, point: Point, side: np.ndarray, hot: np.ndarray) -> None:
        self.model, self._begin, self._side, self._hot = model, point, side, hot
        self._held = side != 0
        self._key, self._now = b"", point
        size, total = model.shape.size, model.shape.size + model.border
        self._linear = int(self._held.sum())
        both = self._constraints(point)
        via = np.flatnonzero(both.keys % 4 == VIA)  # a via point's window moves with its time
        row, column, _ = both.entries(size)
        row, column = (x[(column >= 0) & ~np.isin(row, via)] for x in (row, column))
        row = np.concatenate([row, np.repeat(via, total)])
        column = np.concatenate([column, np.tile(np.arange(total), len(via))])
        order = np.lexsort((row, column))
        self._entries = row[order], column[order]
        at = row[order].tolist(), column[order].tolist()
        self.jacobian_pattern = ca.Sparsity.triplet(both.count, total, *at)
        c, o = np.indices((size, min(model.shape.width, size))).reshape(2, -1)
        used = c + o < size
        self._band = c[used], o[used]
        edge, corner = np.indices((size, model.border)).reshape(2, -1), np.triu_indices(model.border)
        self._corner = corner
        row = np.concatenate([c[used], edge[0], size + corner[0]])
        column = np.concatenate([(c + o)[used], size + edge[1], size + corner[1]])
        self._sorted = np.lexsort((row, column))
        at = row[self._sorted].tolist(), column[self._sorted].tolist()
        self.hessian_pattern = ca.Sparsity.triplet(total, total, *at)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of all constraints, (R,) each, in the order of `constraints`."""
        begin = self._begin
        held = self.model.other_constraints(begin, np.inf, self._hot).joined(self.model.via_constraints(begin))
        value = self._values(self._begin)[self._linear :]
        none = np.zeros(self._linear)
        return np.concatenate([none - np.inf, held.floor + value]), np.concatenate([none, held.ceiling + value])

    def at(self, x: np.ndarray) -> Point:
        """Evaluate steps x; the last evaluation is cached."""
        key = x.tobytes()
        if key != self._key:
            self._key, self._now = key, self.model.at(*self.model.moved(self._begin, x))
        return self._now

    def cost(self, x: np.ndarray) -> float:
        """The model's cost at steps x from the curve."""
        return self.at(x).cost

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """The cost's gradient (N + k,) at steps x (N + k,)."""
        return self.model.gradient(self.at(x))

    def constraints(self, x: np.ndarray) -> np.ndarray:
        """Values (R,) of the held constraints: derivatives, limits at nodes, via points, places."""
        return self._values(self.at(x))

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Derivatives of the held constraints, in the order of the sparsity pattern."""
        point = self.at(x)
        held = self._constraints(point)
        factor = np.concatenate([self._side[self._held] * self._stretch(point), np.ones(held.count - self._linear)])
        value = np.asarray(held.sparse(self.model.shape.size)[self._entries]).ravel()
        return np.asarray(value * factor[self._entries[0]])

    def hessian(self, x: np.ndarray, factor: float, multipliers: np.ndarray) -> np.ndarray:
        """Entries of the Hessian of factor cost + multipliers . constraints, in the order of the sparsity pattern."""
        point, model = self.at(x), copy(self.model)
        model.scale *= factor
        lam = multipliers.copy()
        lam[: self._linear] *= self._side[self._held] * self._stretch(point)
        h = model.hessian(point, model.multipliers(point, self._constraints(point).keys, lam))
        return np.concatenate([h.band[self._band], h.border.ravel(), h.corner[self._corner]])[self._sorted]

    def _stretch(self, point: Point) -> np.ndarray:
        """(T / T_0)^k of the held constraints on derivatives."""
        return (point.duration / self._begin.duration) ** self.model.order[self._held]

    def _constraints(self, point: Point) -> Constraints:
        linear = self.model.linear_constraints(point, self._held, self._side)
        others = self.model.other_constraints(point, np.inf, self._hot)
        return linear.joined(others).joined(self.model.via_constraints(point))

    def _values(self, point: Point) -> np.ndarray:
        """All constraints' values, those on derivatives first."""
        linear = (self._side * point.linear)[self._held] - 1
        placed = [value for *_, value in point.placed]
        return np.concatenate([self._stretch(point) * linear, point.hot[self._hot], point.via.ravel(), *placed])


def _in_order(point: Point, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest step that leave via points in order: at most half of the time to the next one."""
    half, count = np.diff(point.via_u) / 2, len(point.via_u)
    if count > 1:
        low[1 - count :] = np.maximum(low[1 - count :], -half)
        high[-count:-1] = np.minimum(high[-count:-1], half)
    return low, high


def polished(model: Model, curve: Curve) -> Outcome:
    """The optimum near a curve, by IPOPT.

    Few limits bind, so only those near their bounds become constraints. After a solve that breaks another one, it is
    added, and the problem is solved again from there.
    """
    point, spent = model.at_curve(curve), 0
    side, hot = np.where(np.abs(point.linear) > NEAR, np.sign(point.linear), 0.0), model.hot(point, NEAR)
    while True:
        program = PolishProgram(model, point, side, hot)
        options: dict[str, object] = {"tol": TOLERANCE, "max_iter": ITERATIONS - spent, "mu_init": BARRIER}
        none = np.zeros(model.shape.size + model.border)
        answer = ipopt.solve(program, none, _in_order(point, *box(model, point, LOCAL)), program.bounds, options)
        point, spent = program.at(answer.x), spent + answer.iterations
        beyond = np.abs(point.linear) > 1 + BROKEN
        new = (beyond & (side != np.sign(point.linear))).any() or (~hot & model.hot(point, 1 + BROKEN)).any()
        if not new or spent >= ITERATIONS:
            break
        side = np.where(np.abs(point.linear) > NEAR, np.sign(point.linear), side)
        hot = hot | model.hot(point, NEAR)
    return model.outcome(point, spent, answer.success, answer.status)
