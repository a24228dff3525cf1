"""A motion stays near a path: each joint within a bound of the path's nearest point, or the tool near its own path.

Constraints are at places of a curve; the nearest point is found anew at every iterate. For joints they are the
deviations, as shares of the bound. The distance d of a tool has a kink on the path, so its constraints are
sqrt((d^2 + w^2) / (2 w^2)) with w the bound, smooth and at most 1 if and only if d is at most w (see `keep`). The
tool's path is a cubic spline through the tool's positions at a dense sampling of the path.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Self

import numpy as np

from energy_opt.motion.carried import Carried
from energy_opt.motion.conditions import tube_of
from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Fixed, Limit, PlaceConstraints, Violation, worst_of
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.nearest import Foot, NearestOf
from energy_opt.motion.path import JointPath, through
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.robot import Robot, Tool, tool_of

PLACES = 80  # constraints along a curve: two for each control point of a fine one
SAMPLED = 2001  # places of the path for the tool's spline: it errs by less than 1 um on bends of 1 cm


class Tube(Limit):
    """A bound [rad or m].

    Attributes:
        near: finds nearest points of the path, the joints' or the tool's.
        tool: the tool to keep near; None for all joints (their names in `joints`).
    """

    name, unit = "tube", "rad"

    def __init__(self, joints: Sequence[str], near: NearestOf, bound: float, tool: Carried | None = None) -> None:
        self.joints, self.near, self.most, self.tool = tuple(joints), near, bound, tool

    @classmethod
    def of(cls, robot: Robot, path: JointPath, words: str, tool: Tool) -> Self:
        """The tube about a path.

        Args:
            words: its bound, such as 0.1rad (for every joint) or 0.02m (for the tool).
            tool: the tool of a bound in m; a bound in rad does not use it.
        """
        bound, unit = tube_of(words)
        if unit == "rad":
            return cls(robot.joints, NearestOf(path), bound)
        carried = Carried(robot.body, tool)
        places = path(np.linspace(0, 1, SAMPLED))
        return cls(robot.joints, NearestOf(through(carried.place(places))), bound, carried)

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None, gravity: np.ndarray) -> Self | None:
        """The tube of the setting `tube` about the move's path; None without either."""
        if settings.tube is None or move is None or move.path is None:
            return None
        return cls.of(robot, move.path, settings.tube, tool_of(robot.body, settings.tool))

    def where(self, joints: Sequence[str], column: int) -> str:
        """The joint, or the tool."""
        return joints[column] if self.tool is None else self.tool.name

    def _deviation(self, q: np.ndarray) -> np.ndarray:
        """Distance of positions (M, n) from the path: per joint (M, n) [rad], or of the tool (M, 1) [m]."""
        if self.tool is None:
            return np.abs(self.near(q).off)
        return np.linalg.norm(self.near(self.tool.place(q)).off, axis=1)[:, None]

    def worst(self, x: Dense) -> Violation:
        """The place that is farthest from the path."""
        value = self._deviation(x.q)
        return worst_of(self, x, value, np.full(value.shape[1], self.most), value / self.most - 1)

    def excess_at(self, q: np.ndarray) -> float:
        """The largest distance of positions q (M, n) over the bound, less 1."""
        return float(self._deviation(q).max()) / self.most - 1

    def scaled(self, share: float) -> Self:
        """The tube with its bound times `share`."""
        return type(self)(self.joints, self.near, self.most * share, self.tool)

    def fixed(self, d: PathDynamics) -> Fixed:
        """The distance of a path from the given one, which no timing changes."""
        value, unit = self._deviation(d.q), "rad" if self.tool is None else "m"

        def text(k: int, j: int) -> str:
            return f"{value[k, j]:.4g} {unit} from the path, allowed are {self.most:.4g} (--tube)"

        return Fixed(value / self.most - 1, text)

    def places(self, curve: Callable[[np.ndarray], np.ndarray]) -> PlaceConstraints:
        """Constraints at PLACES evenly spaced places."""
        u = (np.arange(PLACES) + 0.5) / PLACES
        if self.tool is None:
            return JointConstraints(self.near, self.most, u, len(self.joints))
        return ToolConstraints(self.near, self.most, u, self.tool)


class JointConstraints:
    """Deviations of all joints at all places, as shares of the bound (see `limits.base.PlaceConstraints`)."""

    def __init__(self, near: NearestOf, bound: float, u: np.ndarray, joints: int) -> None:
        self.u, self._near, self._bound = u, near, bound
        self.place, self.keys = np.repeat(np.arange(len(u)), joints), np.arange(len(u) * joints)
        self.lower, self.upper = np.full(len(self.keys), -1.0), np.ones(len(self.keys))
        self._at: np.ndarray | None = None

    def _move(self, q: np.ndarray) -> Foot:
        """The nearest points at q (K, n); computed once for each q."""
        if self._at is not q:
            self._at, self._foot = q, self._near(q)
        return self._foot

    def value(self, q: np.ndarray) -> np.ndarray:
        """(R,)."""
        return self._move(q).off.ravel() / self._bound

    def gradient(self, q: np.ndarray) -> np.ndarray:
        """(R, n)."""
        return self._move(q).off_slope.reshape(-1, q.shape[1]) / self._bound

    def hessian(self, q: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """(K, n, n)."""
        return self._move(q).off_curvature(multipliers.reshape(q.shape) / self._bound)


class ToolConstraints:
    """sqrt((d^2 / w^2 + 1) / 2) at all places, for a tool's distance d and the bound w."""

    def __init__(self, near: NearestOf, bound: float, u: np.ndarray, tool: Carried) -> None:
        self.u, self._near, self._bound, self._tool = u, near, bound, tool
        self.place = self.keys = np.arange(len(u))
        self.lower, self.upper = np.full(len(u), -np.inf), np.ones(len(u))
        self._at: np.ndarray | None = None

    def _move(self, q: np.ndarray) -> Foot:
        """The nearest points of the tool at q (K, n), its velocities and the values; computed once for each q."""
        if self._at is not q:
            self._at, self._foot = q, self._near(self._tool.place(q))
            self._axes, self._moved = self._tool.moved(q)
            self._f = np.sqrt((np.sum(self._foot.off**2, axis=1) / self._bound**2 + 1) / 2)
        return self._foot

    def value(self, q: np.ndarray) -> np.ndarray:
        """(R,)."""
        self._move(q)
        return self._f

    def gradient(self, q: np.ndarray) -> np.ndarray:
        """(R, n): with the gradient e of d^2 / 2, df/dx = e / (2 f w^2)."""
        off = self._move(q).off / (2 * self._f * self._bound**2)[:, None]
        return np.asarray((self._tool.joined(self._moved) @ off[:, :, None])[:, :, 0])

    def hessian(self, q: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """(K, n, n): d2f/dx2 = (de/dx - e e^T / (2 f^2 w^2)) / (2 f w^2)."""
        foot = self._move(q)
        size = 2 * self._f * self._bound**2
        inner = foot.off_slope - foot.off[:, :, None] * foot.off[:, None] / (self._f * size)[:, None, None]
        inner *= (multipliers / size)[:, None, None]
        bent = self._tool.bent(self._axes, self._moved, (multipliers / size)[:, None] * foot.off)
        moved = self._tool.joined(self._moved)
        return np.asarray(moved @ inner @ moved.transpose(0, 2, 1) + bent)
