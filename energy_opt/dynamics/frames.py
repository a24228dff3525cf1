"""Vectors of three scalars and the change of frame across a joint: what recursions over a tree are written with."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from energy_opt.dynamics.canonical import CanonicalLink
from energy_opt.robot.coupling import Coupling

Vector = list[ca.SX]


def cross(a: Sequence[ca.SX], b: Sequence[ca.SX]) -> Vector:
    """a x b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def plus(a: Sequence[ca.SX], b: Sequence[ca.SX]) -> Vector:
    """a + b."""
    return [x + y for x, y in zip(a, b, strict=True)]


def times(matrix: Sequence[Sequence[float | ca.SX]], x: Sequence[ca.SX]) -> Vector:
    """Matrix (3, 3) times vector."""
    return [row[0] * x[0] + row[1] * x[1] + row[2] * x[2] for row in matrix]


def all_joints(coupling: Coupling, q: ca.SX, v: ca.SX, a: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Positions, velocities and accelerations of all joints of a tree, (L, 1) each, from those that move by themselves.

    Each is (n, 1) and comes back as it is where nothing follows.
    """
    if coupling.trivial:
        return q, v, a
    matrix = ca.sparsify(ca.DM(coupling.matrix))
    return ca.mtimes(matrix, q) + ca.DM(coupling.offset), ca.mtimes(matrix, v), ca.mtimes(matrix, a)


class JointFrame:
    """Change of frame between a link and its parent at joint position q; the joint's axis is z."""

    def __init__(self, link: CanonicalLink, q: ca.SX) -> None:
        rotation = link.placement[:3, :3]
        self._down, self._up = rotation.T.tolist(), rotation.tolist()
        self.offset: Vector = [ca.SX(float(x)) for x in link.placement[:3, 3]]
        self._prismatic = link.prismatic
        if link.prismatic:
            self.offset = [o + float(rotation[i, 2]) * q for i, o in enumerate(self.offset)]
        else:
            self._c, self._s = ca.cos(q), ca.sin(q)

    def down(self, x: Sequence[ca.SX]) -> Vector:
        """A vector of the parent's frame in the link's."""
        y = times(self._down, x)
        if self._prismatic:
            return y
        return [self._c * y[0] + self._s * y[1], self._c * y[1] - self._s * y[0], y[2]]

    def up(self, x: Sequence[ca.SX]) -> Vector:
        """A vector of the link's frame in the parent's."""
        if self._prismatic:
            return times(self._up, x)
        return times(self._up, [self._c * x[0] - self._s * x[1], self._s * x[0] + self._c * x[1], x[2]])
