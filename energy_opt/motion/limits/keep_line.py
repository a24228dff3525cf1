"""A tool's origin stays near the segment between where it is at both ends of a move.

A narrow bound on a distance gives a solver no direction: from the middle its gradient is zero. So constraints are
linear in the tool's position: four directions across the segment, an octagon inside the circle, and one along it.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.dynamics.compact import tool_state
from energy_opt.motion.limits.base import State
from energy_opt.motion.limits.keep import Keep
from energy_opt.robot import RigidBody, Tool

NO_LENGTH = 1e-9  # [m] a shorter segment is a point
BEYOND = 0.3  # of the bound: how far constraints let the tool go beyond the segment's ends
ACROSS = np.sqrt(1 - BEYOND**2) * np.cos(np.pi / 8)  # and the octagon across it: its corners are within the bound


class KeepLine(Keep):
    """A bound [mm]; the reference is where the segment begins (3,) [m], its direction (3,) and length [m]."""

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
        begin, way = ends[0, :3, 3], ends[1, :3, 3] - ends[0, :3, 3]
        length = float(np.linalg.norm(way))
        if length <= NO_LENGTH:
            return np.concatenate([begin, [0.0, 0.0, 1.0, 0.0]])
        return np.concatenate([begin, way / length, [length]])

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        place = tool_state(self.body.tree(), self.tool, x.q, x.v, x.a).position
        return ca.mtimes(ca.reshape(p[3:], 3, 5).T, place - p[:3])

    @staticmethod
    def width(bound: float) -> float:
        return bound / 1000

    def measure(self, poses: np.ndarray) -> np.ndarray:
        return 1000 * np.linalg.norm(self._off(poses[:, :3, 3]), axis=1)

    def _off(self, place: np.ndarray) -> np.ndarray:
        begin, direction, length = self.reference[:3], self.reference[3:6], self.reference[6]
        along = np.clip((place - begin) @ direction, 0.0, length)
        return place - begin - along[:, None] * direction

    def correction(self, poses: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        begin, direction, length = self.reference[:3], self.reference[3:6], self.reference[6]
        out, of = np.zeros((len(poses), 6)), np.zeros((len(poses), 6, 6))
        # evenly along the segment: a path in joint space may run to and fro on it
        out[:, :3] = begin + length * share[:, None] * direction - poses[:, :3, 3]
        of[:, :3, :3] = np.eye(3)
        return out, of
