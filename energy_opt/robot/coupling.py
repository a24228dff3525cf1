"""Joints that follow others: from the joints that move by themselves to all of them, and back.

With q the n joints that move by themselves, the positions of all L joints of an arm are G q + g, with a row of G for
each: a unit for a joint of its own, its ratio in the leader's column for one that follows. Velocities and accelerations
are G v and G a. By virtual work, torques (and gradients, and the columns of Jacobians) of all joints act on the n as
G^T tau: that of a leader is its own plus its followers', each times its ratio.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.robot.links import Link


@dataclass(frozen=True, eq=False)
class Coupling:
    """How all joints of an arm hang on those that move by themselves.

    Attributes:
        matrix: G (L, n).
        offset: g (L,) [rad, m].
        own: (n,) indices, among all L, of the joints that move by themselves.
    """

    matrix: np.ndarray
    offset: np.ndarray
    own: np.ndarray

    @classmethod
    def of(cls, links: Sequence[Link]) -> Coupling:
        """That of an arm's links."""
        own = np.array([k for k, link in enumerate(links) if link.follows is None], dtype=int)
        matrix, offset = np.zeros((len(links), len(own))), np.zeros(len(links))
        matrix[own, np.arange(len(own))] = 1.0
        for k, link in enumerate(links):
            if link.follows is not None:
                matrix[k] = link.follows.ratio * matrix[link.follows.leader]
                offset[k] = link.follows.offset
        return cls(matrix, offset, own)

    @property
    def trivial(self) -> bool:
        """Whether every joint moves by itself."""
        return len(self.matrix) == len(self.own)

    def positions(self, q: np.ndarray) -> np.ndarray:
        """All joints' (..., L), from those of the joints that move by themselves (..., n)."""
        return q if self.trivial else q @ self.matrix.T + self.offset

    def rates(self, v: np.ndarray) -> np.ndarray:
        """All joints' velocities or accelerations (..., L) from (..., n)."""
        return v if self.trivial else v @ self.matrix.T

    def reach(self, far: np.ndarray) -> np.ndarray:
        """How far each joint can go (..., L) while those that move by themselves go at most `far` (..., n)."""
        return far if self.trivial else far @ np.abs(self.matrix).T

    def reach_back(self, x: np.ndarray) -> np.ndarray:
        """How large torques by the n joints can be (..., n) where those of all joints are at most x (..., L)."""
        return x if self.trivial else x @ np.abs(self.matrix)

    def joined(self, x: np.ndarray, axis: int = -1) -> np.ndarray:
        """G^T x along an axis of length L: torques or derivatives, by the n joints that move by themselves."""
        return x if self.trivial else np.moveaxis(np.moveaxis(x, axis, -1) @ self.matrix, -1, axis)
