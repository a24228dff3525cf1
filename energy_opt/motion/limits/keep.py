"""What conditions on a tool's pose have in common: a size that is zero where they hold exactly, and a bound of it.

A size x grows from zero with a kink, its square does not, but runs away where a first path is far outside; so
constraints are of sqrt((x^2 + w^2) / 2) with w the bound: smooth, at most w if and only if x is, and growing like x far
outside.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import ClassVar, Self

import casadi as ca
import numpy as np

from energy_opt.dynamics.compact import ToolState, tool_state
from energy_opt.motion.conditions import kept
from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Fixed, Limit, State, Violation, worst_of
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.robot import RigidBody, Robot, Tool, tool_of


class Keep(Limit):
    """A bound [deg or mm] of how far a tool's pose is from what is kept.

    Attributes:
        reference: numbers of what is kept, as `squared_size` takes them.
    """

    one_sided = True
    everywhere = True
    numbers: ClassVar[int]  # how many the reference has

    def __init__(self, body: RigidBody, tool: Tool, reference: np.ndarray, bound: float) -> None:
        self.body, self.tool, self.reference, self.most = body, tool, reference, float(bound)
        self.scale = np.array([self.width(self.most)])
        self.values = np.append(reference, self.scale)

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None, gravity: np.ndarray) -> Self | None:
        bound = kept(tuple(settings.keep)).get(cls.name)
        if bound is None:
            return None
        tool = tool_of(robot.body, settings.tool)
        if move is None:
            return cls(robot.body, tool, np.zeros(cls.numbers), bound)
        ends = np.stack([move.start, move.goal])
        still = np.zeros_like(ends)
        poses, _, _ = robot.body.frame_motion(tool.joint, np.array(tool.pose), ends, still, still)
        return cls(robot.body, tool, cls.kept(poses, -gravity), bound)

    @classmethod
    def kept(cls, ends: np.ndarray, up: np.ndarray) -> np.ndarray:
        """The reference that poses (2, 4, 4) at start and goal, and what points up (3,), stand for."""
        raise NotImplementedError

    @staticmethod
    def width(bound: float) -> float:
        """The size that a bound represents."""
        raise NotImplementedError

    @staticmethod
    def squared_size(place: ToolState, p: ca.SX) -> ca.SX:
        """The square of the size at a pose, for a reference p."""
        raise NotImplementedError

    def measure(self, poses: np.ndarray) -> np.ndarray:
        """How far poses (M, 4, 4) are from what is kept, (M,) in the limit's unit."""
        raise NotImplementedError

    def correction(self, poses: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The way back from poses (M, 4, 4) at shares (M,) of a path.

        Returns: displacement and rotation vector (M, 6) [m, rad] in the base frame, and what of the pose they are of:
        projections (M, 6, 6), so that moves which are free are left alone.
        """
        raise NotImplementedError

    @property
    def structure(self) -> Hashable:
        return self.name, self.body, self.tool

    def where(self, joints: Sequence[str], column: int) -> str:
        return self.tool.name

    def worst(self, x: Dense) -> Violation:
        value = self.measure(x.tool_motion(self.tool)[0])[:, None]
        return worst_of(self, x, value, np.array([self.most]), value / self.most - 1)

    def scaled(self, share: float) -> Self:
        return type(self)(self.body, self.tool, self.reference, self.most * share)

    def fixed(self, d: PathDynamics) -> Fixed:
        value = self.measure(d.tool_motion(self.tool)[0])[:, None]

        def text(k: int, j: int) -> str:
            above = np.ceil(1e3 * value.max()) / 1e3
            return (
                f"the tool is {value[k, j]:.4g} {self.unit} from {_OF[self.name]}, allowed are {self.most:.4g} "
                f"(--keep {self.name}:{above:g} would let it pass)"
            )

        return Fixed(value / self.most - 1, text)

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        place = tool_state(self.body.tree(), self.tool, x.q, x.v, x.a)
        return ca.sqrt((self.squared_size(place, p[:-1]) + p[-1] ** 2) / 2)


_OF = {"upright": "upright", "orientation": "its orientation at the start", "line": "the line between its ends"}
