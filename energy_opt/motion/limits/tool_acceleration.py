"""Acceleration of the tool's origin, gravity aside: |dv/dt| <= A. What is open on a tool spills beyond it.

Along a path it is |g a + c b| with g the tool's velocity per path speed and c its acceleration per squared path
speed: the norm of a linear function, so a limit on it is convex. For what knows linear limits alone, a polygon in the
plane of g and c represents the circle that it lies in.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.dynamics.compact import tool_state
from energy_opt.motion.limits.base import Linear, State
from energy_opt.motion.limits.tool import ToolBound
from energy_opt.motion.path_dynamics import PathDynamics

SIDES = 32  # of the polygon: it keeps 99.5 % of the bound in every direction, 0.3 % of a duration


class ToolAcceleration(ToolBound):
    """A bound [m/s^2]."""

    name, unit = "tool_acceleration", "m/s^2"
    one_sided = True
    inner = True
    derivative, fastest = 2, 1000.0

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        acceleration = tool_state(self.body.tree(), self.tool, x.q, x.v, x.a).acceleration
        return ca.dot(acceleration, acceleration)

    def linear(self, d: PathDynamics, b: float) -> Linear | None:
        return None

    def tangent(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> Linear:
        _, along, across = d.tool_motion(self.tool)
        # an orthonormal basis of the plane of both vectors, and the polygon's normals in it
        first = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        rest = across - np.sum(across * first, axis=1, keepdims=True) * first
        second = rest / np.maximum(np.linalg.norm(rest, axis=1, keepdims=True), 1e-12)
        angle = 2 * np.pi * np.arange(SIDES // 2) / SIDES
        normal = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
        inside = self.most * np.cos(np.pi / SIDES)
        ra, rb = (np.einsum("mki,mi->mk", normal, x) / inside for x in (along, across))
        return Linear(ra, rb, np.zeros_like(ra))

    def use(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        _, along, across = d.tool_motion(self.tool)
        return np.sum((along * a[:, None] + across * b[:, None]) ** 2, axis=1)[:, None] / self.scale
