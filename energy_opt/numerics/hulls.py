"""Sets of points, and distances between convex pieces on the links of an arm, for many directions or poses at once.

Compiled (`clouds.c`, `hulls.c`) where there is a C compiler. Without one, NumPy finds the points, and boxes around the
pieces give lower bounds of distances; whoever needs a distance measures it otherwise.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.numerics import native
from energy_opt.numerics.native import pointer


class Clouds:
    """Sets of points.

    Args:
        sets: of each its points (V, 3), at least one; `most`: the largest number of them.
    """

    def __init__(self, sets: Sequence[np.ndarray]) -> None:
        self.sets = tuple(np.asarray(points, dtype=float) for points in sets)
        self._columns = np.vstack([np.zeros((0, 3)), *self.sets]).T.copy()
        self._first = np.cumsum([0, *(len(points) for points in self.sets)], dtype=np.int64)
        self.most = max((len(points) for points in self.sets), default=1)
        self.room = np.empty((2, self.most))

    def native(self) -> native.Clouds:
        """The sets in the layout of the C functions."""
        return native.Clouds(*map(pointer, self._columns), pointer(self._first))

    def points(self, which: np.ndarray, vertex: np.ndarray) -> np.ndarray:
        """Points (M, 3): of the sets `which` (M,) those with the numbers `vertex` (M,) within their set."""
        return np.asarray(self._columns.T[self._first[which] + vertex])

    def lowest(self, which: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For sets (M,), the index (M,) of the lowest point along directions (M, 3), and its coordinate (M,) there."""
        vertex, height, c = np.zeros(len(which), dtype=np.int64), np.zeros(len(which)), native.library("hulls")
        if c is None:
            for one, some in _groups(which):
                all_ = direction[some] @ self.sets[one].T
                vertex[some] = np.argmin(all_, axis=1)
                height[some] = all_[np.arange(len(some)), vertex[some]]
            return vertex, height
        which, direction = np.ascontiguousarray(which, dtype=np.int64), np.ascontiguousarray(direction)
        c.clouds_lowest(
            ctypes.byref(self.native()), pointer(which), pointer(direction), ctypes.c_int64(len(which)),
            pointer(self.room), pointer(vertex), pointer(height),
        )  # fmt: skip
        return vertex, height

    def spread(
        self, which: np.ndarray, direction: np.ndarray, many: np.ndarray, most: int, above: float, beside: float
    ) -> np.ndarray:
        """Low points of sets (M,) along directions (M, 3), that are not close to each other, by number (M, most).

        The first is the lowest. Where `many` (M,), others that are at most `above` higher follow, each the one that is
        farthest from those before, as long as it is more than `beside` from them; -1 where there is none.
        """
        out, c = np.full((len(which), most), -1, dtype=np.int64), native.library("hulls")
        if c is None:
            for one, some in _groups(which):
                points = self.sets[one]
                height = direction[some] @ points.T
                last = out[some, 0] = np.argmin(height, axis=1)
                usable = height <= height[np.arange(len(some)), last][:, None] + above
                gap = np.where(usable & many[some, None], np.inf, 0.0)
                for k in range(1, most):
                    gap = np.minimum(gap, np.sum((points[None] - points[last][:, None]) ** 2, axis=2))
                    last = np.argmax(gap, axis=1)
                    good = gap[np.arange(len(some)), last] > beside**2
                    out[some[good], k] = last[good]
            return out
        which, many = (np.ascontiguousarray(x, dtype=np.int64) for x in (which, many))
        direction = np.ascontiguousarray(direction)
        c.clouds_spread(
            ctypes.byref(self.native()), pointer(which), pointer(direction), pointer(many),
            ctypes.c_int64(len(which)), ctypes.c_int64(most), ctypes.c_double(above), ctypes.c_double(beside),
            *map(pointer, self.room), pointer(out),
        )  # fmt: skip
        return out


def _groups(which: np.ndarray) -> Iterable[tuple[int, np.ndarray]]:
    """Each of the sets (M,) with the indices where it is."""
    if not len(which):
        return
    order = np.argsort(which, kind="stable")
    for some in np.split(order, np.flatnonzero(np.diff(which[order])) + 1):
        yield int(which[some[0]]), some


@dataclass(frozen=True)
class Pairs:
    """P pairs of hulls on links that L joints move, n of them by themselves.

    Attributes:
        ends: (P, 2) the hulls. moves: (2, P, L) joints that move the first (second) one and not the other.
        planar: (P,) whether a plane fixed in the second one may bound the distance.
        corners: (hulls, 8, 3) [m] of boxes around what the hulls stand for, in the frames of their links.
        slides: (L,) joints that slide. coupling: (L, n) how all joints follow those that move by themselves.
    """

    ends: np.ndarray
    moves: np.ndarray
    planar: np.ndarray
    corners: np.ndarray
    slides: np.ndarray
    coupling: np.ndarray


