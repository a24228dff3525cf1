"""Joint jerk: |j_j| <= J_j. Along a path it is (q' w + 3 q'' a + q''' b) sqrt(b) with w = da/ds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.joint import JointLimit
from energy_opt.motion.path import JointPath


class Jerk(JointLimit):
    """Bounds (n,) [rad/s^3]."""

    name, unit, order = "jerk", "rad/s^3", 3

    def of(self, x: Dense) -> np.ndarray:
        return x.jerk

    def functions(self, path: JointPath, s: np.ndarray) -> Callable[[np.ndarray, np.ndarray], JerkAlongPath] | None:
        if not np.isfinite(self.bound).any():
            return None
        factors = np.stack([3 * path(s, 2), path(s, 3), path(s, 1)]) / self.bound
        return lambda k, j: JerkAlongPath(factors[:, k, j])


@dataclass(frozen=True)
class JerkAlongPath:
    """(k0 a + k1 b + k2 w) sqrt(b) of one joint at each point; see base.Functions."""

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
