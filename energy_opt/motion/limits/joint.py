"""Limits of joints: position, and the magnitude of one value per joint: velocity, acceleration, jerk, effort.

Along a path, with a its path acceleration, b its squared speed and w = da/ds:

    velocity^2    q'^2 b
    acceleration  q' a + q'' b
    jerk          (q' w + 3 q'' a + q''' b) sqrt(b)
    effort        M a + C b + G, and every torque effect of the model: linear if these are affine in (a, b)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Self

import casadi as ca
import numpy as np

from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Fixed, Limit, Linear, State, Violation, worst_of
from energy_opt.motion.path import JointPath
from energy_opt.motion.path_dynamics import PathDynamics


class Position(Limit):
    """Bounds on positions.

    The excess is a fraction of the range (or in rad, for a joint without a range). If all control points of a spline
    are inside, the spline is inside everywhere.

    Args:
        lower, upper: (n,) [rad, m].
    """

    name, unit = "position", "rad"

    def __init__(self, lower: np.ndarray, upper: np.ndarray) -> None:
        self.lower, self.upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)

    def _excess(self, q: np.ndarray) -> np.ndarray:
        """Excess (..., n) of positions (..., n) beyond the nearer bound."""
        span = self.upper - self.lower
        return np.maximum(q - self.upper, self.lower - q) / np.where(np.isfinite(span), span, 1.0)

    def worst(self, x: Dense) -> Violation:
        """The position with the largest excess."""
        excess = self._excess(x.q)
        excess = np.where(np.isfinite(excess), excess, -1.0)
        k, j = np.unravel_index(int(np.argmax(excess)), excess.shape)
        value, lower, upper = float(x.q[k, j]), float(self.lower[j]), float(self.upper[j])
        bound = upper if upper - value < value - lower else lower
        return Violation(self.name, float(excess[k, j]), x.joints[j], float(x.time[k]), value, bound)

    def fixed(self, d: PathDynamics) -> Fixed:
        """The excess of the path's positions, which no timing changes."""

        def text(k: int, j: int) -> str:
            unit = d.robot.units[j]
            q, low, high = d.q[k, j], self.lower[j], self.upper[j]
            beyond = f"{max(q - high, low - q):.2g} {unit}"
            return f"position {q:.6g} {unit} is {beyond} outside [{low:.6g}, {high:.6g}] {unit}"

        return Fixed(self._excess(d.q), text)

    def box(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """The bounds themselves, (n,) each."""
        return self.lower, self.upper


class JointLimit(Limit):
    """|value_j| <= bound_j (n,) for every joint; inf: no bound.

    Attributes:
        reads: name of the value on a motion's dense grid.
    """

    reads: ClassVar[str]

    def __init__(self, bound: np.ndarray) -> None:
        self.bound = np.asarray(bound, dtype=float)

    def worst(self, x: Dense) -> Violation:
        """The largest |value| / bound - 1."""
        value = getattr(x, self.reads)
        return worst_of(self, x, value, self.bound, np.abs(value) / self.bound - 1)

    def scaled(self, share: float | np.ndarray) -> Self:
        """The limit with bounds times `share`, for all joints or (n,)."""
        return type(self)(self.bound * share)


class Velocity(JointLimit):
    """Bounds (n,) [rad/s]."""

    name, unit, order, reads = "velocity", "rad/s", 1, "v"
    squared = True

    def linear(self, d: PathDynamics, b: float) -> Linear:
        """v^2 / bound^2 = (q' / bound)^2 b <= 1."""
        none = np.zeros_like(d.q1)
        return Linear(none, (d.q1 / self.bound) ** 2, none)


class Acceleration(JointLimit):
    """Bounds (n,) [rad/s^2]."""

    name, unit, order, reads = "acceleration", "rad/s^2", 2, "a"

    def linear(self, d: PathDynamics, b: float) -> Linear:
        """|q' a + q'' b| / bound <= 1."""
        return Linear(d.q1 / self.bound, d.q2 / self.bound, np.zeros_like(d.q1))


class Jerk(JointLimit):
    """Bounds (n,) [rad/s^3]."""

    name, unit, order, reads = "jerk", "rad/s^3", 3, "jerk"

    def functions(
        self, path: JointPath, s: np.ndarray
    ) -> Callable[[np.ndarray, np.ndarray, float], JerkAlongPath] | None:
        """The jerk along the path, (q' w + 3 q'' a + q''' b) sqrt(b).

        It is d/dt (q' a + q'' b) with ds/dt = sqrt(b), da/dt = w sqrt(b) and db/dt = 2 a sqrt(b).
        """
        if not np.isfinite(self.bound).any():
            return None
        factors = np.stack([3 * path(s, 2), path(s, 3), path(s, 1)]) / self.bound
        return lambda k, j, unit: JerkAlongPath(unit**1.5 * factors[:, k, j])


@dataclass(frozen=True)
class JerkAlongPath:
    """(k0 a + k1 b + k2 w) sqrt(b) of one joint at each of K points, in units of the bound; see `base.Functions`.

    Attributes:
        k: (3, K) coefficients.
    """

    k: np.ndarray  # (3, K)

    def value(self, z: np.ndarray) -> np.ndarray:
        """With l = k0 a + k1 b + k2 w: l sqrt(b), (K, 1)."""
        return ((self.k * z).sum(axis=0) * np.sqrt(z[1]))[:, None]

    def slope(self, z: np.ndarray) -> np.ndarray:
        """k sqrt(b), and for b in addition l / (2 sqrt(b)), (K, 1, 3)."""
        root = np.sqrt(z[1])
        slope = self.k * root
        slope[1] += (self.k * z).sum(axis=0) / (2 * root)
        return slope.T[:, None]

    def curvature(self, z: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """Nonzero second derivatives: ab k0 / (2 sqrt(b)), bb (2 k1 - l / (2 b)) / (2 sqrt(b)), bw k2 / (2 sqrt(b))."""
        k, none = self.k, np.zeros(z.shape[1])
        by_b = 2 * k[1] - (k * z).sum(axis=0) / (2 * z[1])
        return multipliers[:, 0] / (2 * np.sqrt(z[1])) * np.stack([none, k[0], by_b, none, k[2], none])


class Effort(JointLimit):
    """Bounds (n,) [N m] of the motors' torque at the joint side, with every torque effect of the model."""

    name, unit, reads = "effort", "N m", "effort"

    def __init__(self, bound: np.ndarray) -> None:
        super().__init__(bound)
        self.scale = self.bound

    def peaked(self, x: Dense) -> np.ndarray:
        """|effort| / bound, (N, n)."""
        return np.asarray(np.abs(x.effort) / self.bound)

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        """The motors' torque (n, 1)."""
        return x.effort

    def fixed(self, d: PathDynamics) -> Fixed:
        """Torque that moves the arm slowly along the path: gravity and dry friction."""
        none = np.zeros(len(d.s))
        held = np.abs(d.motor_torque(none, none))

        def text(k: int, j: int) -> str:
            unit = d.robot.unit("effort", d.robot.joints[j])
            what = "slow motion" if d.q1[k].any() else "holding still"
            return f"{what} needs {held[k, j]:.4g} {unit}, the limit is {self.bound[j]:.4g} {unit}"

        return Fixed(held / self.bound - 1, text, holding=True)

    def linear(self, d: PathDynamics, b: float) -> Linear | None:
        """The torque itself if it is affine in (a, b), else None."""
        return self.tangent(d, np.zeros(len(d.s)), np.full(len(d.s), b)) if d.affine(b) else None

    def tangent(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> Linear:
        """The torque to first order about (a, b)."""
        return Linear(*(x / self.bound for x in d.affine_torque(a, b)))

    def use(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """|torque| / bound by the exact laws, (M, n)."""
        return np.abs(d.motor_torque(a, b)) / self.bound
