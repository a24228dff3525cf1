"""The motors' torque at the joint side: |tau_m,j| <= tau_j, with every torque effect of the model.

Along a path the rigid body's share is M a + C b + G; with effects that are affine in (a, b) the whole is linear.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Fixed, Linear, State
from energy_opt.motion.limits.joint import JointLimit
from energy_opt.motion.path_dynamics import PathDynamics


class Effort(JointLimit):
    """Bounds (n,) [N m]."""

    name, unit = "effort", "N m"

    def __init__(self, bound: np.ndarray) -> None:
        super().__init__(bound)
        self.scale = self.bound

    def of(self, x: Dense) -> np.ndarray:
        return x.effort

    def peaked(self, x: Dense) -> np.ndarray:
        return np.asarray(np.abs(x.effort) / self.bound)

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        return x.effort

    def fixed(self, d: PathDynamics) -> Fixed:
        none = np.zeros(len(d.s))
        held = np.abs(d.motor_torque(none, none))

        def text(k: int, j: int) -> str:
            unit = d.robot.unit("effort", d.robot.joints[j])
            return f"moving slowly takes {held[k, j]:.4g} {unit}, the limit is {self.bound[j]:.4g} {unit}"

        return Fixed(held / self.bound - 1, text, holding=True)

    def linear(self, d: PathDynamics, b: float) -> Linear | None:
        return self.tangent(d, np.zeros(len(d.s)), np.full(len(d.s), b)) if d.affine(b) else None

    def tangent(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> Linear:
        return Linear(*(x / self.bound for x in d.affine_torque(a, b)))

    def use(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.abs(d.motor_torque(a, b)) / self.bound
