"""Numeric rewriting of a kinematic tree, so that its symbolic dynamics become short. Torques do not change.

1. Each link frame is turned so that its joint axis is +z. Its origin slides along this axis (for a prismatic joint:
anywhere) to a place that leaves few non-zero offsets.
2. Inertia that the torque of a joint cannot distinguish from inertia of the parent is moved to the parent (base
parameters; Khalil and Kleinfinger, IEEE J. Robotics and Automation 3(6), 1987). With the 4 x 4 pseudo-inertia J =
[[S, h], [h', m]], S the second moment, h the first moment and m the mass, this is S_zz, h_z and m for a revolute joint
about z, and S for a prismatic joint.

The file also contains the building blocks of recursions over such a tree: vectors of three scalars, the change of frame
across a joint, and the inverse dynamics of a tree with followers (mimic joints) from that of the tree without.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from energy_opt.robot.kinematics import Coupling, Link, pseudo_inertia

ROUNDING = 1e-12  # entries this near to 0 and +-1 are rounding errors; coarser snapping would change torques
STEEP = 0.01  # least share of an axis along which an origin slides: it moves up to 100 offsets far, not kilometres


@dataclass(frozen=True)
class CanonicalLink:
    """A link whose joint axis is +z.

    Attributes:
        prismatic: whether the joint slides.
        parent: index of the parent link; -1 for the base.
        placement: (4, 4) pose in the parent's frame at q = 0.
        pseudo_inertia: (4, 4), see the module.
        from_original: (4, 4), from homogeneous coordinates in the link's original frame to this frame.
        armature: reflected rotor inertia [kg m^2].
    """

    prismatic: bool
    parent: int
    placement: np.ndarray
    pseudo_inertia: np.ndarray
    from_original: np.ndarray
    armature: float


def snapped(matrix: np.ndarray, tolerance: float = ROUNDING) -> np.ndarray:
    """A matrix of any shape; entries within `tolerance` of 0 and +-1 are made exact.

    Symbolic products with such entries vanish.
    """
    out = np.where(np.abs(matrix) < tolerance, 0.0, matrix)
    return np.where(np.abs(np.abs(out) - 1) < tolerance, np.sign(out), out)


def _pose(rotation: np.ndarray, offset: np.ndarray | None = None) -> np.ndarray:
    """The homogeneous matrix (4, 4) of a rotation (3, 3) and an offset (3,) [m]."""
    out = np.eye(4)
    out[:3, :3] = rotation
    if offset is not None:
        out[:3, 3] = offset
    return out


def _turn_to_z(axis: np.ndarray) -> np.ndarray:
    """A rotation Q (3, 3) with Q e_z = axis. If the axis is a coordinate axis, Q is a signed permutation, so it adds no
    products.
    """
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return snapped(np.column_stack([x, np.cross(axis, x), axis]))


class _Frames:
    """Placements of the turned frames, while their origins may still slide.

    Attributes:
        turn: (3, 3) of each link, see `_turn_to_z`. base: (4, 4) placements at q = 0 before sliding. shift: (3,) [m]
            how far each origin has moved, in its own turned frame. parent_turns: whether a revolute joint lies between
            the base and the parent; only then does an offset cost products.
    """

    def __init__(self, links: Sequence[Link]) -> None:
        self.links = links
        turn = [_turn_to_z(link.axis) for link in links]
        self.turn = turn
        self.base = []
        for k, link in enumerate(links):
            parent = _pose(turn[link.parent]) if link.parent >= 0 else np.eye(4)
            pose = parent.T @ link.placement @ _pose(turn[k])
            self.base.append(_pose(snapped(pose[:3, :3]), snapped(pose[:3, 3])))
        self.shift = [np.zeros(3) for _ in links]
        self.parent_turns = [False] * len(links)
        turns = [False] * len(links)
        for k, link in enumerate(links):
            self.parent_turns[k] = link.parent >= 0 and turns[link.parent]
            turns[k] = self.parent_turns[k] or not link.prismatic

    def offset(self, k: int) -> np.ndarray:
        """Origin of frame k in its parent's frame at q = 0, (3,)."""
        parent = self.links[k].parent
        moved = self.base[k][:3, 3] + self.base[k][:3, :3] @ self.shift[k]
        return snapped(moved - (self.shift[parent] if parent >= 0 else 0.0))

    def cost(self) -> int:
        """Non-zero offsets that the recursion must multiply by."""
        return sum(int(np.count_nonzero(self.offset(k))) for k in range(len(self.links)) if self.parent_turns[k])

    def slide(self) -> None:
        """Coordinate descent on `cost`, three rounds over all links.

        For each link it tries places of the origin that make one coordinate of an offset zero: of its own offset, and
        along its axis of its children's offsets. It keeps the cheapest.
        """
        z = np.array([0.0, 0.0, 1.0])
        for _ in range(3):
            for k, link in enumerate(self.links):
                rotation, offset, here = self.base[k][:3, :3], self.offset(k), self.shift[k]
                trials = [here]
                if link.prismatic:
                    trials.append(here - rotation.T @ offset)
                else:
                    axis = rotation[:, 2]
                    trials += [here - z * offset[i] / axis[i] for i in range(3) if abs(axis[i]) > STEEP]
                    trials += [here + z * self.offset(c)[2] for c, other in enumerate(self.links) if other.parent == k]
                costs = []
                for trial in trials:
                    self.shift[k] = trial
                    costs.append(self.cost())
                self.shift[k] = trials[int(np.argmin(costs))]


