"""Joint position: lower_j <= q_j <= upper_j. A spline whose control points are inside is inside everywhere."""

from __future__ import annotations

import numpy as np

from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Fixed, Limit, Violation
from energy_opt.motion.path_dynamics import PathDynamics


class Position(Limit):
    """Bounds (n,) [rad]; excess is a fraction of the range (in rad where there is none)."""

    name, unit = "position", "rad"

    def __init__(self, lower: np.ndarray, upper: np.ndarray) -> None:
        self.lower, self.upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)

    def _excess(self, q: np.ndarray) -> np.ndarray:
        span = self.upper - self.lower
        return np.maximum(q - self.upper, self.lower - q) / np.where(np.isfinite(span), span, 1.0)

    def worst(self, x: Dense) -> Violation:
        excess = self._excess(x.q)
        excess = np.where(np.isfinite(excess), excess, -1.0)
        k, j = np.unravel_index(int(np.argmax(excess)), excess.shape)
        value, lower, upper = float(x.q[k, j]), float(self.lower[j]), float(self.upper[j])
        bound = upper if upper - value < value - lower else lower
        return Violation(self.name, float(excess[k, j]), x.joints[j], float(x.time[k]), value, bound)

    def fixed(self, d: PathDynamics) -> Fixed:
        def text(k: int, j: int) -> str:
            unit = d.robot.units[j]
            return f"position {d.q[k, j]:.6g} {unit} is outside [{self.lower[j]:.6g}, {self.upper[j]:.6g}] {unit}"

        return Fixed(self._excess(d.q), text)

    def box(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        return self.lower, self.upper
