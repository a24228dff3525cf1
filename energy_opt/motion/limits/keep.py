"""Conditions on a tool's pose: a size that is zero if the condition holds exactly, and a bound on it.

The size x has a kink at zero. Its square has none, but grows too fast if an initial path is far outside. So the
constraint is on sqrt((x^2 + w^2) / 2) with w the bound. This is smooth, is at most w if and only if x is, and grows
like x far outside.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import ClassVar, Self

import casadi as ca
import numpy as np

from energy_opt.dynamics.compact import ToolState, tool_state
from energy_opt.motion.carried import Carried
from energy_opt.motion.conditions import kept
from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Fixed, Limit, State, Violation, worst_of
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.robot import RigidBody, Robot, Tool, tool_of


class Keep(Limit):
    """A bound [deg or mm] on the deviation of a tool's pose from a condition.

    Attributes:
        reference: numbers of the condition, in the form that `squared_size` takes.
    """

    one_sided = True
    everywhere = True
    numbers: ClassVar[int]  # number of entries of the reference

    def __init__(self, body: RigidBody, tool: Tool, reference: np.ndarray, bound: float) -> None:
        self.body, self.tool, self.reference, self.most = body, tool, reference, float(bound)
        self.scale = np.array([self.width(self.most)])
        self.values = np.append(reference, self.scale)

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None, gravity: np.ndarray) -> Self | None:
        """The limit of the setting `keep`, with the pose at the start as reference."""
        bound = kept(tuple(settings.keep)).get(cls.name)
        if bound is None:
            return None
        tool = tool_of(robot.body, settings.tool)
        if move is None:
            return cls(robot.body, tool, np.zeros(cls.numbers), bound)
        poses = Carried(robot.body, tool).poses(np.stack([move.start, move.goal]))
        return cls(robot.body, tool, cls.kept(poses, -gravity), bound)

    @classmethod
    def kept(cls, ends: np.ndarray, up: np.ndarray) -> np.ndarray:
        """The reference for poses (2, 4, 4) at start and goal, and the up direction (3,)."""
        raise NotImplementedError

    @staticmethod
    def width(bound: float) -> float:
        """The size that corresponds to a bound: of an angle [deg] the chord 2 sin(angle / 2)."""
        return float(2 * np.sin(np.radians(bound) / 2))

    @staticmethod
    def squared_size(place: ToolState, p: ca.SX) -> ca.SX:
        """The square of the size at a pose, for a reference p."""
        raise NotImplementedError

    def measure(self, poses: np.ndarray) -> np.ndarray:
        """Deviations (M,) of poses (M, 4, 4) from the condition, in the limit's unit."""
        raise NotImplementedError

    def correction(self, poses: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The correction that brings poses (M, 4, 4) at shares (M,) of a path back to the condition.

        Returns: displacement and rotation vector (M, 6) [m, rad] in the base frame, and projections (M, 6, 6) onto the
            constrained directions, so that free motions are not changed.
        """
        raise NotImplementedError

    @property
    def structure(self) -> Hashable:
        """Name, body and tool."""
        return self.name, self.body, self.tool

    def where(self, joints: Sequence[str], column: int) -> str:
        """The tool's frame, in words."""
        return str(self.tool)

    def worst(self, x: Dense) -> Violation:
        """The pose of the largest deviation."""
        value = self.measure(x.tool_motion(self.tool)[0])[:, None]
        return worst_of(self, x, value, np.array([self.most]), value / self.most - 1)

    def scaled(self, share: float) -> Self:
        """The limit with its bound times `share`."""
        return type(self)(self.body, self.tool, self.reference, self.most * share)

    def fixed(self, d: PathDynamics) -> Fixed:
        """The deviation of the path's poses, which no timing changes."""
        value = self.measure(d.tool_motion(self.tool)[0])[:, None]

        def text(k: int, j: int) -> str:
            above = np.ceil(1e3 * value.max()) / 1e3
            return (
                f"the tool is {value[k, j]:.4g} {self.unit} from {_OF[self.name]}, allowed are {self.most:.4g} "
                f"(--keep {self.name}:{above:g} would allow it)"
            )

        return Fixed(value / self.most - 1, text)

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        """sqrt((x^2 + w^2) / 2), see the module."""
        place = tool_state(self.body.tree(), self.tool, x.q, x.v, x.a)
        return ca.sqrt((self.squared_size(place, p[:-1]) + p[-1] ** 2) / 2)


_OF = {"upright": "upright", "orientation": "its orientation at the start", "line": "the line between its ends"}


class KeepUpright(Keep):
    """A bound [deg]; the reference is the axis in the tool's frame (3,), and up in the base frame (3,)."""

    name, unit, numbers = "upright", "deg", 6

    @classmethod
    def kept(cls, ends: np.ndarray, up: np.ndarray) -> np.ndarray:
        """The tool's axis (3,) that points up most at the start (with its sign), and up (3,)."""
        up = up / max(float(np.linalg.norm(up)), 1e-300)
        share = up @ ends[0, :3, :3]  # upward component of each axis
        axis = np.zeros(3)
        axis[np.argmax(np.abs(share))] = np.sign(share[np.argmax(np.abs(share))])
        return np.concatenate([axis, up])

    @staticmethod
    def squared_size(place: ToolState, p: ca.SX) -> ca.SX:
        """The squared chord between the axis and up."""
        # |axis - up|^2 without its cancellation at zero
        return ca.sumsqr(ca.mtimes(place.rotation, p[:3]) - p[3:])

    def measure(self, poses: np.ndarray) -> np.ndarray:
        """Angles (M,) [deg] between the axis and up, by atan2, which is exact at small angles."""
        axis, up = poses[:, :3, :3] @ self.reference[:3], self.reference[3:]
        return np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, up), axis=1), axis @ up))

    def correction(self, poses: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The rotation of the axis back to up; see `Keep.correction`. Rotations about the axis are free."""
        axis, up = poses[:, :3, :3] @ self.reference[:3], self.reference[3:]
        cross = np.cross(axis, up)
        sine = np.linalg.norm(cross, axis=1, keepdims=True)
        out, of = np.zeros((len(poses), 6)), np.zeros((len(poses), 6, 6))
        out[:, 3:] = cross / np.maximum(sine, 1e-12) * np.arctan2(sine, (axis @ up)[:, None])
        of[:, 3:, 3:] = np.eye(3) - axis[:, :, None] * axis[:, None, :]
        return out, of


class KeepOrientation(Keep):
    """A bound [deg]; the reference is the rotation at the start, (9,) column by column."""

    name, unit, numbers = "orientation", "deg", 9

    @classmethod
    def kept(cls, ends: np.ndarray, up: np.ndarray) -> np.ndarray:
        """The rotation at the start, (9,) column by column."""
        return ends[0, :3, :3].T.ravel()

    @staticmethod
    def squared_size(place: ToolState, p: ca.SX) -> ca.SX:
        """The squared chord of the rotation from the start's: |R - R0|^2 / 2 = 4 sin^2(angle / 2)."""
        # |R - R0|^2 = 8 sin^2(angle / 2) over all entries; half of it is the chord's square
        return ca.sumsqr(ca.vec(place.rotation) - p) / 2

    def measure(self, poses: np.ndarray) -> np.ndarray:
        """Angles (M,) [deg] of the rotations from the start's."""
        return np.degrees(np.linalg.norm(_turn(self._still @ poses[:, :3, :3].transpose(0, 2, 1)), axis=1))

    @property
    def _still(self) -> np.ndarray:
        """The rotation at the start (3, 3)."""
        return self.reference.reshape(3, 3).T

    def correction(self, poses: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The rotation back to the start's; see `Keep.correction`."""
        out, of = np.zeros((len(poses), 6)), np.zeros((len(poses), 6, 6))
        out[:, 3:] = _turn(self._still @ poses[:, :3, :3].transpose(0, 2, 1))
        of[:, 3:, 3:] = np.eye(3)
        return out, of


def _turn(rotation: np.ndarray) -> np.ndarray:
    """Rotation vectors (M, 3) [rad] of rotations (M, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotation).as_rotvec())


NO_LENGTH = 1e-9  # [m] a shorter segment counts as a point
BEYOND = 0.3  # share of the bound by which constraints let the tool go beyond the segment's ends
# share of the bound for the octagon across the segment, so that its corners are within the bound
ACROSS = np.sqrt(1 - BEYOND**2) * np.cos(np.pi / 8)


class KeepLine(Keep):
    """A bound [mm] on the distance from a line segment.

    The reference is the segment's first point (3,) [m], its direction (3,) and its length [m]. Symbolic constraints are
    a prism: an octagon across the segment whose corners are within the bound, and a bound along it.
    """

    name, unit, numbers = "line", "mm", 7
    one_sided = False

    def __init__(self, body: RigidBody, tool: Tool, reference: np.ndarray, bound: float) -> None:
        super().__init__(body, tool, reference, bound)
        width = self.width(bound)
        self.scale = np.append(np.full(4, ACROSS * width), reference[6] / 2 + BEYOND * width)
        first = np.cross(reference[3:6], np.eye(3)[np.argmin(np.abs(reference[3:6]))])
        first /= max(float(np.linalg.norm(first)), 1e-300)
        second = np.cross(reference[3:6], first)
        across = [first, second, (first + second) / np.sqrt(2), (first - second) / np.sqrt(2)]
        middle = reference[:3] + reference[6] / 2 * reference[3:6]
        self.values = np.concatenate([middle, *across, reference[3:6]])

    @classmethod
    def kept(cls, ends: np.ndarray, up: np.ndarray) -> np.ndarray:
        """The segment (7,) between the tool's places at start and goal, see the class; a point if these coincide."""
        begin, displacement = ends[0, :3, 3], ends[1, :3, 3] - ends[0, :3, 3]
        length = float(np.linalg.norm(displacement))
        if length <= NO_LENGTH:
            return np.concatenate([begin, [0.0, 0.0, 1.0, 0.0]])
        return np.concatenate([begin, displacement / length, [length]])

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        """Coordinates (5, 1) [m] of the tool from the segment's middle: four across it, one along it."""
        place = tool_state(self.body.tree(), self.tool, x.q, x.v, x.a).position
        return ca.mtimes(ca.reshape(p[3:], 3, 5).T, place - p[:3])

    @staticmethod
    def width(bound: float) -> float:
        """The bound in m."""
        return bound / 1000

    def measure(self, poses: np.ndarray) -> np.ndarray:
        """Distances (M,) [mm] from the segment."""
        return 1000 * np.linalg.norm(self._off(poses[:, :3, 3]), axis=1)

    def _off(self, place: np.ndarray) -> np.ndarray:
        """Vectors (M, 3) [m] from the nearest point of the segment."""
        begin, direction, length = self.reference[:3], self.reference[3:6], self.reference[6]
        along = np.clip((place - begin) @ direction, 0.0, length)
        return place - begin - along[:, None] * direction

    def correction(self, poses: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The displacement to the point at the same share of the segment; see `Keep.correction`."""
        begin, direction, length = self.reference[:3], self.reference[3:6], self.reference[6]
        out, of = np.zeros((len(poses), 6)), np.zeros((len(poses), 6, 6))
        # evenly along the segment: a path in joint space may run back and forth on it
        out[:, :3] = begin + length * share[:, None] * direction - poses[:, :3, 3]
        of[:, :3, :3] = np.eye(3)
        return out, of