class Hulls:
    """Convex hulls of points with a radius around them, and half-spaces.

    Args:
        points: of each of M pieces its points (V, 3) [m] in its link's frame; of a half-space one point of its plane.
        radius: (M,) [m].
        link: (M,) the link of each; -1 is the last frame of all poses.
        face: (M, 3) unit normals of half-spaces in their links' frames; 0 for hulls.
    """

    def __init__(self, points: Sequence[np.ndarray], radius: np.ndarray, link: np.ndarray, face: np.ndarray) -> None:
        self.clouds, self.radius, self.link, self.face = Clouds(points), radius, link, face
        self.middle = np.array([(p.min(axis=0) + p.max(axis=0)) / 2 for p in points]).reshape(-1, 3)
        self.half = np.array([(p.max(axis=0) - p.min(axis=0)) / 2 for p in points]).reshape(-1, 3) + radius[:, None]

    def apart(
        self, rotation: np.ndarray, origin: np.ndarray, a: np.ndarray, b: np.ndarray, reach: float, normal: np.ndarray
    ) -> np.ndarray:
        """Distances (K, P) [m] of pieces a and b (P,) where they are below `reach`, else a lower bound that is not.

        NaN where the distance is below `reach` and not found, as for half-spaces a, or without a C compiler.

        Args:
            rotation, origin: (K, L, 3, 3) and (K, L, 3) [m] frames of links.
            normal: (K, P, 3) unit vectors from b towards a, in the base frame, from which the search begins (0: none);
                those found replace them.
        """
        count, links = origin.shape[:2]
        c, out = native.library("hulls"), np.empty((count, len(a)))
        if c is None:
            out[:] = self._bounds(rotation, origin, a, b)
            out[out < reach] = np.nan
            return out
        rotation, origin = np.ascontiguousarray(rotation), np.ascontiguousarray(origin)
        a, b, link = (np.ascontiguousarray(x, dtype=np.int64) for x in (a, b, self.link % links))
        pieces = self._native(link)
        box, room, sizes = np.empty((len(link), 6)), self._room(), map(ctypes.c_int64, (count, links, len(link)))
        c.hulls_apart(
            ctypes.byref(pieces), pointer(rotation), pointer(origin), *sizes, pointer(a), pointer(b),
            ctypes.c_int64(len(a)), ctypes.c_double(reach), pointer(box), pointer(room), pointer(normal),
            pointer(out),
        )  # fmt: skip
        return out

    def within(
        self, pairs: Pairs, frames: tuple[np.ndarray, np.ndarray, np.ndarray], far: np.ndarray, reach: np.ndarray,
        cases: tuple[np.ndarray, np.ndarray], wanted: np.ndarray, least: float, margins: tuple[float, float],
        normal: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:  # fmt: skip
        """Bounds of pairs' distances while joints move; None without a C compiler.

        Args:
            frames: rotations (K, L + 1, 3, 3), origins (K, L + 1, 3) [m] and axes (K, L, 3) at K configurations.
            far, reach: (K, n) and (K, L) [rad, m] how far independent joints, and all joints, go from there.
            cases: configuration and pair of each of M cases. wanted: (P,) [m] distance to be shown.
            least: [m] distances above are not exact. margins: [m] subtracted for errors of distances, of heights.
            normal: (M, 3) as in `apart`.

        Returns:
            (M,) each, in m: what a pair keeps during the whole motion; its distance in the middle, less the margin
                (-inf: not needed; NaN: unknown); how far its bodies approach each other.
        """
        c = native.library("hulls")
        if c is None:
            return None
        bound, distance, travel = (np.empty(len(normal)) for _ in range(3))
        lever, room = np.empty((far.shape[1], 4)), self._room()
        of = (*frames, far, reach, pairs.coupling, pairs.slides)
        a, b, k, pair, link = (
            np.ascontiguousarray(x, dtype=np.int64) for x in (*pairs.ends.T, *cases, self.link % frames[1].shape[1])
        )
        held = [np.ascontiguousarray(x) for x in of]
        motion = native.Motion(*map(pointer, held), *pairs.coupling.shape)
        kept = [np.ascontiguousarray(x) for x in (pairs.moves, pairs.planar, pairs.corners, wanted)]
        c.hulls_within(
            ctypes.byref(self._native(link)),
            ctypes.byref(native.Pairs(*map(pointer, (a, b, *kept)), len(a))), ctypes.byref(motion),
            pointer(k), pointer(pair), ctypes.c_int64(len(k)), *map(ctypes.c_double, margins),
            ctypes.byref(ctypes.c_double(least)), pointer(room), pointer(lever),
            *map(pointer, (bound, distance, travel, normal)),
        )  # fmt: skip
        return bound, distance, travel

    def _room(self) -> np.ndarray:
        """Memory of one call: several threads may use the hulls of one cell."""
        return np.empty(self.clouds.most)

    def _native(self, link: np.ndarray) -> native.Hulls:
        """The hulls in the layout of the C functions."""
        return native.Hulls(self.clouds.native(), *map(pointer, (link, self.radius, self.middle, self.half, self.face)))

    def _bounds(self, rotation: np.ndarray, origin: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Lower bounds (K, P) [m] of distances, from boxes along the axes of the base."""
        turn = rotation[:, self.link]
        middle = np.matmul(turn, self.middle[:, :, None])[..., 0] + origin[:, self.link]
        half = np.matmul(np.abs(turn), self.half[:, :, None])[..., 0]
        gap = np.abs(middle[:, a] - middle[:, b]) - half[:, a] - half[:, b]
        out = np.sqrt(np.sum(np.maximum(gap, 0) ** 2, axis=2))
        for one in np.flatnonzero(self.face[b].any(axis=1)):
            normal = turn[:, b[one]] @ self.face[b[one]]
            inward = np.matmul(normal[:, None], turn[:, a[one]])[:, 0]
            height = np.sum(normal * (middle[:, a[one]] - middle[:, b[one]]), axis=1)
            out[:, one] = np.maximum(height - np.abs(inward) @ self.half[a[one]], 0)
        out[:, self.face[a].any(axis=1)] = -np.inf
        return np.asarray(out)
