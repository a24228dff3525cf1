"""Acceleration of the tool's origin, gravity aside: |J(q) a + J'(q, v) v| <= A. What an open container stands."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Self

import casadi as ca
import numpy as np

from energy_opt.dynamics.tool import tool_state
from energy_opt.errors import BadInput
from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Limit, State, Violation, worst_of
from energy_opt.motion.move import Move, Settings
from energy_opt.robot import RigidBody, Robot, Tool, tool_of


class ToolAcceleration(Limit):
    """A bound [m/s^2]."""

    name, unit = "tool_acceleration", "m/s^2"
    one_sided = True

    def __init__(self, body: RigidBody, tool: Tool, bound: float) -> None:
        if not 0 < bound < np.inf:
            raise BadInput(f"--tool-acceleration {bound:g}: expected metres per second squared above 0")
        self.body, self.tool, self.most = body, tool, float(bound)
        self.scale = np.array([self.most**2])

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None) -> Self | None:
        if settings.tool_acceleration is None:
            return None
        return cls(robot.body, tool_of(robot.body, settings.tool), settings.tool_acceleration)

    @property
    def structure(self) -> Hashable:
        return self.name, self.body, self.tool

    def where(self, joints: Sequence[str], column: int) -> str:
        return self.tool.name

    def worst(self, x: Dense) -> Violation:
        _, _, acceleration = self.body.frame_motion(self.tool.joint, np.array(self.tool.pose), x.q, x.v, x.a)
        value = np.linalg.norm(acceleration, axis=1)[:, None]
        return worst_of(self, x, value, np.array([self.most]), value / self.most - 1)

    def scaled(self, share: float) -> Self:
        return type(self)(self.body, self.tool, self.most * share)

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        acceleration = tool_state(self.body.tree(), self.tool, x.q, x.v, x.a).acceleration
        return ca.dot(acceleration, acceleration)
