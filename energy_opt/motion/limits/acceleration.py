"""Joint acceleration: |a_j| <= A_j. Along a path it is q' a + q'' b."""

from __future__ import annotations

import numpy as np

from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Linear
from energy_opt.motion.limits.joint import JointLimit
from energy_opt.motion.path_dynamics import PathDynamics


class Acceleration(JointLimit):
    """Bounds (n,) [rad/s^2]."""

    name, unit, order = "acceleration", "rad/s^2", 2

    def of(self, x: Dense) -> np.ndarray:
        return x.a

    def linear(self, d: PathDynamics, b: float) -> Linear:
        return Linear(d.q1 / self.bound, d.q2 / self.bound, np.zeros_like(d.q1))

    def use(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.abs(d.q1 * a[:, None] + d.q2 * b[:, None]) / self.bound
