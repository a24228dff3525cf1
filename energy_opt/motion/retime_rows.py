"""The limits that a retiming is held to at the places where a solve broke them: |value| <= 1, in units of the bound."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from energy_opt.motion.retime_grid import Lift, sparse
from energy_opt.motion.retime_terms import jerk_term


@dataclass(frozen=True)
class LinearRows:
    """ra a + rb b + r0 at one place each (K,): speed, acceleration, and torque where it is affine.

    Its bound of 1 is kept a little tighter than the true limit, which stands at `allowed` (K,) >= 1.
    """

    lift: Lift  # of (a, b)
    ra: np.ndarray
    rb: np.ndarray
    r0: np.ndarray
    allowed: np.ndarray

    @property
    def count(self) -> int:
        return len(self.ra)

    def matrix(self, ends: np.ndarray) -> tuple[ca.DM, np.ndarray]:
        """The rows as matrix (K, N) and constant (K,), for the free control values, those at the ends (2,) given."""
        entries = self.ra[:, None] * self.lift.maps[0] + self.rb[:, None] * self.lift.maps[1]
        columns = self.lift.first[:, None] + np.arange(3) - 1
        free = self.lift.count - 2
        rows = np.broadcast_to(np.arange(self.count)[:, None], columns.shape)
        given = np.where(columns == -1, entries * ends[0], 0) + np.where(columns == free, entries * ends[1], 0)
        return sparse(rows, columns, entries, (self.count, free)), self.r0 + given.sum(axis=1)


@dataclass(frozen=True)
class CurvedRows:
    """Limits that are not linear in (a, b) or (a, b, w), several at each place.

    Attributes:
        lift: of the point quantities z (d, K).
        value: (z, at) -> values (r, 1) and Jacobian (r, d).
        curvature: (z, at, multipliers (r, 1)) -> upper triangle of the Hessian.
        at: (size, K) what the functions are given beside z.
    """

    lift: Lift
    value: ca.Function
    curvature: ca.Function
    at: np.ndarray

    @property
    def count(self) -> int:
        return int(self.value.size1_out(0)) * self.at.shape[1]

    def parts(self, x: ca.MX, ends: np.ndarray, multiplier: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        """Values (count, 1), Jacobian and Hessian (upper triangle, multipliers applied) for free control values x."""
        places, each = self.at.shape[1], int(self.value.size1_out(0))
        z = ca.reshape(self.lift.matrix @ x + self.lift.ends @ ends, -1, places)
        value, jacobian = self.value.map(places)(z, self.at)
        pattern, assemble = self.lift.rows(each)
        bent = self.curvature.map(places)(z, self.at, ca.reshape(multiplier, each, places))
        shape, gather = self.lift.curvature
        return (
            ca.vec(value),
            ca.sparsity_cast(assemble @ ca.vec(jacobian), pattern),
            ca.sparsity_cast(gather @ ca.vec(bent), shape),
        )


def jerk_rows(lift: Lift, factors: np.ndarray) -> CurvedRows:
    """Jerk (k0 a + k1 b + k2 w) sqrt(b) of one joint at each place; `factors` (3, K) in units of its bound."""
    value, curvature = jerk_term()
    return CurvedRows(lift, value, curvature, factors)


@dataclass(frozen=True)
class Rows:
    """All limits in force, the linear ones first."""

    linear: LinearRows | None = None
    curved: tuple[CurvedRows, ...] = ()

    @property
    def count(self) -> int:
        """Number of constraints."""
        return (0 if self.linear is None else self.linear.count) + sum(rows.count for rows in self.curved)

    def parts(self, x: ca.MX, ends: np.ndarray, multiplier: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        """Values, Jacobian and Hessian of all of them."""
        values, jacobians, used = [], [], 0
        hessian = ca.MX(x.numel(), x.numel())
        if self.linear is not None:
            matrix, constant = self.linear.matrix(ends)
            values.append(matrix @ x + constant)
            jacobians.append(ca.MX(matrix))
            used = self.linear.count
        for rows in self.curved:
            value, jacobian, bent = rows.parts(x, ends, multiplier[used : used + rows.count])
            values.append(value)
            jacobians.append(jacobian)
            hessian = hessian + bent
            used += rows.count
        return ca.vertcat(*values), ca.vertcat(*jacobians), hessian
