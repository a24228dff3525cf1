"""Rows that keep bodies apart: at places along a curve, frozen planes between convex pieces that are near there.

A plane is held by the body that fewer joints move (`b`), touches it, and has the other one (`a`) beyond it:

    f = n·(p - o) - h,    n, o: normal and origin in b's frame,    p: the vertex of a that lies lowest over the plane

As long as f >= 0 for every vertex, the bodies are apart by at least f. Only joints between a and b move p against the
plane; with z_j a joint's axis, o_j a point of it and w_j = z_j × (p - o_j) the velocity that it gives p,

    df/dq_j = n·w_j        d²f/dq_i dq_j = n·(z_i × w_j) = (n × z_i)·w_j    for i above or at j

which needs nothing but the axes: closed forms, for all rows at once. Joints that slide have w_j = z_j and turn nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from energy_opt.cell.bodies import Bodies, Scenery
from energy_opt.cell.solids import Plane
from energy_opt.robot.kinematics import Poses

LENGTH = 0.1  # [m] that rows are divided by, so that they are of order one


@dataclass(frozen=True)
class Pieces:
    """Two convex pieces of a pair: the pair's number, and which pieces of its first and second body."""

    pair: int
    a: int
    b: int


class Near:
    """Finds planes between the pieces of a cell's bodies; what measures them is kept."""

    def __init__(self, bodies: Bodies) -> None:
        self.bodies = bodies
        # a plane needs a body that holds it still while the other moves: not one that joints of its own branch move
        self.usable = ~bodies.moves[1].any(axis=1)
        self._pieces: dict[int, list[tuple[int, Pieces, Plane]]] = {}
        self._count = 0

    def pieces(self, pair: int) -> list[tuple[int, Pieces, Plane]]:
        """All pairs of pieces of a pair, each with a number of its own."""
        if pair not in self._pieces:
            a, b = (self.bodies.all[k].solid.pieces for k in self.bodies.pairs[pair])
            made = [Pieces(pair, i, j) for i in range(len(a)) for j in range(len(b))]
            numbered = [(self._count + k, m, Plane(a[m.a], b[m.b])) for k, m in enumerate(made)]
            self._count += len(made)
            self._pieces[pair] = numbered
        return self._pieces[pair]

    def rows(
        self, u: np.ndarray, q: np.ndarray, margin: np.ndarray, reach: float, forced: set[tuple[int, int]]
    ) -> PlaneRows:
        """Rows at places u (K,), positions q (K, n), for what is nearer than `reach` [m] there.

        Args:
            margin: (K, P) what each pair keeps at each place [m].
            forced: places and pairs that get a row however far they are.
        """
        bodies, scene = self.bodies, Scenery(self.bodies, q)
        pairs = np.flatnonzero(self.usable)
        k, p = np.repeat(np.arange(len(u)), len(pairs)), np.tile(pairs, len(u))
        floor, _, _ = scene.apart(k, p)
        near = floor < reach
        if forced:
            code = k * len(bodies.pairs) + p
            near |= np.isin(code, [place * len(bodies.pairs) + pair for place, pair in forced])
        found = []
        for place, pair in zip(k[near].tolist(), p[near].tolist(), strict=True):
            a, b = bodies.pairs[pair].tolist()
            at, bt = scene.placed(place, a), scene.placed(place, b)
            numbered = self.pieces(pair)
            measured = [(plane(at, bt), number, pieces) for number, pieces, plane in numbered]
            least = min(witness.distance for witness, _, _ in measured)
            limit = max(reach, least + 1e-9) if (place, pair) in forced else reach
            found += [(place, number, m, w) for w, number, m in measured if w.distance < limit]
        return PlaneRows(bodies, u, scene.poses, found, margin)


