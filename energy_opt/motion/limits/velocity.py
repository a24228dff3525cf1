"""Joint velocity: |v_j| <= V_j. Along a path v = q' sqrt(b), so its square is linear in b."""

from __future__ import annotations

import numpy as np

from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Linear
from energy_opt.motion.limits.joint import JointLimit
from energy_opt.motion.path_dynamics import PathDynamics


class Velocity(JointLimit):
    """Bounds (n,) [rad/s]."""

    name, unit, order = "velocity", "rad/s", 1
    squared = True

    def of(self, x: Dense) -> np.ndarray:
        return x.v

    def linear(self, d: PathDynamics, b: float) -> Linear:
        none = np.zeros_like(d.q1)
        return Linear(none, (d.q1 / self.bound) ** 2, none)

    def use(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return d.q1**2 * b[:, None] / self.bound**2
