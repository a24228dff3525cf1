"""Where an arm's links are, for many configurations at once, in NumPy alone.

L links have a joint each, of which n move by themselves and take the others along (see `coupling`). Arrays over links
have one entry more than there are: the last, which index -1 reaches, is the base.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.robot.coupling import Coupling
from energy_opt.robot.links import Link


@dataclass(frozen=True)
class Poses:
    """Frames of the links at N configurations, in the base frame.

    Attributes:
        rotation: (N, L + 1, 3, 3).
        origin: (N, L + 1, 3) [m]; a joint's axis goes through its link's origin.
        axis: (N, L, 3) unit vectors along the joints' axes.
    """

    rotation: np.ndarray
    origin: np.ndarray
    axis: np.ndarray


class Kinematics:
    """Forward kinematics of a fixed-base tree of one-degree-of-freedom joints."""

    def __init__(self, links: Sequence[Link]) -> None:
        self.count = len(links)
        self.coupling = Coupling.of(links)
        self.parent = np.array([link.parent for link in links])
        self.prismatic = np.array([link.prismatic for link in links])
        self._turn = np.stack([link.placement[:3, :3] for link in links])
        self._shift = np.stack([link.placement[:3, 3] for link in links])
        self._axis = np.stack([link.axis for link in links])
        k = np.zeros((self.count, 3, 3))
        x, y, z = self._axis.T
        k[:, 0, 1], k[:, 0, 2], k[:, 1, 2] = -z, y, -x
        k -= k.transpose(0, 2, 1)
        # Rodrigues: turn · (1 + sin q K + (1 - cos q) K²) = (turn + turn K²) + sin q turn K - cos q turn K²
        self._sine, self._cosine = self._turn @ k, -self._turn @ k @ k
        self._still = self._turn - self._cosine
        # ancestors[i + 1, j]: joint j moves link i; row 0 is the base
        self.moves = np.zeros((self.count + 1, self.count), dtype=bool)
        for i in range(self.count):
            self.moves[i] = self.moves[self.parent[i]]
            self.moves[i, i] = True

    def __call__(self, q: np.ndarray) -> Poses:
        """Frames at q (N, n) [rad, m]."""
        count, q = len(q), self.coupling.positions(q)
        angle = np.where(self.prismatic, 0.0, q)
        local = (
            self._still + np.sin(angle)[:, :, None, None] * self._sine + np.cos(angle)[:, :, None, None] * self._cosine
        )
        rotation = np.empty((count, self.count + 1, 3, 3))
        origin = np.zeros((count, self.count + 1, 3))
        rotation[:, -1] = np.eye(3)
        for j, parent in enumerate(self.parent):
            rotation[:, j] = rotation[:, parent] @ local[:, j]
            origin[:, j] = origin[:, parent] + rotation[:, parent] @ self._shift[j]
            if self.prismatic[j]:
                origin[:, j] += q[:, j, None] * (rotation[:, j] @ self._axis[j])
        axis = np.matmul(rotation[:, :-1], self._axis[:, :, None])[..., 0]
        return Poses(rotation, origin, axis)


def into(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (M, 3) in the frames that rotations (M, 3, 3) stand for."""
    return np.matmul(vectors[:, None], rotation)[:, 0]
