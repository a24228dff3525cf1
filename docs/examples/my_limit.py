"""A limit of one's own: the mechanical power of each joint's drive, |tau_m,j v_j| <= P_j."""

import casadi as ca
import numpy as np

from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import State
from energy_opt.motion.limits.joint import JointLimit


class DrivePower(JointLimit):
    """Bounds (n,) [W]."""

    name, unit = "drive_power", "W"

    def __init__(self, bound: np.ndarray) -> None:
        super().__init__(bound)
        self.scale = self.bound  # the rows below are divided by it

    def of(self, x: Dense) -> np.ndarray:
        """For the judge: the value at every sample, (N, n)."""
        return x.effort * x.v

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        """For the solver: the value at a node, (n, 1)."""
        return x.effort * x.v