def canonical(links: Sequence[Link]) -> tuple[CanonicalLink, ...]:
    """The tree in canonical frames with base-parameter inertias."""
    frames = _Frames(links)
    frames.slide()
    placement = [_pose(frames.base[k][:3, :3], frames.offset(k)) for k in range(len(links))]
    maps, inertias = [], []
    for k, link in enumerate(links):
        maps.append(np.linalg.inv(_pose(frames.turn[k]) @ _pose(np.eye(3), frames.shift[k])))
        inertias.append(maps[k] @ pseudo_inertia(link.mass, link.lever, link.inertia) @ maps[k].T)
    for k in reversed(range(len(links))):
        # Base parameters: the part of the pseudo-inertia without effect on this joint's torque moves to the parent. The
        # pseudo-inertia of a link in another frame is T J T^T.
        hidden = np.zeros((4, 4))
        if links[k].prismatic:
            hidden[:3, :3] = inertias[k][:3, :3]
        else:
            hidden[2:, 2:] = inertias[k][2:, 2:]
        inertias[k] = inertias[k] - hidden
        if links[k].parent >= 0:
            inertias[links[k].parent] = inertias[links[k].parent] + placement[k] @ hidden @ placement[k].T
    return tuple(
        CanonicalLink(
            link.prismatic, link.parent, placement[k], snapped(inertias[k], 1e-14), snapped(maps[k]), link.armature
        )
        for k, link in enumerate(links)
    )


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
    """Positions, velocities and accelerations of all L joints of a tree from those of the n independent ones.

    With the coupling matrix G (L, n) and offset q0: q_all = G q + q0, v_all = G v, a_all = G a. Without followers, the
    arguments are returned as they are.
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


NAMES = ["q", "v", "a", "gravity", "mass", "com"]


def coupled(function: ca.Function, coupling: Coupling) -> ca.Function:
    """(q, v, a, gravity, mass, com) -> tau (n, 1) of the independent joints, from a function for all L joints.

    By virtual work tau = G^T tau_all: the torque of a joint is its own plus that of each follower times its ratio.
    """
    if coupling.trivial:
        return function
    q, v, a = (ca.SX.sym(name, len(coupling.own)) for name in NAMES[:3])
    gravity, mass, com = ca.SX.sym("gravity", 3), ca.SX.sym("mass"), ca.SX.sym("com", 3)
    tau = function(*all_joints(coupling, q, v, a), gravity, mass, com)
    joined = ca.mtimes(ca.sparsify(ca.DM(coupling.matrix)).T, tau)
    return ca.Function("tau", [q, v, a, gravity, mass, com], [joined], NAMES, ["tau"])
