"""The proof that a motion touches nothing, for every instant of it and not for samples.

Take an interval of time, and the arm in its middle. If two bodies are d apart there, and their points come towards each
other by no more than s within the interval, they are at least d - s apart during all of it. Where this is not above the
clearance that is asked for, the interval is halved, and only the pairs that are still open are carried on. All open
intervals of one size are looked at together: what is arithmetic on arrays is done once for all of them.

A pair is closed by the cheapest of: boxes around the bodies, convex hulls, planes between these (see `heights`), convex
pieces, meshes. A pair that a mesh holds apart cannot be inside of another (see `inside`): surfaces that never meet do
not pass each other.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from energy_opt.cell.bodies import Bodies, Scenery
from energy_opt.cell.curve import MotionCurve, Spans
from energy_opt.cell.heights import least_heights, turns
from energy_opt.cell.inside import one_inside_the_other
from energy_opt.cell.solids import GJK_ERROR

SHORTEST = 1e-5  # [s] an interval below is not halved again
FIRST = 8  # intervals to begin with
NARROW = 0.3  # where hulls leave less than this share of the travel, finer shapes are asked
MOST = 200_000  # open intervals of pairs at a time; a motion that needs more is given up as undecided
HASTE = 2  # levels that are still looked at after the clearance was first broken, to find where else


@dataclass(frozen=True)
class Touch:
    """Where a pair is nearer than asked for: time [s], the pair's number, and the distance there (0: they touch)."""

    time: float
    pair: int
    distance: float


@dataclass
class Proof:
    """What became of it.

    Attributes:
        verdict: "proven", "colliding" or "undecided".
        lower_bound: what every pair keeps over all of the motion, m; -inf where nothing is proven.
        least: the smallest distance that was measured, with its pair and time.
        touches: where the clearance is broken, coarse; the deepest first.
    """

    verdict: str = "proven"
    lower_bound: float = np.inf
    least: Touch | None = None
    touches: list[Touch] = field(default_factory=list)


def prove(bodies: Bodies, curve: MotionCurve, wanted: np.ndarray) -> Proof:
    """Is every pair of `bodies` apart by more than `wanted` (P,) [m] during all of `curve`?"""
    out = Proof()
    spans = curve.whole(FIRST)
    pairs = len(bodies.pairs)
    span = np.repeat(np.arange(len(spans)), pairs)
    pair = np.tile(np.arange(pairs), len(spans))
    haste = HASTE
    entered = _starts_inside(bodies, curve)
    while len(span):
        time, q, far = curve.middles(spans)
        scene = Scenery(bodies, q)
        floor, box_a, box_b = scene.apart(span, pair)
        reach = bodies.kinematics.coupling.reach(far)
        travel = scene.travel(span, pair, (box_a, box_b), reach[span])
        rest = floor - travel
        open_ = rest <= wanted[pair]
        if not open_.all():
            out.lower_bound = min(out.lower_bound, float(rest[~open_].min()))
        planes = _Planes(scene, far, reach)
        again, unsure = _measured(out, scene, span, pair, travel, wanted, np.flatnonzero(open_), time, entered, planes)
        if out.touches:
            haste -= 1
            # too near already: what is left to find out is where else, and whether anything touches
            touch = min(found.distance for found in out.touches) <= 0
            again = np.union1d(again, unsure) if haste >= 0 else unsure[: 0 if touch else None]
        short = curve.seconds(spans)[span[again]] < SHORTEST
        if short.any() or len(again) > MOST:
            if not out.touches:
                out.verdict = "undecided"
                break
            again = again[:0] if len(again) > MOST else again[~short]
        spans, span, pair = _halved(spans, span[again], pair[again])
    if out.touches:
        out.touches.sort(key=lambda touch: touch.distance)
        out.verdict = "colliding" if out.touches[0].distance <= 0 else "undecided"
    if out.verdict != "proven":
        out.lower_bound = -np.inf
    return out


def _halved(spans: Spans, span: np.ndarray, pair: np.ndarray) -> tuple[Spans, np.ndarray, np.ndarray]:
    """The intervals that are still open, halved, and each open pair in both halves."""
    kept, back = np.unique(span, return_inverse=True)
    halves = spans.take(kept).halves()
    return halves, np.concatenate([back, back + len(kept)]), np.concatenate([pair, pair])


