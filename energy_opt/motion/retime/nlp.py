"""The nonlinear program of a retiming, for IPOPT.

    minimise    sum over points of weight / sqrt(b) (energy_factor P(a, b) + time_factor)
    over        b's free control values, within their bounds
    subject to  T / T_ref <= 1 (or = 1) where `timed`, and the limits at the places where a solve broke them

Derivatives are exact and sparse: point functions give value, gradient and Hessian in (a, b), and constant maps carry
them to the control values (the Hessian has two off-diagonals, because each interval depends on three control values).

Without the constraint on T, which is curved, and with linear limits, IPOPT's iterates stay feasible. With it, full
steps may trade its slack against the cost in a cycle of hundreds of iterations.

Each limit at such a place is a constraint |value| <= 1 in units of the bound, on three neighbouring control values.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from energy_opt.motion.limits.base import Functions
from energy_opt.motion.retime.points import Cost
from energy_opt.motion.retime.quadrature import Band, Lift, gathered
from energy_opt.numerics import ipopt


@dataclass(frozen=True)
class LinearConstraints:
    """ra a + rb b + r0 at one place each (K,): speed, acceleration, and torque if it is affine.

    Its bound of 1 is kept a little tighter than the true limit, which is `allowed` (K,) >= 1.
    """

    lift: Lift  # of (a, b)
    ra: np.ndarray
    rb: np.ndarray
    r0: np.ndarray
    allowed: np.ndarray

    @property
    def first(self) -> np.ndarray:
        """(K,) the first of the three control values that each constraint depends on."""
        return self.lift.first

    @cached_property
    def entries(self) -> np.ndarray:
        """(K, 3) the constraints' coefficients of these control values."""
        return self.ra[:, None] * self.lift.maps[0] + self.rb[:, None] * self.lift.maps[1]

    def values(self, control: np.ndarray) -> np.ndarray:
        """(K,) for control values (N + 2,), ends included."""
        return np.einsum("mk,mk->m", self.entries, control[self.lift.touched]) + self.r0

    def slopes(self, control: np.ndarray) -> np.ndarray:
        """(K, 3) derivatives with respect to the control values that each constraint depends on."""
        return self.entries

    def hessian(self, control: np.ndarray, multipliers: np.ndarray) -> np.ndarray | float:
        """Sum of the constraints' Hessians times `multipliers` (K,), in the form of `Band`."""
        return 0.0

    def adjoint(self, multipliers: np.ndarray) -> np.ndarray:
        """Sum of the constraints' gradients times `multipliers` (K,), with respect to the free control values."""
        return gathered(self.first, self.entries * multipliers[:, None], self.lift.count)


@dataclass(frozen=True)
class CurvedConstraints:
    """Limits that are not linear in (a, b) or (a, b, w): `each` of them at every place of `lift`, |value| <= 1.

    `one_sided`: value <= 1 alone.
    """

    lift: Lift
    functions: Functions
    each: int
    one_sided: bool = False

    @cached_property
    def first(self) -> np.ndarray:
        """(count,) the first of the three control values that each constraint depends on."""
        return np.repeat(self.lift.first, self.each)

    def values(self, control: np.ndarray) -> np.ndarray:
        """Values (count,) of the constraints at control values (N + 2,)."""
        return self.functions.value(self.lift.values(control)).ravel()

    def slopes(self, control: np.ndarray) -> np.ndarray:
        """Derivatives (count, 3) by the three control values of each constraint."""
        slope = self.functions.slope(self.lift.values(control))
        return np.einsum("mrd,dmk->mrk", slope, self.lift.maps).reshape(-1, 3)

    def hessian(self, control: np.ndarray, multipliers: np.ndarray) -> np.ndarray | float:
        """Sum of the constraints' Hessians times multipliers (count,), in the form of `Lift.hessian`."""
        z = self.lift.values(control)
        return self.lift.hessian(self.functions.curvature(z, multipliers.reshape(-1, self.each)))