class PlaneRows:
    """The rows of one round (see `motion.limits.base.PlaceRows`): distances over planes, in units of `LENGTH`."""

    def __init__(
        self, bodies: Bodies, u: np.ndarray, poses: Poses, found: list, margin: np.ndarray
    ) -> None:  # found: (place, number, pieces, witness)
        self.u, self._bodies = u, bodies
        self.place = np.array([place for place, _, _, _ in found], dtype=int)
        self.pair = np.array([m.pair for _, _, m, _ in found], dtype=int)
        numbers = np.array([number for _, number, _, _ in found], dtype=int)
        self.keys = numbers * 100_000 + np.round(u[self.place] * 90_000).astype(int)
        sides = bodies.pairs[self.pair]
        self._joint_a, self._joint_b = bodies.joint[sides[:, 0]], bodies.joint[sides[:, 1]]
        self._moves = bodies.moves[0][self.pair]
        turn = poses.rotation[self.place, self._joint_b]
        normal = np.array([w.normal for _, _, _, w in found]).reshape(-1, 3)
        self._normal = np.einsum("rij,ri->rj", turn, normal)  # in the frame of b's joint
        self._groups: list[tuple[np.ndarray, np.ndarray]] = []
        self._height = np.zeros(len(found))
        self._radius = np.zeros(len(found))
        by_a: dict[tuple[int, int], list[int]] = {}
        for r, (_, _, m, _) in enumerate(found):
            body_a, body_b = bodies.all[sides[r, 0]], bodies.all[sides[r, 1]]
            piece = body_b.solid.pieces[m.b]
            if body_b.solid.corners is None:  # a half-space: its own plane, whatever the witness says
                self._normal[r] = body_b.pose[:3, 2]
                self._height[r] = self._normal[r] @ body_b.pose[:3, 3]
            else:
                facing = self._normal[r] @ body_b.pose[:3, :3]
                self._height[r] = float((piece.points @ facing).max()) + piece.radius
                self._height[r] += self._normal[r] @ body_b.pose[:3, 3]
            self._radius[r] = body_a.solid.pieces[m.a].radius
            by_a.setdefault((int(sides[r, 0]), m.a), []).append(r)
        for (body, a), rows in by_a.items():
            pose = bodies.all[body].pose
            points = bodies.all[body].solid.pieces[a].points @ pose[:3, :3].T + pose[:3, 3]  # in the joint's frame
            self._groups.append((np.array(rows), points))
        self.lower = margin[self.place, self.pair] / LENGTH
        self.upper = np.full(len(found), np.inf)
        self._at: np.ndarray | None = None

    def _move(self, q: np.ndarray) -> None:
        if self._at is q:
            return
        self._at = q
        poses = self._bodies.kinematics(q)
        k = self.place
        ra, oa = poses.rotation[k, self._joint_a], poses.origin[k, self._joint_a]
        rb, ob = poses.rotation[k, self._joint_b], poses.origin[k, self._joint_b]
        n = np.matmul(rb, self._normal[:, :, None])[..., 0]
        inward = np.einsum("rij,ri->rj", ra, n)
        lowest = np.zeros((len(k), 3))
        for rows, points in self._groups:
            lowest[rows] = points[np.argmin(inward[rows] @ points.T, axis=1)]
        point = np.matmul(ra, lowest[:, :, None])[..., 0] + oa
        self._f = np.sum(n * (point - ob), axis=1) - self._height - self._radius
        slides = self._bodies.kinematics.prismatic
        axis = poses.axis[k]
        arm = point[:, None] - poses.origin[k][:, :-1]
        self._w = np.where(slides[:, None], axis, _cross(axis, arm)) * self._moves[:, :, None]
        self._n, self._axis = n, axis

    def value(self, q: np.ndarray) -> np.ndarray:
        """(R,) heights over the planes, in units of `LENGTH`."""
        self._move(q)
        return self._f / LENGTH

    def gradient(self, q: np.ndarray) -> np.ndarray:
        """(R, n)."""
        self._move(q)
        return np.matmul(self._w, self._n[:, :, None])[..., 0] / LENGTH

    def hessian(self, q: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """(K, n, n)."""
        self._move(q)
        slides = self._bodies.kinematics.prismatic
        turned = _cross(self._n[:, None], self._axis) * (self._moves & ~slides)[:, :, None]
        h = np.matmul(turned, self._w.transpose(0, 2, 1)) * (multipliers / LENGTH)[:, None, None]
        h = np.where(self._above, h, 0.0)
        out = np.zeros((len(self.u), *h.shape[1:]))
        np.add.at(out, self.place, h + np.where(self._strictly, h, 0.0).transpose(0, 2, 1))
        return out

    @cached_property
    def _above(self) -> np.ndarray:
        """(n, n): joint i moves joint j, or is it."""
        return self._bodies.kinematics.moves[:-1].T

    @cached_property
    def _strictly(self) -> np.ndarray:
        return self._above & ~np.eye(len(self._above), dtype=bool)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product over the last axis; NumPy's own is several times slower on many short vectors."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )
