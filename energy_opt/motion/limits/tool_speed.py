"""Speed of the tool's origin: |J(q) v| <= V. Along a path its square is |J q'|^2 b, linear in squared path speed."""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.dynamics.compact import tool_state
from energy_opt.motion.limits.base import Linear, State
from energy_opt.motion.limits.tool import ToolBound
from energy_opt.motion.path_dynamics import PathDynamics


class ToolSpeed(ToolBound):
    """A bound [m/s]."""

    name, unit = "tool_speed", "m/s"
    derivative, fastest = 1, 50.0

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        velocity = tool_state(self.body.tree(), self.tool, x.q, x.v, x.a).velocity
        return ca.dot(velocity, velocity)

    def linear(self, d: PathDynamics, b: float) -> Linear:
        share = np.sum(d.tool_motion(self.tool)[1] ** 2, axis=1)[:, None] / self.scale
        return Linear(np.zeros_like(share), share, np.zeros_like(share))

    def use(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return self.linear(d, 1.0).rb * b[:, None]
