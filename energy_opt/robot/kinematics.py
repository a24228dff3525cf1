"""An arm as plain numbers: links, laws of followers (mimic joints), and frames of links at many configurations.

With q the positions of the n independent joints, the positions of all L joints are G q + g. G has a row for each joint:
a unit row for an independent joint, and the ratio in the leader's column for a follower. Velocities and accelerations
are G v and G a. By virtual work, torques of all joints act on the n independent ones as G^T tau: a leader's torque is
its own plus each follower's times its ratio. The same holds for gradients and for columns of Jacobians.

Arrays over links have L + 1 entries: the last one, which index -1 reaches, is the base.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.errors import BadInput

TURN = 4 * np.pi  # [rad] largest angle of a pose, two turns: larger ones are degrees


@dataclass(frozen=True)
class PointMass:
    """A point mass.

    Attributes:
        mass: [kg]. com: (3,) [m] its place in the last joint's frame.
    """

    mass: float
    com: np.ndarray


@dataclass(frozen=True)
class Follows:
    """The law of a follower (mimic joint): its position is `ratio` times that of the leader plus `offset`.

    Attributes:
        leader: index of an independent joint. ratio: [rad/rad, m/rad or rad/m]. offset: [rad or m].
    """

    leader: int
    ratio: float
    offset: float


@dataclass(frozen=True)
class Link:
    """One moving link and the joint that carries it, as plain numbers.

    Attributes:
        name: the joint's name.
        prismatic: True if it slides along `axis`, False if it turns about it.
        continuous: a revolute joint without an end.
        parent: index of the parent link, -1 for the base.
        placement: (4, 4) pose of the joint's frame in the parent's at q = 0.
        axis: (3,) unit vector in the joint's frame.
        mass, lever, inertia: kg, (3,) m to the centre of mass, (3, 3) kg m^2 about the centre of mass.
        armature: reflected rotor inertia, kg m^2 (0 unless the model states it).
        follows: law of a follower (mimic joint); None for an independent joint.
    """

    name: str
    prismatic: bool
    continuous: bool
    parent: int
    placement: np.ndarray
    axis: np.ndarray
    mass: float
    lever: np.ndarray
    inertia: np.ndarray
    armature: float
    follows: Follows | None = None


def no_degrees(where: str, angles: Sequence[float]) -> None:
    """Check that R,P,Y [rad] turn no more than twice.

    Raises:
        BadInput: one turns more, as degrees would; the line begins with `where`.
    """
    turn = max(angles, key=abs)
    if abs(turn) > TURN:
        raise BadInput(f"{where}: R,P,Y in degrees? Expected rad ({turn:g} deg = {np.radians(turn):.4g} rad)")


def pose_of(position: Sequence[float], rpy: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(4, 4) pose from a position [m] and roll, pitch, yaw [rad] as URDF has them: Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    out = np.eye(4)
    out[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    out[:3, 3] = position
    return out


def pseudo_inertia(mass: float, lever: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """The pseudo-inertia (4, 4) [[S, h], [h^T, m]] from mass, centre of mass and inertia.

    With the inertia I_o about the origin, S = trace(I_o) / 2 - I_o is the second moment, and h = m c the first one.
    Pseudo-inertias of bodies add up, and become T J T^T in another frame (Wensing, Kim and Slotine, IEEE Robotics and
    Automation Letters 3(1), 2018).

    Args:
        mass: [kg]. lever: (3,) [m] centre of mass. inertia: (3, 3) [kg m^2] about the centre of mass.
    """
    centre = np.append(lever, 1.0)
    out = mass * np.outer(centre, centre)
    out[:3, :3] += np.trace(inertia) / 2 * np.eye(3) - inertia
    return out


BRANCH = 3  # independent joints from which a branch is named, not taken for a finger or the rod of a linkage


def fingers(links: Sequence[Link]) -> frozenset[int]:
    """Indices of the links of grippers: short branches side by side at the end of an arm, the longest of equal length.

    They have less than `BRANCH` independent joints each, the arm before them has more. Their followers follow one of
    them; the rods of a linkage follow joints of the arm.
    """
    behind = [_behind(links, k) for k in range(len(links))]
    out: set[int] = set()
    for k, arm in enumerate(behind):
        beyond = {i: path[: path.index(k)] for i, path in enumerate(behind) if k in path and i != k}
        branches: dict[int, list[int]] = {}
        for i, path in beyond.items():
            branches.setdefault(path[-1], []).append(i)
        lengths = sorted(max(len(beyond[i]) for i in branch) for branch in branches.values())
        if (
            len(lengths) > 1
            and lengths[-1] == lengths[-2]
            and _independent(links, arm) >= BRANCH
            and all(_independent(links, branch) < BRANCH for branch in branches.values())
            and all(law is None or law.leader in beyond for law in (links[i].follows for i in beyond))
        ):
            out.update(beyond)
    return frozenset(out)


def _independent(links: Sequence[Link], some: Sequence[int]) -> int:
    """How many of some joints follow no other."""
    return sum(links[k].follows is None for k in some)


def outermost(links: Sequence[Link]) -> int:
    """Index of the link with most joints between it and the base, the last of several: this is "the last joint".

    On a chain it is the last one; rods of a linkage besides the chain and fingers are not chosen.
    """
    held = fingers(links)
    return max((k for k in range(len(links)) if k not in held), key=lambda k: (len(_behind(links, k)), k))


def other_ends(links: Sequence[Link]) -> list[str]:
    """The last joint of each branch that leaves the chain of "the last joint"."""
    chosen, ends = set(_behind(links, outermost(links))), dict[int, list[int]]()
    for k in sorted(set(range(len(links))) - fingers(links)):
        own = [i for i in _behind(links, k) if i not in chosen]
        if _independent(links, own) >= BRANCH:
            ends[own[-1]] = max(ends.get(own[-1], []), own, key=len)
    return [links[own[0]].name for own in ends.values()]


def _behind(links: Sequence[Link], k: int) -> list[int]:
    """Indices of the links between the base and link `k`, which is the first of them."""
    out = []
    while k >= 0:
        out.append(k)
        k = links[k].parent
    return out


@dataclass(frozen=True, eq=False)
class Coupling:
    """How the positions of all joints follow from those of the independent joints (see the module).

    Attributes:
        matrix: G (L, n).
        offset: g (L,) [rad, m].
        own: (n,) indices, among all L, of the independent joints.
    """

    matrix: np.ndarray
    offset: np.ndarray
    own: np.ndarray

    @classmethod
    def of(cls, links: Sequence[Link]) -> Coupling:
        """The coupling of an arm's links."""
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
        """Whether every joint is independent."""
        return len(self.matrix) == len(self.own)

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Positions (..., L) of all joints from those (..., n) of the independent ones: G q + g."""
        return q if self.trivial else q @ self.matrix.T + self.offset

    def rates(self, v: np.ndarray) -> np.ndarray:
        """Velocities or accelerations (..., L) of all joints from (..., n): G v."""
        return v if self.trivial else v @ self.matrix.T

    def reach(self, far: np.ndarray) -> np.ndarray:
        """Largest change (..., L) of each joint, |G| far, if the independent ones change by at most `far` (..., n)."""
        return far if self.trivial else far @ np.abs(self.matrix).T

    def reach_back(self, x: np.ndarray) -> np.ndarray:
        """Largest torque (..., n) at the independent joints, |G|^T x, if those of all joints are at most x (..., L)."""
        return x if self.trivial else x @ np.abs(self.matrix)

    def joined(self, x: np.ndarray, axis: int = -1) -> np.ndarray:
        """G^T x along an axis of length L: torques or derivatives, by the n joints that move by themselves."""
        return x if self.trivial else np.moveaxis(np.moveaxis(x, axis, -1) @ self.matrix, -1, axis)


def idle(links: Sequence[Link], coupling: Coupling, moves: np.ndarray) -> np.ndarray:
    """Which joints (n,) have no task in a motion: fingers, and joints of branches where no joint moves.

    Joints that all branches share belong to each of them. Without a branch that moves, the one of "the last joint" has
    the task.

    Args:
        moves: (n,) joints that end elsewhere than they start.
    """
    held = fingers(links)
    inner = {link.parent for k, link in enumerate(links) if k not in held}
    ends = [k for k in range(len(links)) if k not in held and k not in inner]
    branches = np.array([(coupling.matrix[_behind(links, k)] != 0).any(axis=0) for k in ends])
    active = (branches & moves & ~branches.all(axis=0)).any(axis=1)
    if not active.any():
        active = np.array([k == outermost(links) for k in ends])
    out: np.ndarray = ~branches[active].any(axis=0) & ~moves
    return out


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
    """Forward kinematics of a fixed-base tree of joints with one degree of freedom each.

    Attributes:
        count: L. parent: (L,). prismatic: (L,). moves: (L + 1, L) whether joint j moves link i; the last row is the
            base.
    """

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
        """Frames of all links at q (N, n) [rad, m].

        The frame of a joint turns by Rodrigues' formula R(q) = 1 + sin q K + (1 - cos q) K^2 with K the cross-product
        matrix of the axis. Products with the placement are precomputed.
        """
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
    """Vectors (M, 3) in the frames with rotations (M, 3, 3): R^T x."""
    return np.matmul(vectors[:, None], rotation)[:, 0]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product over the last axis; NumPy's own is several times slower on many short vectors."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )
