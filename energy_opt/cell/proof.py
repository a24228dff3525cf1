"""The proof that a motion touches nothing, at every instant and not only at samples.

Take an interval of time, and the arm in its middle. If two bodies are d apart there, and their points come towards each
other by no more than s within the interval, then they are at least d - s apart during all of it. If d - s is not above
the clearance that is asked for, the interval is halved, for the pairs that are still open. All open intervals of one
size are processed together, so that array arithmetic is done once for all.

The cheapest of these tests closes a pair: boxes around the bodies, convex hulls, planes between hulls
(`least_heights`), convex pieces, meshes. A body that a mesh keeps apart cannot be inside the other one unless it was
inside at the start (`inside_at`): surfaces that never meet do not pass each other.

`least_heights` is a bound of second order in the joints' turns. Bodies that pass each other closely move along each
other and not towards each other: their points travel far while their distance hardly changes. For a unit vector n fixed
in body b, the bodies are apart by at least

    s(q) = min over vertices v of a: n·p_v(q)  -  max over vertices of b: n·p

This holds for any n; the normal between the nearest points is a good choice. With w_vj the velocity that joint j gives
vertex v, n·p_v changes by n·w_vj per turn of j. By Taylor's theorem, for turns of at most far_j from the middle,

    s(q) >= min_v (n·p_v - sum_j |n·w_vj| far_j) - max_b - T F

where T bounds how far points of a travel, and F is the sum of far_j over joints that turn. The reason: the second
derivatives are n·(z_i x w_vj), at most |w_vj| in size, and the sum of far_j |w_vj| is at most T in the whole interval.
In T and F, followers count as if they moved independently, as far as their leader moves them. In the sum over j they
are part of their leader's velocity w_vj.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from energy_opt.cell.bodies import Bodies, Scenery
from energy_opt.cell.curve import MotionCurve
from energy_opt.cell.shells import enclosed
from energy_opt.cell.solids import GJK_ERROR, Ruler, Solid
from energy_opt.robot.kinematics import cross, into

ROUNDING = 1e-9  # [m] margin for rounding errors


def turns(bodies: Bodies, pair: np.ndarray, far: np.ndarray) -> np.ndarray:
    """F (M,) [rad]: the sum over joints between the bodies of pairs (M,) of how far each may turn, far (M, L)."""
    return np.asarray(np.sum(far * (bodies.moves[0][pair] & ~bodies.kinematics.prismatic), axis=1))


def least_heights(
    scene: Scenery, k: np.ndarray, pair: np.ndarray, normal: np.ndarray, far: np.ndarray, rest: np.ndarray
) -> np.ndarray:
    """Lower bounds (M,) [m] of pairs' distances within intervals about configurations k (M,).

    Args:
        pair: (M,) of those that are `planar`.
        normal: (M, 3) unit vectors in the base frame, from the second body towards the first.
        far: (M, n) [rad, m] how far the joints that move by themselves go from the middle.
        rest: (M,) [m] T F.
    """
    bodies, poses = scene.bodies, scene.poses
    slides, (a, b) = bodies.kinematics.prismatic, bodies.pairs[pair].T
    ja, jb = bodies.joint[a], bodies.joint[b]
    flat = bodies.flat[b]  # the plane of a half-space is its boundary
    normal = normal.copy()
    normal[flat] = bodies.frames(poses, k[flat], b[flat])[0][:, :, 2]
    turn, at, axis = poses.rotation[k, ja], poses.origin[k, ja], poses.axis[k]
    lever = cross(normal[:, None], axis)  # n·(axis x r) = (n x axis)·r
    level = np.sum(lever * (at[:, None] - poses.origin[k, :-1]), axis=2)
    level[:, slides] = np.matmul(axis[:, slides], normal[:, :, None])[..., 0]
    lever[:, slides] = 0.0
    between, coupling = bodies.moves[0][pair], bodies.kinematics.coupling
    level = coupling.joined(level * between)
    lever, share = coupling.joined(np.matmul(lever, turn) * between[:, :, None], axis=1), far[:, None]
    up_a, up_b = into(turn, normal), into(poses.rotation[k, jb], normal)
    out = np.sum(normal * (at - poses.origin[k, jb]), axis=1) - rest - ROUNDING
    order = np.argsort(pair, kind="stable")
    for some in np.split(order, np.flatnonzero(np.diff(pair[order])) + 1) if len(order) else []:
        points, radius = bodies.corners_of(int(a[some[0]]))
        support, more = bodies.corners_of(int(b[some[0]]))
        slope = np.abs(lever[some] @ points.T + level[some, :, None])  # (M, n, V)
        low = (up_a[some] @ points.T - np.matmul(share[some], slope)[:, 0]).min(axis=1)
        out[some] += low - (up_b[some] @ support.T).max(axis=1) - radius - more
    return np.asarray(out)


def one_inside_the_other(ruler: Ruler, at: Any, bt: Any) -> bool:
    """Whether a part of one body, away from all surfaces, lies within the other's mesh.

    Args:
        ruler: measures the distance of the two bodies. at, bt: their poses, as coal's transforms.
    """
    a, b = ruler.a, ruler.b
    around = [(*each, walls) for each in ((a, at, b, bt), (b, bt, a, at)) if len(walls := each[2].inside)]
    if not around or ruler.exact(at, bt) <= 0:
        return False  # surfaces meet, which the distance shows
    return any(enclosed(_moved(_probes(inner), its, other), walls) for inner, its, _, other, walls in around)


def overlap(ruler: Ruler, at: Any, bt: Any) -> float:
    """How deep [m] two bodies overlap; infinite if one is inside the other's surface. `at`, `bt`: as above."""
    near = ruler.near(at, bt)
    if near >= 0 or ruler.convex:
        return max(-near, 0.0)
    return ruler.depth(at, bt) or (np.inf if one_inside_the_other(ruler, at, bt) else 0.0)


