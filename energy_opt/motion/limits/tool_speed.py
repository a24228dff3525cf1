"""Speed of the tool's origin: |J(q) v| <= V. Along a path its square is |J q'|^2 b, linear in squared path speed."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Self

import casadi as ca
import numpy as np

from energy_opt.dynamics.tool import tool_state
from energy_opt.errors import BadInput
from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Limit, Linear, State, Violation, worst_of
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.robot import RigidBody, Robot, Tool, tool_of


class ToolSpeed(Limit):
    """A bound [m/s]."""

    name, unit = "tool_speed", "m/s"
    squared = True

    def __init__(self, body: RigidBody, tool: Tool, bound: float) -> None:
        if not 1e-06 <= bound <= 1e06:
            raise BadInput(f"--tool-speed {bound:g}: expected 1e-06 to 1e+06 m/s")
        self.body, self.tool, self.most = body, tool, float(bound)
        self.scale = np.array([self.most**2])

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None, gravity: np.ndarray) -> Self | None:
        if settings.tool_speed is None:
            return None
        return cls(robot.body, tool_of(robot.body, settings.tool), settings.tool_speed)

    @property
    def structure(self) -> Hashable:
        return self.name, self.body, self.tool

    def where(self, joints: Sequence[str], column: int) -> str:
        return self.tool.name

    def worst(self, x: Dense) -> Violation:
        speed = np.linalg.norm(x.tool_motion(self.tool)[1], axis=1)[:, None]
        return worst_of(self, x, speed, np.array([self.most]), speed / self.most - 1)

    def scaled(self, share: float) -> Self:
        return type(self)(self.body, self.tool, self.most * share)

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        velocity = tool_state(self.body.tree(), self.tool, x.q, x.v, x.a).velocity
        return ca.dot(velocity, velocity)

    def linear(self, d: PathDynamics, b: float) -> Linear:
        share = np.sum(d.tool_motion(self.tool)[1] ** 2, axis=1)[:, None] / self.scale
        return Linear(np.zeros_like(share), share, np.zeros_like(share))

    def use(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return self.linear(d, 1.0).rb * b[:, None]
