"""Constraints that keep bodies apart: fixed planes between convex pieces that are near each other at places of a curve.

The body `b` that fewer joints move holds the plane and touches it. The other body `a` must stay beyond it:

    f = n·(p - o) - h,    n, o: normal and origin in b's frame,    p: the vertex of a that lies lowest over the plane

If f >= 0 for every vertex, the bodies are apart by at least f. A few of the lowest vertices, not close to each other,
are fixed with the plane, so that the body cannot turn around one vertex through the plane. Only joints between a and b
move p relative to the plane. With z_j the axis of a joint, o_j a point on it and w_j = z_j × (p - o_j) the velocity of
p per turn,

    df/dq_j = n·w_j        d²f/dq_i dq_j = n·(z_i × w_j) = (n × z_i)·w_j    for i above or at j

These closed forms need only the axes and are computed for all constraints at once. A joint that slides has w_j = z_j
and turns nothing. Derivatives by followers are added to those of their leaders (see `robot.kinematics.Coupling`).
"""

from __future__ import annotations

import numpy as np

from energy_opt.cell.bodies import Bodies
from energy_opt.cell.solids import Gauge, Piece
from energy_opt.numerics.hulls import Hulls
from energy_opt.robot.kinematics import Poses, cross, into

LENGTH = 0.1  # [m] unit of constraints, so that they are of order one
OVERLAP = 2e-5  # [m] pieces that are nearer than this count as overlapping: ends of moves are farther from all bodies
MOST = 2  # most pieces of a pair of bodies at a place, the nearest ones: more make steps slow
VERTICES = 3  # most vertices of a near pair with a constraint
BESIDE, ABOVE = 0.02, 0.02  # [m] least distance between these vertices; largest height over the lowest one
TURNING = 0.03  # [m] pairs that are farther apart get one constraint, for the lowest vertex
NOTHING = 1e-5  # share of the largest multiplier: slack constraints have less, and do not count in the Hessian
KEYS, POINTS = 100_000, 100_000  # sizes of the key ranges for places within a pair of pieces, and for vertices