def _probes(solid: Solid) -> np.ndarray:
    """A point of every connected part of a body."""
    if solid.convex:
        return solid.hull.points.mean(axis=0, keepdims=True)
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    vertices, triangles = solid.surface
    used, ends = np.unique(triangles, return_inverse=True)  # files have vertices that no triangle uses
    vertices, triangles = vertices[used], ends.reshape(triangles.shape)
    _, same = np.unique(vertices.round(9), axis=0, return_inverse=True)  # STL repeats corners
    ends = same.ravel()[triangles]
    size = int(ends.max()) + 1
    links = np.vstack([ends[:, :2], ends[:, 1:]])
    graph = coo_matrix((np.ones(len(links)), links.T), shape=(size, size))
    _, part = connected_components(graph, directed=False)
    _, first = np.unique(part[same.ravel()], return_index=True)
    return vertices[first]


def _moved(points: np.ndarray, at: Any, bt: Any) -> np.ndarray:
    """Points (M, 3) of a body placed `at`, in the frame of one placed `bt`."""
    world = points @ np.asarray(at.getRotation()).T + np.asarray(at.getTranslation())
    return (world - np.asarray(bt.getTranslation())) @ np.asarray(bt.getRotation())


SHORTEST = 1e-5  # [s] a shorter interval is not halved
FIRST = 8  # initial intervals
NARROW = 0.3  # finer shapes are measured if hulls leave less than this share of the travel
MOST = 200_000  # most open intervals of pairs at a time; a motion that needs more is undecided
HASTE = 2  # further levels after the clearance was first broken, to find other places


@dataclass(frozen=True)
class Touch:
    """Where a pair is nearer than asked for: time [s], the pair's number, and the distance there (0: they touch)."""

    time: float
    pair: int
    distance: float


@dataclass
class Proof:
    """The result of a proof.

    Attributes:
        verdict: "proven", "colliding" or "undecided".
        lower_bound: [m] what every pair keeps during the whole motion; -inf if nothing is proven.
        least: the smallest measured distance, with its pair and time.
        touches: where the clearance is broken, coarse; the deepest first.
    """

    verdict: str = "proven"
    lower_bound: float = np.inf
    least: Touch | None = None
    touches: list[Touch] = field(default_factory=list)

    def see(self, found: Touch) -> None:
        """Keep the nearest pair."""
        if self.least is None or found.distance < self.least.distance:
            self.least = found