def _measured(
    out: Proof,
    scene: Scenery,
    span: np.ndarray,
    pair: np.ndarray,
    travel: np.ndarray,
    wanted: np.ndarray,
    which: np.ndarray,
    time: np.ndarray,
    entered: set[int],
    planes: _Planes,
) -> tuple[np.ndarray, np.ndarray]:
    """Measure what boxes left open; proofs and touches go into `out`.

    Returns what is still open, and what may touch within its interval.
    """
    bodies, again, unsure = scene.bodies, [], []
    least = np.inf if out.least is None else out.least.distance
    for side in (0, 1):
        scene.place(span[which], bodies.pairs[pair[which], side])
    rest = planes.rest(span[which], pair[which], travel[which])
    columns = (which, span[which], pair[which], travel[which], wanted[pair[which]], rest)
    for i, k, p, way, asked, bend in zip(*(column.tolist() for column in columns), strict=True):
        a, b = bodies.pairs[p].tolist()
        ruler = bodies.ruler(p)
        at, bt = scene.placed(k, a), scene.placed(k, b)
        distance = ruler.near(at, bt)
        if not ruler.convex and distance - GJK_ERROR - asked < NARROW * way + GJK_ERROR:
            if ruler.cut:
                distance = max(distance, ruler.mid(at, bt))
            if distance - GJK_ERROR <= asked or distance - GJK_ERROR - asked < NARROW * way < 0.005:
                distance = 0.0 if p in entered else ruler.exact(at, bt)
        if distance < least:
            least = distance
            out.least = Touch(float(time[k]), p, distance)
        kept = distance - GJK_ERROR - way
        if kept > asked:
            out.lower_bound = min(out.lower_bound, kept)
        elif distance - GJK_ERROR <= asked:
            touch = distance <= GJK_ERROR
            out.touches.append(Touch(float(time[k]), p, min(distance, 0.0) if touch else distance))
            if not touch and kept <= 0:
                unsure.append(i)
        else:
            if distance - bend > asked:
                planes.add(i, k, p, bend, asked, ruler.normal)
            again.append(i)
            if kept <= 0:
                unsure.append(i)
    closed, least_height = planes.closed()
    out.lower_bound = min(out.lower_bound, least_height)
    return np.setdiff1d(np.array(again, dtype=int), closed), np.setdiff1d(np.array(unsure, dtype=int), closed)


class _Planes:
    """What is still open for how far points travel, and may be closed by heights over planes."""

    def __init__(self, scene: Scenery, far: np.ndarray, reach: np.ndarray) -> None:
        self._scene, self._far, self._reach = scene, far, reach
        self._open: list[tuple[int, int, int, float, float]] = []
        self._normals: list[np.ndarray] = []

    def rest(self, k: np.ndarray, pair: np.ndarray, travel: np.ndarray) -> np.ndarray:
        """What heights lose by terms of second order (M,) [m]; infinite where no plane can be held."""
        bodies = self._scene.bodies
        return np.where(bodies.planar[pair], travel * turns(bodies, pair, self._reach[k]), np.inf)

    def add(self, which: int, k: int, pair: int, rest: float, asked: float, normal: np.ndarray) -> None:
        """An open interval of a pair."""
        self._open.append((which, k, pair, rest, asked))
        self._normals.append(normal)

    def closed(self) -> tuple[np.ndarray, float]:
        """Which of them are closed, and the least height over the planes of these."""
        if not self._open:
            return np.zeros(0, dtype=int), np.inf
        which, k, pair, rest, asked = (np.array(column) for column in zip(*self._open, strict=True))
        height = least_heights(self._scene, k, pair, np.array(self._normals), self._far[k], rest)
        good = height > asked
        return which[good], float(height[good].min(initial=np.inf))


def _starts_inside(bodies: Bodies, curve: MotionCurve) -> set[int]:
    """Pairs with a mesh of which one body is inside the other at the first row, where no surface tells."""
    return inside_at(bodies, curve.at(0))


def inside_at(bodies: Bodies, q: np.ndarray) -> set[int]:
    """Pairs with a mesh of which one body is inside of the other at q (n,)."""
    scene = Scenery(bodies, q[None])
    pair = np.arange(len(bodies.pairs))
    floor, _, _ = scene.apart(np.zeros_like(pair), pair)
    out = set()
    for p in np.flatnonzero(floor <= 0).tolist():
        ruler = bodies.ruler(p)
        if not ruler.convex:
            a, b = bodies.pairs[p].tolist()
            at, bt = scene.placed(0, a), scene.placed(0, b)
            if ruler.near(at, bt) <= 0 and one_inside_the_other(ruler, at, bt):
                out.add(p)
    return out