@dataclass(frozen=True)
class PathConstraints:
    """All limits in force, the linear ones first."""

    linear: LinearConstraints | None = None
    curved: tuple[CurvedConstraints, ...] = ()

    @cached_property
    def blocks(self) -> tuple[LinearConstraints | CurvedConstraints, ...]:
        """The linear constraints, if any, then the curved ones."""
        return self.curved if self.linear is None else (self.linear, *self.curved)

    @cached_property
    def first(self) -> np.ndarray:
        """(count,) the first of the three control values that each constraint depends on."""
        return np.concatenate([np.zeros(0, dtype=int), *(block.first for block in self.blocks)])

    @property
    def count(self) -> int:
        """Number of constraints."""
        return len(self.first)

    @property
    def lower(self) -> np.ndarray:
        """Lower bounds (count,)."""
        least = [
            (-np.inf if isinstance(b, CurvedConstraints) and b.one_sided else -1.0, len(b.first)) for b in self.blocks
        ]
        return np.concatenate([np.zeros(0), *(np.full(count, side) for side, count in least)])

    def values(self, control: np.ndarray) -> np.ndarray:
        """(count,)."""
        return np.concatenate([np.zeros(0), *(block.values(control) for block in self.blocks)])

    def slopes(self, control: np.ndarray) -> np.ndarray:
        """(count, 3) derivatives with respect to the control values that each constraint depends on."""
        return np.concatenate([np.zeros((0, 3)), *(block.slopes(control) for block in self.blocks)])

    def hessian(self, control: np.ndarray, multipliers: np.ndarray) -> np.ndarray | float:
        """Sum of the constraints' Hessians times `multipliers` (count,), in the form of `Band`."""
        total: np.ndarray | float = 0.0
        used = 0
        for block in self.blocks:
            total = total + block.hessian(control, multipliers[used : used + len(block.first)])
            used += len(block.first)
        return total


OPTIONS: dict[str, object] = {
    "tol": 1e-7,  # relative to a cost of order one
    "max_iter": 200,
    "bound_relax_factor": 0.0,
    "fast_step_computation": "yes",
}
# Most retimings converge with large steps of the barrier parameter; otherwise it is reduced slowly.
LEAP: dict[str, object] = {
    "mu_init": 1e-2,
    "mu_linear_decrease_factor": 0.01,
    "mu_superlinear_decrease_power": 1.9,
    "barrier_tol_factor": 1e3,
    "max_iter": 80,
}
CREEP: dict[str, object] = {"mu_init": 1e-2}
NEAR: dict[str, object] = {"mu_init": 1e-4}


@dataclass(frozen=True)
class Values:
    """Cost, T / T_ref (`time`), their gradients (N,) with respect to the free control values, and constraints (K,)."""

    cost: float
    slope: np.ndarray
    time: float
    time_slope: np.ndarray
    constraints: np.ndarray


