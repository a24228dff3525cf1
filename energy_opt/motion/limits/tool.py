"""What bounds on the motion of the tool's origin share: which tool, how much, and where it is seen."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import ClassVar, Self

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Limit, Violation, worst_of
from energy_opt.motion.move import Move, Settings
from energy_opt.robot import RigidBody, Robot, Tool, tool_of

LEAST = 1e-6  # of a bound: slower than any drive turns


class ToolBound(Limit):
    """A bound on the length of one of the origin's derivatives; its `name` is that of the setting.

    Attributes:
        derivative: 1 for velocity, 2 for acceleration.
        fastest: the largest bound that is taken: beyond it a bound is none, or in millimetres.
    """

    derivative: ClassVar[int]
    fastest: ClassVar[float]
    squared = True

    def __init__(self, body: RigidBody, tool: Tool, bound: float) -> None:
        if not LEAST <= bound <= self.fastest:
            option = f"--{self.name.replace('_', '-')}"
            hint = f" (are these millimetres? {bound / 1000:g} {self.unit} then)" if bound > self.fastest else ""
            raise BadInput(f"{option} {bound:g}: expected {LEAST:g} to {self.fastest:g} {self.unit}{hint}")
        self.body, self.tool, self.most = body, tool, float(bound)
        self.scale = np.array([self.most**2])

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None, gravity: np.ndarray) -> Self | None:
        bound = getattr(settings, cls.name)
        return None if bound is None else cls(robot.body, tool_of(robot.body, settings.tool), bound)

    @property
    def structure(self) -> Hashable:
        return self.name, self.body, self.tool

    def where(self, joints: Sequence[str], column: int) -> str:
        return self.tool.name

    def worst(self, x: Dense) -> Violation:
        size = self.peaked(x) * self.most
        return worst_of(self, x, size, np.array([self.most]), size / self.most - 1)

    def peaked(self, x: Dense) -> np.ndarray:
        return np.asarray(np.linalg.norm(x.tool_motion(self.tool)[self.derivative], axis=1)[:, None] / self.most)

    def scaled(self, share: float) -> Self:
        return type(self)(self.body, self.tool, self.most * share)
