"""Bounds on the motion of the tool's origin: its speed and its acceleration.

Along a path the squared speed is |J q'|^2 b, linear in squared path speed. The acceleration, without gravity, is
|g a + c b| with g the tool's velocity per path speed and c its acceleration per squared path speed: the norm of a
linear function, so a limit on it is convex. For solvers of linear limits only, a polygon in the plane of g and c
represents the circle around it.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import ClassVar, Self

import casadi as ca
import numpy as np

from energy_opt.dynamics.compact import tool_state
from energy_opt.motion.carried import Carried
from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Limit, Linear, State, Violation, worst_of
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.robot import RigidBody, Robot, Tool, tool_of


class ToolBound(Limit):
    """A bound on the length of one of the origin's derivatives; its `name` is that of the setting.

    Attributes:
        derivative: 1 for velocity, 2 for acceleration.
    """

    derivative: ClassVar[int]
    squared = True

    def __init__(self, body: RigidBody, tool: Tool, bound: float) -> None:
        self.body, self.tool, self.most = body, tool, float(bound)
        self.scale = np.array([self.most**2])

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None, gravity: np.ndarray) -> Self | None:
        """The limit of the setting with its name; None if it is not set."""
        bound = getattr(settings, cls.name)
        return None if bound is None else cls(robot.body, tool_of(robot.body, settings.tool), bound)

    @property
    def structure(self) -> Hashable:
        """Name, body and tool."""
        return self.name, self.body, self.tool

    def where(self, joints: Sequence[str], column: int) -> str:
        """The tool's frame, in words."""
        return str(self.tool)

    def worst(self, x: Dense) -> Violation:
        """The largest length over the bound."""
        size = self.peaked(x) * self.most
        return worst_of(self, x, size, np.array([self.most]), size / self.most - 1)

    def peaked(self, x: Dense) -> np.ndarray:
        """Length over bound, (N, 1)."""
        return np.asarray(np.linalg.norm(x.tool_motion(self.tool)[self.derivative], axis=1)[:, None] / self.most)

    def straight(self, poses: np.ndarray) -> float:
        """Length [m] of the straight lines between the tool's places at poses (K, n)."""
        place = Carried(self.body, self.tool).place(poses)
        return float(np.linalg.norm(np.diff(place, axis=0), axis=1).sum())

    def scaled(self, share: float) -> Self:
        """The limit with its bound times `share`."""
        return type(self)(self.body, self.tool, self.most * share)


class ToolSpeed(ToolBound):
    """A bound [m/s]."""

    name, unit = "tool_speed", "m/s"
    derivative = 1

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        """Squared speed [m^2/s^2]."""
        velocity = tool_state(self.body.tree(), self.tool, x.q, x.v, x.a).velocity
        return ca.dot(velocity, velocity)

    def least_duration(self, poses: np.ndarray, resting: bool) -> float:
        """The straight lines between the tool's places, at the bound."""
        return self.straight(poses) / self.most

    def linear(self, d: PathDynamics, b: float) -> Linear:
        """|J q'|^2 b / bound^2 <= 1."""
        share = np.sum(d.tool_motion(self.tool)[1] ** 2, axis=1)[:, None] / self.scale
        return Linear(np.zeros_like(share), share, np.zeros_like(share))


CORNERS = 32  # corners of the polygon: it keeps 99.5 % of the bound in every direction and costs 0.3 % of a duration


class ToolAcceleration(ToolBound):
    """A bound [m/s^2]."""

    name, unit = "tool_acceleration", "m/s^2"
    one_sided = True
    inner = True
    derivative = 2

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        """Squared acceleration [m^2/s^4]."""
        acceleration = tool_state(self.body.tree(), self.tool, x.q, x.v, x.a).acceleration
        return ca.dot(acceleration, acceleration)

    def least_duration(self, poses: np.ndarray, resting: bool) -> float:
        """The straight lines between the tool's places, at the bound: faster in one half, slower in the other."""
        return 2 * float(np.sqrt(self.straight(poses) / self.most)) if resting else 0.0

    def linear(self, d: PathDynamics, b: float) -> Linear | None:
        """None: the norm is not linear."""
        return None

    def tangent(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> Linear:
        """A polygon of CORNERS sides inside the circle, in the plane of g and c.

        |n_k . (g a + c b)| <= bound cos(pi / CORNERS) for half of its normals n_k.
        """
        _, along, across = d.tool_motion(self.tool)
        # an orthonormal basis of the plane of both vectors, and the polygon's normals in it
        first = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        rest = across - np.sum(across * first, axis=1, keepdims=True) * first
        second = rest / np.maximum(np.linalg.norm(rest, axis=1, keepdims=True), 1e-12)
        angle = 2 * np.pi * np.arange(CORNERS // 2) / CORNERS
        normal = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
        inside = self.most * np.cos(np.pi / CORNERS)
        ra, rb = (np.einsum("mki,mi->mk", normal, x) / inside for x in (along, across))
        return Linear(ra, rb, np.zeros_like(ra))

    def use(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """|g a + c b|^2 / bound^2, (M, 1)."""
        _, along, across = d.tool_motion(self.tool)
        return np.sum((along * a[:, None] + across * b[:, None]) ** 2, axis=1)[:, None] / self.scale