class RetimeProgram:
    """One move's program, in its unit of squared speed; see ipopt.Problem.

    Args:
        lift: to (a, b) at the grid's points.
        weight: (M,) quadrature weights.
        cost: sum over the points.
        ends: (2,) first and last control value, the squared end speeds.
        reference: T_ref, in the program's unit of time.
        constraints: those of the limits in force.
        timed: False leaves out the constraint on T.
    """

    def __init__(
        self,
        lift: Lift,
        weight: np.ndarray,
        cost: Cost,
        ends: np.ndarray,
        reference: float,
        constraints: PathConstraints,
        timed: bool = True,
    ) -> None:
        self.lift, self.points, self.held_constraints, self._timed = lift, cost, constraints, int(timed)
        self._pace, self._ends = weight / reference, ends
        self.band = Band(lift.count - 2)
        self.hessian_pattern = self.band.pattern
        self._at = b""
        n, first = lift.count - 2, constraints.first
        row = np.concatenate([np.zeros(timed * n, dtype=int), np.repeat(timed + np.arange(len(first)), 3)])
        column = np.concatenate([np.arange(timed * n), (first[:, None] + np.arange(3) - 1).ravel()])
        order = np.lexsort((row, column))
        self._order = order[(column[order] >= 0) & (column[order] < n)]
        starts = np.searchsorted(column[self._order], np.arange(n + 1))
        self.jacobian_pattern = ca.Sparsity(timed + len(first), n, starts.tolist(), row[self._order].tolist())

    def control(self, x: np.ndarray) -> np.ndarray:
        """All control values (N + 2,), ends included, of the free ones x (N,)."""
        return np.concatenate([self._ends[:1], x, self._ends[1:]])

    def at(self, x: np.ndarray) -> Values:
        """Cost, time and constraints at the free control values x (N,); the last evaluation is cached."""
        key = x.tobytes()
        if key != self._at:
            self._at = key
            self._control = self.control(x)
            self._z = self.lift.values(self._control)
            cost, slope = self.points.value(self._z)
            b = self._z[1]
            self._share = self._pace / np.sqrt(b)
            by_z = np.zeros_like(self._z)
            by_z[1] = -0.5 * self._share / b
            time, constraints = float(self._share.sum()), self.held_constraints.values(self._control)
            self._values = Values(cost, self.lift.adjoint(slope), time, self.lift.adjoint(by_z), constraints)
        return self._values

    def cost(self, x: np.ndarray) -> float:
        """The cost at free control values x (N,)."""
        return self.at(x).cost

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """The cost's gradient (N,)."""
        return self.at(x).slope

    def constraints(self, x: np.ndarray) -> np.ndarray:
        """T / T_ref where `timed`, then the constraints of the limits, at the free control values x (N,)."""
        here = self.at(x)
        return np.concatenate([[here.time] * self._timed, here.constraints])

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Derivatives of the constraints, in the order of the sparsity pattern."""
        slope = self.at(x).time_slope
        return np.concatenate([slope[: self._timed * len(x)], self.held_constraints.slopes(self._control).ravel()])[
            self._order
        ]

    def hessian(self, x: np.ndarray, factor: float, multipliers: np.ndarray) -> np.ndarray:
        """Entries of the Hessian of factor cost + multipliers . constraints, in the order of the sparsity pattern."""
        of_time = np.zeros(1 - self._timed)
        return self.banded_hessian(x, factor, np.concatenate([of_time, multipliers]))[self.band.inside]

    def banded_hessian(self, x: np.ndarray, factor: float, multipliers: np.ndarray) -> np.ndarray:
        """The Hessian (3 N,) of factor cost + multipliers . constraints, in the form of `Band`.

        Args:
            x: (N,) free control values. multipliers: of T / T_ref (0 if it is not constrained), then of the limits.
        """
        self.at(x)
        at_points = factor * self.points.curvature(self._z)
        at_points[2] += multipliers[0] * 0.75 * self._share / (self._z[1] * self._z[1])
        return self.lift.hessian(at_points) + self.held_constraints.hessian(self._control, multipliers[1:])

    def solve(
        self,
        start: np.ndarray,
        bounds: tuple[np.ndarray, np.ndarray],
        *,
        exactly: bool = False,
        near: bool = False,
    ) -> ipopt.Answer:
        """Solve from `start` (N,) with control values within `bounds`.

        The first constraint multiplier is that of T / T_ref, 0 without this constraint.

        Args:
            bounds: lowest and highest free control values, (N,) each.
            exactly: T = T_ref instead of T <= T_ref.
            near: the start is close to the answer.
        """
        lower = self.held_constraints.lower
        least_time = [1.0 if exactly else -np.inf] * self._timed
        row_bounds = np.append(least_time, lower), np.ones(self._timed + len(lower))
        start = np.clip(start, *bounds)
        used = 0
        # without the constraint on T, a cost that hardly depends on T leads IPOPT to ever longer T: no second attempt;
        # nor close to the answer, where a slow barrier did not help
        for preset in (NEAR,) if near else (LEAP, CREEP)[: 1 + self._timed]:
            options = {**OPTIONS, **preset}
            answer = ipopt.solve(self, start, bounds, row_bounds, options)
            used += answer.iterations
            if answer.success:
                break
        of_time = np.zeros(1 - self._timed)
        return replace(answer, iterations=used, row_multipliers=np.concatenate([of_time, answer.row_multipliers]))
