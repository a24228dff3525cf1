"""A tool that an arm carries."""

from __future__ import annotations

import numpy as np

from energy_opt.robot import RigidBody, Tool
from energy_opt.robot.kinematics import Kinematics, Poses


class Carried:
    """A tool of an arm, in NumPy: its pose, and the motion that joints give it."""

    def __init__(self, body: RigidBody, tool: Tool) -> None:
        self.name, self._joint = str(tool), tool.joint
        self._kinematics, self._pose = Kinematics(body.tree()), np.array(tool.pose)
        self._moves = self._kinematics.moves[tool.joint]

    def place(self, q: np.ndarray) -> np.ndarray:
        """Its origin (M, 3) [m] in the base frame at q (M, n)."""
        return self._origin(self._kinematics(q))

    def _origin(self, at: Poses) -> np.ndarray:
        """Its origin (M, 3) [m] at poses of the links."""
        return np.asarray(at.origin[:, self._joint] + at.rotation[:, self._joint] @ self._pose[:3, 3])

    def poses(self, q: np.ndarray) -> np.ndarray:
        """Its poses (M, 4, 4) in the base frame at q (M, n)."""
        at, out = self._kinematics(q), np.tile(np.eye(4), (len(q), 1, 1))
        out[:, :3, :3] = at.rotation[:, self._joint] @ self._pose[:3, :3]
        out[:, :3, 3] = self._origin(at)
        return out

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Derivatives (M, 6, n) of its place and rotation, in the base frame."""
        axes, moved = self.moved(q)
        return self.joined(np.concatenate([moved, axes], axis=2)).transpose(0, 2, 1)

    def moved(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Axes z of all joints, and the velocities w they give the tool; zero for joints that do not move it, (M, L,
        3) each.
        """
        at, slides = self._kinematics(q), self._kinematics.prismatic[:, None]
        w = np.where(slides, at.axis, np.cross(at.axis, self._origin(at)[:, None] - at.origin[:, :-1]))
        return at.axis * (self._moves[:, None] & ~slides), w * self._moves[:, None]

    def joined(self, moved: np.ndarray) -> np.ndarray:
        """Velocities (M, n, 3) that the independent joints give the tool, from those of all joints, (M, L, 3)."""
        return self._kinematics.coupling.joined(moved, axis=1)

    def bent(self, axes: np.ndarray, moved: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Sum of the second derivatives of its origin's coordinates times weights, (M, n, n).

        d2x / dq_i dq_j = z_i x w_j where joint i comes before j in the chain, or is j itself.

        Args:
            axes, moved: z and w of all joints, (M, L, 3) each, as `moved` gives them. weight: (M, 3).
        """
        half = np.cross(weight[:, None], axes) @ moved.transpose(0, 2, 1) * self._kinematics.moves[:-1].T
        both, coupling = (half * ~np.eye(half.shape[1], dtype=bool)).transpose(0, 2, 1), self._kinematics.coupling
        return coupling.joined(coupling.joined(half + both), axis=1)
