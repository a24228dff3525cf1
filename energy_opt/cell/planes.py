"""Rows that keep bodies apart: at places along a curve, frozen planes between convex pieces that are near there.

A plane is held by the body that fewer joints move (`b`), touches it, and has the other one (`a`) beyond it:

    f = n·(p - o) - h,    n, o: normal and origin in b's frame,    p: the vertex of a that lies lowest over the plane

As long as f >= 0 for every vertex, the bodies are apart by at least f; the vertex is frozen with the plane. Only joints
between a and b move p against the plane; with z_j a joint's axis, o_j a point of it and w_j = z_j × (p - o_j) the
velocity that it gives p,

    df/dq_j = n·w_j        d²f/dq_i dq_j = n·(z_i × w_j) = (n × z_i)·w_j    for i above or at j

which needs nothing but the axes: closed forms, for all rows at once. Joints that slide have w_j = z_j and turn nothing.
Derivatives by joints that follow others go to those that lead (see `robot.coupling`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from energy_opt.cell.bodies import Bodies, Scenery
from energy_opt.cell.solids import Piece, Plane
from energy_opt.robot.kinematics import Poses, into

LENGTH = 0.1  # [m] that rows are divided by, so that they are of order one
MOST = 6  # pieces of a pair of bodies that get rows at a place, the nearest: with all, steps took ten times as long
KEYS = 100_000  # names of places within a pair of pieces


@dataclass(frozen=True, eq=False)
class Between:
    """Two convex pieces of a pair that has number `pair`; `number` is that of these pieces."""

    number: int
    pair: int
    a: Piece
    b: Piece
    plane: Plane


@dataclass(frozen=True, eq=False)
class Found:
    """Pieces that are near at a place, and the normal (3,) from the second towards the first, in the base frame."""

    place: int
    between: Between
    normal: np.ndarray


class Near:
    """Finds planes between the pieces of a cell's bodies; what measures them is kept."""

    def __init__(self, bodies: Bodies) -> None:
        self.bodies = bodies
        # a plane needs a body that holds it still while the other moves: not one that joints of its own branch move
        self._usable = np.flatnonzero(~bodies.moves[1].any(axis=1))
        self._pieces: dict[int, list[Between]] = {}
        self._count = 0

    def _between(self, pair: int) -> list[Between]:
        """All pairs of pieces of a pair."""
        if pair not in self._pieces:
            a, b = (self.bodies.all[k].solid.pieces for k in self.bodies.pairs[pair])
            made = [(p, q) for p in a for q in b]
            self._pieces[pair] = [Between(self._count + k, pair, p, q, Plane(p, q)) for k, (p, q) in enumerate(made)]
            self._count += len(made)
        return self._pieces[pair]

    def rows(
        self, u: np.ndarray, q: np.ndarray, margin: np.ndarray, reach: float, forced: Iterable[tuple[int, int]] = ()
    ) -> PlaneRows:
        """Rows at places u (K,), positions q (K, n), for what is nearer than `reach` [m] there.

        Args:
            margin: (K, P) what each pair keeps at each place [m].
            forced: places and pairs that get a row however far they are.
        """
        bodies, scene = self.bodies, Scenery(self.bodies, q)
        must = set(forced)
        k, p = np.repeat(np.arange(len(u)), len(self._usable)), np.tile(self._usable, len(u))
        floor, _, _ = scene.apart(k, p)
        near = floor < reach
        if must:
            near |= np.isin(k * len(bodies.pairs) + p, [place * len(bodies.pairs) + pair for place, pair in must])
        found: list[Found] = []
        for side in (0, 1):
            scene.place(k[near], bodies.pairs[p[near], side])
        for place, pair in zip(k[near].tolist(), p[near].tolist(), strict=True):
            a, b = bodies.pairs[pair].tolist()
            at, bt = scene.placed(place, a), scene.placed(place, b)
            between, limit = self._between(pair), reach
            is_forced = (place, pair) in must
            if len(between) > 1 and not is_forced and bodies.ruler(pair).near(at, bt) >= reach:
                continue
            measured = sorted(((*one.plane(at, bt), one) for one in between), key=lambda found: found[0])[:MOST]
            if is_forced:
                limit = max(reach, measured[0][0] + 1e-9)
            found += [Found(place, one, normal) for distance, normal, one in measured if distance < limit]
        return PlaneRows(bodies, u, scene.poses, found, margin)


