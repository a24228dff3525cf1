"""What a retiming's cost and its curved limits are at all points at once, with their derivatives.

z (d, M) is (a, b) at every point (and w = da/ds for jerk), in the program's unit. Hessians are upper triangles, column
by column: (aa, ab, bb) or (aa, ab, bb, aw, bw, ww).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from energy_opt.motion.retime.terms import general_terms, torque_terms
from energy_opt.motion.timing.path_dynamics import SharedByStructure
from energy_opt.numerics.batch import Batch


class Cost(Protocol):
    """A sum over the points."""

    def value(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """The sum and its gradient (2, M)."""

    def curvature(self, z: np.ndarray) -> np.ndarray:
        """Its Hessian at every point, (3, M)."""


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
        u, q, qa, qb = self._parts(z)
        k = self.k
        cost = float(self.weight @ (q * u + k[6] + k[7] * z[0] + k[8] * z[1]))
        return cost, self.weight * np.stack([qa * u + k[7], (qb - 0.5 * q * u * u) * u + k[8]])

    def curvature(self, z: np.ndarray) -> np.ndarray:
        u, q, qa, qb = self._parts(z)
        k, u2 = self.k, u * u
        bent = np.stack([2 * k[3], k[4] - 0.5 * qa * u2, 2 * k[5] - qb * u2 + 0.75 * q * u2 * u2])
        return self.weight * u * bent


@dataclass(frozen=True)
class AnyLaw:
    """Sum of weight / sqrt(b) (energy P + time) by the model's law, its kinks smoothed."""

    batches: tuple[Batch, Batch]
    at: np.ndarray  # (M, 6 n + 2) what the law is given at each point, and the weight
    shared: np.ndarray  # (M, values + 4) the model's values, unit, blur, energy, time

    @classmethod
    def of(cls, shared_by: SharedByStructure, n: int, at: np.ndarray, weight: np.ndarray, shared: np.ndarray) -> AnyLaw:
        """From the law's numbers `at` (6 n + 1, M), and the numbers (values + 4,) that all points share."""
        count = len(weight)
        numbers = np.ascontiguousarray(np.vstack([at, weight]).T)
        terms = general_terms(shared_by, n)
        batches = Batch(terms.value, count), Batch(terms.curvature, count)
        return cls(batches, numbers, np.tile(shared, (count, 1)))

    def value(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        cost, slope = self.batches[0](z.T, self.at, self.shared)
        return float(cost.sum()), slope.T.copy()

    def curvature(self, z: np.ndarray) -> np.ndarray:
        return self.batches[1](z.T, self.at, self.shared)[0].T.copy()


class Curved(Protocol):
    """Functions of z at K points, r of them at each, in units of their bounds."""

    def value(self, z: np.ndarray) -> np.ndarray:
        """(K, r)."""

    def slope(self, z: np.ndarray) -> np.ndarray:
        """(K, r, d)."""

    def curvature(self, z: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """Sum of the functions' Hessians times multipliers (K, r), (d (d + 1) / 2, K)."""


@dataclass(frozen=True)
class Jerk:
    """(k0 a + k1 b + k2 w) sqrt(b) of one joint at each point."""

    k: np.ndarray  # (3, K)

    def value(self, z: np.ndarray) -> np.ndarray:
        return ((self.k * z).sum(axis=0) * np.sqrt(z[1]))[:, None]

    def slope(self, z: np.ndarray) -> np.ndarray:
        root = np.sqrt(z[1])
        slope = self.k * root
        slope[1] += (self.k * z).sum(axis=0) / (2 * root)
        return slope.T[:, None]

    def curvature(self, z: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        k, none = self.k, np.zeros(z.shape[1])
        by_b = 2 * k[1] - (k * z).sum(axis=0) / (2 * z[1])
        return multipliers[:, 0] / (2 * np.sqrt(z[1])) * np.stack([none, k[0], by_b, none, k[2], none])


@dataclass(frozen=True)
class Torque:
    """Motor torque of every joint at each point by the model's law, times `scale`."""

    batches: tuple[Batch, Batch]
    at: np.ndarray  # (K, 6 n + 1)
    shared: np.ndarray  # (K, values + 2) the model's values, unit, blur
    scale: np.ndarray  # (K, n)

    @classmethod
    def of(cls, shared_by: SharedByStructure, at: np.ndarray, shared: np.ndarray, scale: np.ndarray) -> Torque:
        """From the law's numbers `at` (6 n + 1, K) and those (values + 2,) that all points share."""
        count, n = scale.shape
        numbers = np.ascontiguousarray(at.T)
        value, curvature = torque_terms(shared_by, n)
        batches = Batch(value, count), Batch(curvature, count)
        return cls(batches, numbers, np.tile(shared, (count, 1)), scale)

    def value(self, z: np.ndarray) -> np.ndarray:
        return self.batches[0](z.T, self.at, self.shared)[0] * self.scale

    def slope(self, z: np.ndarray) -> np.ndarray:
        count, n = self.scale.shape
        by_column = self.batches[0](z.T, self.at, self.shared)[1].reshape(count, 2, n)
        return by_column.transpose(0, 2, 1) * self.scale[:, :, None]

    def curvature(self, z: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        return self.batches[1](z.T, self.at, self.shared, multipliers * self.scale)[0].T.copy()