@dataclass
class Cases:
    """M intervals of pairs, all of about one length.

    Attributes:
        span, pair: (M,) interval, and number of the pair. time: (K,) [s] of the intervals' middles.
        far, reach: (K, n) and (K, L) [rad, m] how far the independent joints, and all joints, go from there.
        wanted: (M,) [m] distance to be proven. normal: (M, 3) of the last plane between the hulls; 0: none is known.
        distance: (M,) [m] lower bound of the distance in the middle; -inf where it is not needed, NaN if unknown.
        travel: (M,) [m] how far the bodies come towards each other at most.
    """

    span: np.ndarray
    pair: np.ndarray
    time: np.ndarray
    far: np.ndarray
    reach: np.ndarray
    wanted: np.ndarray
    normal: np.ndarray
    distance: np.ndarray = field(default_factory=lambda: np.zeros(0))
    travel: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def bound(self, scene: Scenery, wanted: np.ndarray, out: Proof) -> np.ndarray:
        """What the pairs keep in the whole interval (M,) [m], by boxes, hulls and planes; sets distance and travel.

        Args:
            wanted: (P,) [m]. out: the proof so far, which sees the nearest pair.
        """
        poses, bodies = scene.poses, scene.bodies
        frames = poses.rotation, poses.origin, poses.axis
        least = np.inf if out.least is None else out.least.distance
        found = bodies.hulls.within(
            bodies.hull_pairs, frames, self.far, self.reach, (self.span, self.pair), wanted, least,
            (GJK_ERROR, ROUNDING), self.normal,
        )  # fmt: skip
        if found is None:
            floor, box_a, box_b = scene.apart(self.span, self.pair)
            self.travel = scene.travel(self.span, self.pair, (box_a, box_b), self.reach[self.span])
            self.distance = np.full(len(self.pair), np.nan)
            return floor - self.travel
        bound, self.distance, self.travel = found
        measured = np.flatnonzero((self.distance > -np.inf) & (bound > self.wanted))  # the others are seen later
        if len(measured):
            i = measured[np.argmin(self.distance[measured])]
            if self.distance[i] + GJK_ERROR < least:
                k, p = int(self.span[i]), int(self.pair[i])
                distance = bodies.ruler(p).near(*(scene.placed(k, body) for body in bodies.pairs[p].tolist()))
                out.see(Touch(float(self.time[k]), p, distance))
        return bound


def prove(bodies: Bodies, curve: MotionCurve, wanted: np.ndarray) -> Proof:
    """Prove that every pair of `bodies` is apart by more than `wanted` (P,) [m] during all of `curve`.

    Returns:
        The `Proof`. "undecided" means that a pair comes nearer than wanted without touching, or that intervals became
            shorter than SHORTEST, or that more than MOST intervals were open.
    """
    out = Proof()
    spans = curve.whole(FIRST)
    pairs = len(bodies.pairs)
    span = np.repeat(np.arange(len(spans)), pairs)
    pair = np.tile(np.arange(pairs), len(spans))
    normal = np.zeros((len(pair), 3))  # of the last plane between a pair; 0 where none is known
    haste = HASTE
    # pairs with one body inside the other's mesh, which surface distances do not show
    entered = inside_at(bodies, curve.at(0))
    while len(span):
        time, q, far = curve.middles(spans)
        scene = Scenery(bodies, q)
        cases = Cases(span, pair, time, far, bodies.kinematics.coupling.reach(far), wanted[pair], normal)
        bound = cases.bound(scene, wanted, out)
        open_ = ~(bound > cases.wanted)
        out.lower_bound = min(out.lower_bound, float(bound[~open_].min(initial=np.inf)))
        again, unsure = _measured(out, scene, cases, np.flatnonzero(open_), entered)
        if out.touches:
            haste -= 1
            # the clearance is broken: only other places and contacts are still of interest
            touch = min(found.distance for found in out.touches) <= 0
            again = np.union1d(again, unsure) if haste >= 0 else unsure[: 0 if touch else None]
        short = curve.seconds(spans)[span[again]] < SHORTEST
        if short.any() or len(again) > MOST:
            if not out.touches:
                out.verdict = "undecided"
                break
            again = again[:0] if len(again) > MOST else again[~short]
        kept, back = np.unique(span[again], return_inverse=True)  # halved, each open pair in both halves
        spans = spans.take(kept).halves()
        span, pair = np.concatenate([back, back + len(kept)]), np.tile(pair[again], 2)
        normal = np.tile(cases.normal[again], (2, 1))
    if out.touches:
        out.touches.sort(key=lambda touch: touch.distance)
        out.verdict = "colliding" if out.touches[0].distance <= 0 else "undecided"
    if out.verdict != "proven":
        out.lower_bound = -np.inf
    return out