class PlaneRows:
    """The rows of one round (see `motion.limits.base.PlaceRows`): heights over planes, in units of `LENGTH`.

    Args:
        poses: at the places u (K,), where the planes were found.
        margin: (K, P) what each pair keeps at each place [m].
    """

    def __init__(self, bodies: Bodies, u: np.ndarray, poses: Poses, found: list[Found], margin: np.ndarray) -> None:
        self.u, self._bodies = u, bodies
        self.place = np.array([one.place for one in found], dtype=int)
        pair = np.array([one.between.pair for one in found], dtype=int)
        number = np.array([one.between.number for one in found], dtype=int)
        self.keys = number * KEYS + np.round(u[self.place] * (KEYS - 1)).astype(int)
        self.lower = margin[self.place, pair] / LENGTH
        self.upper = np.full(len(found), np.inf)
        sides = bodies.pairs[pair]
        self._joint_a, self._joint_b = bodies.joint[sides[:, 0]], bodies.joint[sides[:, 1]]
        self._moves = bodies.moves[0][pair]
        normal = np.array([one.normal for one in found]).reshape(-1, 3)
        self._normal = into(poses.rotation[self.place, self._joint_b], normal)  # in the frame of b's joint
        flat = bodies.flat[sides[:, 1]]  # a half-space is its own plane, whatever was found
        self._normal[flat] = bodies.rotation[sides[flat, 1]][:, :, 2]
        turned = np.matmul(poses.rotation[self.place, self._joint_b], self._normal[:, :, None])[..., 0]
        inward = into(poses.rotation[self.place, self._joint_a], turned)
        self._point, radius = _lowest(bodies, sides[:, 0], [one.between.a for one in found], inward, -1.0)
        support, outer = _lowest(bodies, sides[:, 1], [one.between.b for one in found], self._normal, 1.0)
        support[flat] = bodies.shift[sides[flat, 1]]
        self._height = np.sum(support * self._normal, axis=1) + outer + radius
        self._at: np.ndarray | None = None

    def _move(self, q: np.ndarray) -> None:
        if self._at is q:
            return
        self._at = q
        poses, k = self._bodies.kinematics(q), self.place
        n = np.matmul(poses.rotation[k, self._joint_b], self._normal[:, :, None])[..., 0]
        point = np.matmul(poses.rotation[k, self._joint_a], self._point[:, :, None])[..., 0]
        point += poses.origin[k, self._joint_a]
        self._f = np.sum(n * (point - poses.origin[k, self._joint_b]), axis=1) - self._height
        self._n, self._axis = n, poses.axis[k]
        swept = _cross(self._axis, point[:, None] - poses.origin[k][:, :-1])
        slides = self._bodies.kinematics.prismatic
        self._w = np.where(slides[:, None], self._axis, swept) * self._moves[:, :, None]

    def value(self, q: np.ndarray) -> np.ndarray:
        """(R,) heights over the planes, in units of `LENGTH`."""
        self._move(q)
        return self._f / LENGTH

    def gradient(self, q: np.ndarray) -> np.ndarray:
        """(R, n)."""
        self._move(q)
        return self._bodies.kinematics.coupling.joined(np.matmul(self._w, self._n[:, :, None])[..., 0]) / LENGTH

    def hessian(self, q: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """(K, n, n)."""
        self._move(q)
        kinematics = self._bodies.kinematics
        above = kinematics.moves[:-1].T  # (L, L): joint i moves joint j, or is it
        turned = _cross(self._n[:, None], self._axis) * (self._moves & ~kinematics.prismatic)[:, :, None]
        h = np.matmul(turned, self._w.transpose(0, 2, 1)) * (multipliers / LENGTH)[:, None, None] * above
        out = np.zeros((len(self.u), *h.shape[1:]))
        np.add.at(out, self.place, h)
        out += (out * ~np.eye(len(above), dtype=bool)).transpose(0, 2, 1)
        return kinematics.coupling.joined(kinematics.coupling.joined(out), axis=1)


def _lowest(
    bodies: Bodies, body: np.ndarray, pieces: list[Piece], direction: np.ndarray, sign: float
) -> tuple[np.ndarray, np.ndarray]:
    """Of each piece the vertex that goes least (-1) or farthest (1) along a direction (R, 3), and the radius around it.

    Directions and vertices are in the frame of the joint that carries the body.
    """
    point, radius = np.zeros((len(pieces), 3)), np.array([piece.radius for piece in pieces])
    groups: dict[tuple[int, int], list[int]] = {}
    for r, (which, piece) in enumerate(zip(body.tolist(), pieces, strict=True)):
        groups.setdefault((which, id(piece)), []).append(r)
    for (which, _), rows in groups.items():
        points = pieces[rows[0]].points @ bodies.rotation[which].T + bodies.shift[which]
        point[rows] = points[np.argmax(sign * direction[rows] @ points.T, axis=1)]
    return point, radius


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