class Near:
    """Pairs of convex pieces that are near each other along a curve, with their distances and planes between them.

    The last plane of each pair is kept by place. If it still shows that the pair is farther apart than what is asked
    about, the pair is not measured again.

    Args:
        bodies: the bodies and pairs.
        free: (K, n) poses that are known to be free. Pairs of pieces that overlap at these poses are left out: a body
            that is not convex lies within its pieces, and no plane separates it there. The proof of clearance still
            covers them.
    """

    def __init__(self, bodies: Bodies, free: np.ndarray | None = None) -> None:
        self.bodies = bodies
        pieces = [(i, piece) for i, body in enumerate(bodies.all) for piece in body.solid.pieces]
        self.body = np.array([i for i, _ in pieces], dtype=int)
        self.pieces: tuple[Piece, ...] = tuple(piece for _, piece in pieces)
        self.radius = np.array([piece.radius for piece in self.pieces])
        self.flat = bodies.flat[self.body]
        points = [
            np.zeros((1, 3)) + bodies.shift[i] if bodies.flat[i] else p.points @ bodies.rotation[i].T + bodies.shift[i]
            for i, p in pieces
        ]  # in the frame of the joint
        face = np.where(self.flat[:, None], bodies.rotation[self.body, :, 2], 0.0)
        self._hulls = Hulls(points, self.radius, bodies.joint[self.body], face)
        self.clouds = self._hulls.clouds
        # a plane is fixed in the second body, so no joint may move that body alone
        of = [np.flatnonzero(self.body == i) for i in range(len(bodies.all))]
        usable = np.flatnonzero(~bodies.moves[1].any(axis=1) & ~bodies.flat[bodies.pairs[:, 0]])
        triples = [(p, i, j) for p in usable.tolist() for i in of[bodies.pairs[p, 0]] for j in of[bodies.pairs[p, 1]]]
        self.pair, self.a, self.b = np.array(triples, dtype=int).reshape(-1, 3).T
        self._measures: dict[int, Gauge] = {}
        self._kept = np.zeros(0), np.zeros((0, 0, 3))
        if free is not None:
            self._pass_over(free)

    def _pass_over(self, free: np.ndarray) -> None:
        """Leave out pairs of pieces that overlap at poses free (K, n); see the class."""
        at = np.linspace(0, 1, len(free))
        while True:  # of each pair of bodies, `MOST` pairs of pieces are measured
            _, hidden, _, _, _ = self.measured(at, free, OVERLAP)
            if not len(hidden):
                return
            seen = np.setdiff1d(np.arange(len(self.pair)), hidden)
            self.pair, self.a, self.b = self.pair[seen], self.a[seen], self.b[seen]
            self._measures, self._kept = {}, (np.zeros(0), np.zeros((0, 0, 3)))

    def measured(
        self, u: np.ndarray, q: np.ndarray, reach: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, Poses]:
        """Pairs of pieces that are nearer than `reach` at places u (K,) and positions q (K, n); of two bodies the MOST
        nearest pieces.

        Returns:
            Place, number of the pair of pieces, distance [m] (negative: overlap) and unit normal (from the second
                towards the first, in the base frame), (M,) or (M, 3) each; and the poses of the links.
        """
        poses = self.bodies.poses(q, u)
        normals = self._planes(u)
        distances = self._hulls.apart(poses.rotation, poses.origin, self.a, self.b, reach, normals)
        self._measure(poses, distances, normals)
        k, number = np.nonzero(distances < reach)
        distance, normal = distances[k, number], normals[k, number]
        # Sort by place, pair of bodies and distance; then rank counts the pairs of pieces within a pair of bodies at a
        # place.
        order = np.lexsort((distance, self.pair[number], k))
        name = k[order] * len(self.bodies.pairs) + self.pair[number[order]]
        first = np.flatnonzero(np.diff(name, prepend=-1))
        rank = np.arange(len(order)) - np.repeat(first, np.diff(np.append(first, len(order))))
        order = order[rank < MOST]
        return k[order], number[order], distance[order], normal[order], poses

    def _planes(self, u: np.ndarray) -> np.ndarray:
        """The last normals (K, pairs of pieces, 3) at places u (K,), those of the nearest places before where u is new;
        zero where there is none. What is written to them is kept.
        """
        if not np.array_equal(self._kept[0], u):
            old, normals = self._kept
            if len(old):
                normals = normals[np.abs(u[:, None] - old).argmin(axis=1)]
            else:
                normals = np.zeros((len(u), len(self.pair), 3))
            self._kept = u.copy(), normals
        return self._kept[1]

    def _measure(self, poses: Poses, distances: np.ndarray, normals: np.ndarray) -> None:
        """Replace distances (K, pairs of pieces) [m] that are NaN, and their normals (K, pairs of pieces, 3)."""
        k, number = np.nonzero(np.isnan(distances))
        of_a, of_b = self.body[self.a[number]], self.body[self.b[number]]
        placed = self.bodies.placements(poses, np.tile(k, 2), np.concatenate([of_a, of_b]))
        for place, one, a, b in zip(*(column.tolist() for column in (k, number, of_a, of_b)), strict=True):
            measure = self._measures.get(one)
            if measure is None:
                measure = self._measures[one] = Gauge(self.pieces[self.a[one]], self.pieces[self.b[one]])
            distances[place, one] = measure(placed[place, a], placed[place, b])
            normals[place, one] = measure.normal

    def constraints(self, u: np.ndarray, q: np.ndarray, margin: np.ndarray, reach: float) -> PlaneConstraints:
        """Constraints at places u (K,) and positions q (K, n), for pairs that are nearer than `reach` [m] there.

        Args:
            margin: (K, P) what each pair keeps at each place [m].
        """
        k, number, distance, normal, poses = self.measured(u, q, reach)
        return PlaneConstraints(self, u, q, poses, (k, number, distance, normal), margin)


