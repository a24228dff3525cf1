"""What `--keep` asks of the tool's pose, whatever the timing: the base of limits on it, and how they are written."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import ClassVar, Self

import casadi as ca
import numpy as np

from energy_opt.dynamics.tool import ToolState, tool_state
from energy_opt.errors import BadInput
from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Fixed, Limit, State, Violation, worst_of
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.robot import RigidBody, Robot, Tool, tool_of


class Keep(Limit):
    """The tool's deviation from what it was, or should be, stays within a bound; it depends on the position alone.

    A kind of keeping says how far a pose deviates (`deviation`), in numbers, and gives the solver `expression`, an
    increasing function of that which is smooth, with `row` its value at the bound.

    Attributes:
        word: as the option says it; usual: the bound where none is given, in units of `per` in the limit's own unit.
    """

    one_sided = True
    word: ClassVar[str]
    usual: ClassVar[float]
    per: ClassVar[float]

    def __init__(self, body: RigidBody, tool: Tool, most: float, reference: np.ndarray) -> None:
        self.body, self.tool, self.most, self.values = body, tool, most, reference
        self.scale = np.array([self.row(most)])

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None) -> Self | None:
        words = [word for word in settings.keep if word.partition(":")[0] == cls.word]
        if not words:
            return None
        _, colon, number = words[-1].partition(":")
        try:
            most = cls.usual if not colon else float(number)
        except ValueError:
            most = np.nan
        if not 0 < most <= 1e4:
            raise BadInput(f"--keep {words[-1]}: expected {cls.word} or {cls.word}:{cls.usual:g}, above 0")
        tool = tool_of(robot.body, settings.tool)
        ends = np.zeros((2, robot.n)) if move is None else np.stack([move.start, move.goal])
        return cls(robot.body, tool, most * cls.per, cls.reference(poses_of(robot.body, tool, ends)))

    @property
    def structure(self) -> Hashable:
        return self.name, self.body, self.tool

    def where(self, joints: Sequence[str], column: int) -> str:
        return self.tool.name

    def scaled(self, share: float) -> Self:
        return type(self)(self.body, self.tool, self.most * share, self.values)

    def worst(self, x: Dense) -> Violation:
        value = self.deviation(poses_of(self.body, self.tool, x.q))[:, None]
        return worst_of(self, x, value, np.array([self.most]), value / self.most - 1)

    def fixed(self, d: PathDynamics) -> Fixed:
        value = self.deviation(poses_of(self.body, self.tool, d.path(d.s)))[:, None]

        def text(k: int, j: int) -> str:
            return f"{self.name} is off by {value[k, j]:.4g} {self.unit}, beyond {self.most:.4g} {self.unit}"

        return Fixed(value / self.most - 1 - SLACK, text)

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        return self.smooth(tool_state(self.body.tree(), self.tool, x.q, x.v, x.a), p)

    @staticmethod
    def reference(ends: np.ndarray) -> np.ndarray:
        """The numbers that deviations are counted from, of the tool's poses (2, 4, 4) at the move's ends."""
        raise NotImplementedError

    @staticmethod
    def row(most: float) -> float:
        """What `smooth` is at the bound."""
        raise NotImplementedError

    def deviation(self, poses: np.ndarray) -> np.ndarray:
        """How far off (N,) the tool is at poses (N, 4, 4), in the limit's unit."""
        raise NotImplementedError

    def smooth(self, tool: ToolState, p: ca.SX) -> ca.SX:
        """An increasing function of the deviation that can be differentiated twice where it is none, too."""
        raise NotImplementedError


SLACK = 1e-9  # share of a bound that rounding may take


def poses_of(body: RigidBody, tool: Tool, q: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4) of a tool in the base frame at q (N, n)."""
    still = np.zeros_like(q)
    return body.frame_motion(tool.joint, np.array(tool.pose), q, still, still)[0]


def angle_between(cosine: np.ndarray) -> np.ndarray:
    """Radians, of cosines that rounding may have taken beyond 1."""
    return np.arccos(np.clip(cosine, -1.0, 1.0))
