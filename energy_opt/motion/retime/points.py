"""A retiming's cost and curved limits at all points at once, with their derivatives.

A model's law reduces to nine coefficients at each point if it has no other terms; otherwise the law itself is used.

z (d, M) is (a, b) at every point (and w = da/ds for jerk), in the program's unit. Hessians are upper triangles, column
by column: (aa, ab, bb) or (aa, ab, bb, aw, bw, ww).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from energy_opt.motion.limits.base import Limit
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.motion.retime.sums import (
    DEGREES,
    NARROW,
    AlongPath,
    LimitByStructure,
    Tangents,
    compressed,
    general_terms,
    law_function,
    limit_terms,
    point_numbers,
)
from energy_opt.numerics.batch import Batch
from energy_opt.power import PowerModel
from energy_opt.power.structure import SharedByStructure


class Cost(Protocol):
    """A sum over the points."""

    def value(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """The sum and its gradient (2, M)."""

    def curvature(self, z: np.ndarray) -> np.ndarray:
        """The Hessian of the sum at every point, (3, M)."""


@dataclass(frozen=True)
class Monomials:
    """Sum of weight / sqrt(b) P with P = k . (1, a, b, a^2, a b, b^2, sqrt(b), a sqrt(b), b sqrt(b)).

    With u = b^(-1/2) and Q the first six of the monomials, P / sqrt(b) = Q u + k6 + k7 a + k8 b.
    """

    k: np.ndarray  # (9, M)
    weight: np.ndarray  # (M,)

    def _parts(self, z: np.ndarray) -> tuple[np.ndarray, ...]:
        """u, Q, dQ/da, dQ/db."""
        (a, b), k = z, self.k
        half_a, half_b = k[1] + k[3] * a, k[2] + k[4] * a + k[5] * b
        return 1 / np.sqrt(b), k[0] + a * half_a + b * half_b, half_a + k[3] * a + k[4] * b, half_b + k[5] * b

    def value(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """The sum and its gradient (2, M). With u = b^(-1/2), du/db = -u^3 / 2: d(Q u)/db = (Q_b - Q u^2 / 2) u."""
        u, q, qa, qb = self._parts(z)
        k = self.k
        cost = float(self.weight @ (q * u + k[6] + k[7] * z[0] + k[8] * z[1]))
        return cost, self.weight * np.stack([qa * u + k[7], (qb - 0.5 * q * u * u) * u + k[8]])

    def curvature(self, z: np.ndarray) -> np.ndarray:
        """Second derivatives of Q u at every point, (aa, ab, bb): Q_aa u; (Q_ab - Q_a u^2 / 2) u;
        (Q_bb - Q_b u^2 + 3/4 Q u^4) u.
        """
        u, q, qa, qb = self._parts(z)
        k, u2 = self.k, u * u
        hessian = np.stack([2 * k[3], k[4] - 0.5 * qa * u2, 2 * k[5] - qb * u2 + 0.75 * q * u2 * u2])
        return self.weight * u * hessian


class AnyLaw:
    """Sum of weight / sqrt(b) (energy P + time) by the model's law, its kinks smoothed.

    Newton's method crosses a narrow kink r = sqrt(x^2 + d^2) in many short steps, because its slope x / r is far from
    linear. So the slope is an unknown s of its own, with r s = x, and both equations are linearised (T. F. Chan, G. H.
    Golub, P. Mulet, A nonlinear primal-dual method for total variation-based image restoration, SIAM Journal on
    Scientific Computing 20, 1999): the second derivative at x becomes (1 - s x / r) / r, and a step to x' takes s to
    (x + (1 - s x / r) (x' - x)) / r, within [-1, 1].

    Args:
        at: (N, M) the law's input. weight: (M,). shared: (values + 4,) numbers that all points share.
    """

    def __init__(
        self, shared_by: SharedByStructure, n: int, at: np.ndarray, weight: np.ndarray, shared: np.ndarray
    ) -> None:
        numbers, functions = np.vstack([at, weight]).T, general_terms(shared_by, n)
        self._terms, self._kinks, self._hessian = (
            Batch(f, len(weight)).fixing(k, numbers, shared) for k, f in zip((1, 1, 2), functions, strict=True)
        )
        self._last: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # x, r, s where the Hessian was last wanted

    def value(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """The sum and its gradient (2, M) at z (2, M)."""
        cost, slope = self._terms(z.T)
        return float(cost.sum()), slope.T.copy()

    def curvature(self, z: np.ndarray) -> np.ndarray:
        """The Hessian (3, M) at every point; that of kinks depends on where it was last computed."""
        x, d = (out.copy() for out in self._kinks(z.T))
        r = np.sqrt(x * x + d * d)
        s = x / r
        if self._last is not None:
            x0, r0, s0 = self._last
            s = np.clip((x0 + (1 - s0 * x0 / r0) * (x - x0)) / r0, -1, 1)
        self._last = x, r, s
        return self._hessian(z.T, (1 - s * x / r) / r)[0].T.copy()


@dataclass(frozen=True)
class Symbolic:
    """A limit's symbolic constraints at each point by the model's law, times `scale`; see limits.base.Functions."""

    batches: tuple[Batch, Batch]
    scale: np.ndarray  # (K, m)

    @classmethod
    def of(
        cls, shared_by: SharedByStructure, n: int, limit: Limit, at: np.ndarray, shared: np.ndarray, scale: np.ndarray
    ) -> Symbolic:
        """The constraints of a limit at K points.

        Args:
            n: number of joints. at: (N, K) the law's input.
            shared: numbers that all points share: the model's values, unit, width and the limit's values.
            scale: (K, m) factors that bring the constraints to [-1, 1].
        """
        functions = limit_terms(shared_by, n, LimitByStructure(limit))
        value, curvature = (Batch(f, len(scale)).fixing(k, at.T, shared) for k, f in enumerate(functions, start=1))
        return cls((value, curvature), scale)

    def value(self, z: np.ndarray) -> np.ndarray:
        """(K, m)."""
        return self.batches[0](z.T)[0] * self.scale

    def slope(self, z: np.ndarray) -> np.ndarray:
        """(K, m, 2)."""
        count, m = self.scale.shape
        by_column = self.batches[0](z.T)[1].reshape(count, 2, m)
        return by_column.transpose(0, 2, 1) * self.scale[:, :, None]

    def curvature(self, z: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """Upper triangles of the Hessians for given multipliers, (3, K)."""
        return self.batches[1](z.T, multipliers * self.scale)[0].T.copy()


@dataclass(frozen=True)
class PathLaw:
    """The law at points (M,) of a path.

    Attributes:
        joints: their number n. numbers: (N, M) the law's input at each point.
        unit: unit of squared speed [1/s^2] of the coefficients.
        coefficients: (9, M) of the power's monomials; None if the law has other terms, such as kinks.
    """

    shared_by: SharedByStructure
    joints: int
    numbers: np.ndarray
    unit: float
    coefficients: np.ndarray | None

    @classmethod
    def of(cls, model: PowerModel, dynamics: PathDynamics, unit: float, time: np.ndarray) -> PathLaw:
        """At the points of `dynamics`, which are passed at `time` (M,) [s]; `unit` of squared speed [1/s^2]."""
        numbers, n = point_numbers(dynamics, time), dynamics.robot.n
        shared = np.append(model.values(n), [unit, NARROW])
        shared_by = SharedByStructure.on(dynamics.robot, model)
        return cls(shared_by, n, numbers, unit, compressed(shared_by, n, numbers, shared))

    def cost(self, weight: np.ndarray, unit: float, energy: float, time: float, width: float) -> Cost:
        """Sum over points of weight / sqrt(b) (energy P + time).

        Args:
            weight: (M,) quadrature weights. unit: of a and b [1/s^2].
            energy, time: factors of power and of one second.
            width: factor of the widths of smoothed kinks.
        """
        if self.coefficients is None:
            shared = np.append(self.shared_by.model.values(self.joints), [unit, width, energy, time])
            return AnyLaw(self.shared_by, self.joints, self.numbers, weight, shared)
        k = energy * self.coefficients * (unit / self.unit) ** DEGREES[:, None]
        k[0] += time
        return Monomials(k, weight)

    def smoothing(self, z: np.ndarray, unit: float, weight: np.ndarray) -> float:
        """The error [J] of a bound by smoothed kinks: the law with the exact kinks' supporting lines minus the smoothed
        law.

        At z = (a, b) (2, M) in `unit`.
        """
        shared = np.append(self.shared_by.model.values(self.joints), [unit, NARROW])
        values = np.repeat(shared[:, None], z.shape[1], axis=1)
        lines, smooth = (
            np.array(law_function(self.shared_by, self.joints, form)(z, self.numbers, values)[0]).ravel()
            for form in (Tangents, AlongPath)
        )
        return float((weight / np.sqrt(unit * z[1])) @ (lines - smooth))