def _measured(
    out: Proof, scene: Scenery, cases: Cases, which: np.ndarray, entered: set[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Measure the distances that are not bounded yet. Proofs and touches are entered into `out`.

    Args:
        out: the proof so far. scene: bodies in the middles of the intervals. cases, which: those still open.
        entered: pairs with one body inside the other.

    Returns:
        Cases that are still open, and those that may touch within their interval.
    """
    bodies, pair = scene.bodies, cases.pair[which]
    again, unsure, planes = [], [], []
    some = which[np.isnan(cases.distance[which])]
    for side in (0, 1):
        scene.place(cases.span[some], bodies.pairs[cases.pair[some], side])
    columns = (which, cases.span[which], pair, cases.travel[which], cases.wanted[which], cases.distance[which])
    for i, k, p, travel, asked, distance in zip(*(column.tolist() for column in columns), strict=True):
        a, b = bodies.pairs[p].tolist()
        ruler = bodies.ruler(p)
        known = not np.isnan(distance) and (distance > asked or ruler.near.exact)
        if not known:
            distance = ruler.near(scene.placed(k, a), scene.placed(k, b)) - GJK_ERROR
            cases.normal[i] = ruler.near.normal
        # finer shapes take longer to measure: only where hulls leave little beside the travel
        if not ruler.convex and distance - asked < NARROW * travel + GJK_ERROR:
            at, bt = scene.placed(k, a), scene.placed(k, b)
            if ruler.cut:
                distance = max(distance, ruler.mid(at, bt) - GJK_ERROR)
            if distance <= asked or distance - asked < NARROW * travel < 0.005:
                distance = (0.0 if p in entered else ruler.exact(at, bt)) - GJK_ERROR
        out.see(Touch(float(cases.time[k]), p, distance + GJK_ERROR))
        kept = distance - travel
        if kept > asked:
            out.lower_bound = min(out.lower_bound, kept)
        elif distance <= asked:
            touch = distance <= 0
            out.touches.append(Touch(float(cases.time[k]), p, min(distance + GJK_ERROR, 0.0 if touch else np.inf)))
            if not touch and kept <= 0:
                unsure.append(i)
        else:
            if not known:
                planes.append(i)
            again.append(i)
            if kept <= 0:
                unsure.append(i)
    # a plane may show what distance less travel does not: bodies that move along each other
    closed = np.array([i for i in planes if bodies.planar[cases.pair[i]]], dtype=int)
    if len(closed):
        k, p, rest = cases.span[closed], cases.pair[closed], cases.travel[closed]
        bend = rest * turns(bodies, p, cases.reach[k])
        height = least_heights(scene, k, p, cases.normal[closed], cases.far[k], bend)
        good = height > cases.wanted[closed]
        closed, out.lower_bound = closed[good], min(out.lower_bound, float(height[good].min(initial=np.inf)))
    return np.setdiff1d(np.array(again, dtype=int), closed), np.setdiff1d(np.array(unsure, dtype=int), closed)


def inside_at(bodies: Bodies, q: np.ndarray) -> set[int]:
    """Pairs with a mesh of which one body is inside of the other at q (n,)."""
    found = Scenery(bodies, q[None]).hulls(0.0)
    return {p for _, p, ruler, at, bt, _ in found if not ruler.convex and one_inside_the_other(ruler, at, bt)}