class PlaneConstraints:
    """Constraints at places: heights of vertices over fixed planes, in units of LENGTH.

    It has the interface of `motion.limits.base.PlaceConstraints`.

    Args:
        near: the pieces. u: (K,) places. q, poses: (K, n) and those of the links there, where the planes were found.
        found: place, number, distance and normal of each plane, as `Near.measured` returns them.
        margin: (K, P) [m] the clearance of each pair at each place.
    """

    def __init__(
        self, near: Near, u: np.ndarray, q: np.ndarray, poses: Poses, found: tuple[np.ndarray, ...], margin: np.ndarray
    ) -> None:
        bodies = self._bodies = near.bodies
        self.u, self._found_at = u, (q, poses)
        k, number, distance, normal = found
        # the plane of a half-space is its boundary, whatever was found
        flat = np.flatnonzero(near.flat[near.b[number]])
        normal[flat] = bodies.frames(poses, k[flat], near.body[near.b[number[flat]]])[0][:, :, 2]
        joint_a = bodies.joint[near.body[near.a[number]]]
        down = into(poses.rotation[k, joint_a], normal)
        spread = near.clouds.spread(near.a[number], down, distance < TURNING, VERTICES, ABOVE, BESIDE)
        which, column = np.nonzero(spread >= 0)
        vertex = spread[which, column]
        order = np.lexsort((vertex, number[which], k[which]))
        which, vertex = which[order], vertex[order]
        self.place, number, normal = k[which], number[which], normal[which]
        a, b, pair = near.a[number], near.b[number], near.pair[number]
        name = np.round(u[self.place] * (KEYS - 1)).astype(np.int64)
        self.keys = (number * KEYS + name) * POINTS + vertex
        self.lower = margin[self.place, pair] / LENGTH
        self.upper = np.full(len(which), np.inf)
        self._joint_a, self._joint_b = bodies.joint[near.body[a]], bodies.joint[near.body[b]]
        self._moves = bodies.moves[0][pair]
        self._normal = into(poses.rotation[self.place, self._joint_b], normal)  # in the frame of b's joint
        self._point = near.clouds.points(a, vertex)
        self._height = -near.clouds.lowest(b, -self._normal)[1] + near.radius[a] + near.radius[b]
        self._at: np.ndarray | None = None

    def _move(self, q: np.ndarray) -> None:
        """Compute heights, normals, axes and vertex velocities at q (K, n), unless q is the last argument."""
        if self._at is q:
            return
        self._at = q
        found_at, poses = self._found_at
        if not np.array_equal(q, found_at):
            poses = self._bodies.poses(q, self.u)
        k = self.place
        n = np.matmul(poses.rotation[k, self._joint_b], self._normal[:, :, None])[..., 0]
        point = np.matmul(poses.rotation[k, self._joint_a], self._point[:, :, None])[..., 0]
        point += poses.origin[k, self._joint_a]
        self._f = np.sum(n * (point - poses.origin[k, self._joint_b]), axis=1) - self._height
        self._n, self._axis = n, poses.axis[k]
        swept = cross(self._axis, point[:, None] - poses.origin[k][:, : self._axis.shape[1]])
        slides = self._bodies.kinematics.prismatic
        self._w = np.where(slides[:, None], self._axis, swept) * self._moves[:, :, None]

    def value(self, q: np.ndarray) -> np.ndarray:
        """(R,) heights over the planes, in units of `LENGTH`."""
        self._move(q)
        return self._f / LENGTH

    def gradient(self, q: np.ndarray) -> np.ndarray:
        """df/dq (R, n) in units of LENGTH per rad (or m)."""
        self._move(q)
        return self._bodies.kinematics.coupling.joined(np.matmul(self._w, self._n[:, :, None])[..., 0]) / LENGTH

    def hessian(self, q: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """Sum of multipliers times Hessians at each place, (K, n, n).

        `above` selects pairs (i, j) with i above or at j, for which the formula of the module holds; the rest follows
        by symmetry.

        Args:
            q: (K, n). multipliers: (R,) of the constraints.
        """
        self._move(q)
        kinematics = self._bodies.kinematics
        above = kinematics.moves[: kinematics.count].T  # (L, L): joint i moves joint j, or is it
        size = np.abs(multipliers)
        acts = np.flatnonzero(size > NOTHING * size.max(initial=0.0))
        turned = cross(self._n[acts, None], self._axis[acts]) * (self._moves[acts] & ~kinematics.prismatic)[:, :, None]
        h = np.matmul(turned, self._w[acts].transpose(0, 2, 1)) * (multipliers[acts] / LENGTH)[:, None, None] * above
        out = np.zeros((len(self.u), *h.shape[1:]))
        np.add.at(out, self.place[acts], h)
        out += (out * ~np.eye(len(above), dtype=bool)).transpose(0, 2, 1)
        return kinematics.coupling.joined(kinematics.coupling.joined(out), axis=1)
