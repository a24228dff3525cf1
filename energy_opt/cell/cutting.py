"""Cuts of a solid within a surface of triangles, so that the convex hulls of its parts leave its hollows open.

The solid is cut in the planes of its largest flat faces across two axes of its mesh, such as the inner walls of a bin.
Parts that fit together are joined again. Every line along the third axis leaves a part through its surface, so the part
lies in the hull of its clipped surface. Planes across all three axes would not do: a corner where three of them meet
may lie in the solid, away from its surface.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations, permutations

import numpy as np

MOST_TRIANGLES = 5_000  # of a surface that is cut: its time grows with their number
CUTS = 4  # most cuts across an axis
LARGE = 0.03  # least area of flat faces in the plane of a cut, as a share of the surface
FLAT = 0.95  # cosine between a face's normal and an axis from which it lies across the axis
JOINED, WORTH = 1.02, 0.9  # volume of a hull over those of its parts to be joined; of all parts over the whole hull's
ON = 1e-7  # [m] what is nearer to a plane lies in it; far below the accuracy of distances


def cut(triangles: np.ndarray) -> list[np.ndarray]:
    """Vertices (M, 3) of parts whose hulls cover the solid; empty if cutting leaves hardly less than its hull.

    Args:
        triangles: (T, 3, 3) of the solid's surface.
    """
    found: list[tuple[float, list[np.ndarray]]] = []
    places = [_places(triangles, axis) for axis in range(3)]
    if not any(places):
        return []
    for one, other in combinations(range(3), 2):
        slabs = [_joined(_slabs(slab, other, places[other])) for slab in _slabs(triangles, one, places[one])]
        parts = _joined([part for slab in slabs for part in slab])
        total = sum(map(_volume, parts))
        if total < WORTH * _volume(_corners(triangles)) and _covered(
            triangles, parts, {one: places[one], other: places[other]}
        ):
            found.append((total, parts))
    return min(found, key=lambda each: each[0])[1] if found else []


def _covered(triangles: np.ndarray, parts: list[np.ndarray], places: Mapping[int, Sequence[float]]) -> bool:
    """Does each triangle in the plane of a cut lie in the hulls of parts? `places`: of the cuts, by axis, of two axes.

    Such a triangle belongs to no slab. As a face of the solid it bounds a part; as a sheet it may be left out.
    """
    from scipy.spatial import ConvexHull, QhullError

    flat: list[np.ndarray] = []
    for (axis, at), (other, across) in permutations(places.items()):
        for place in at:
            within = triangles[(np.abs(triangles[..., axis] - place) < ON).all(axis=1)]
            flat += _slabs(within, other, across) if len(within) else []
    if not flat:
        return True
    corners = np.concatenate(flat)
    inside = np.zeros(len(corners), dtype=bool)
    for part in parts:
        try:
            planes = ConvexHull(part).equations
        except QhullError:
            return False
        inside |= (corners @ planes[:, :3].T + planes[:, 3] <= ON).all(axis=(1, 2))
    return bool(inside.all())


def _places(triangles: np.ndarray, axis: int) -> list[float]:
    """Where the largest flat faces across an axis lie within the solid, ascending."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(normal, axis=1)
    flat = np.abs(normal[:, axis]) > FLAT * area
    middle = triangles[..., axis].mean(axis=1)
    low, high = triangles[..., axis].min() + ON, triangles[..., axis].max() - ON
    inner = flat & (middle > low) & (middle < high)
    levels, which = np.unique(np.round(middle[inner], 5), return_inverse=True)
    areas = np.bincount(which, area[inner], len(levels))
    largest = [k for k in np.argsort(-areas)[:CUTS].tolist() if areas[k] > LARGE * area.sum()]
    return sorted(float(np.median(middle[inner][which == k])) for k in largest)


def _slabs(triangles: np.ndarray, axis: int, places: Iterable[float]) -> list[np.ndarray]:
    """What lies between planes across an axis, as triangles, in order; empty slabs are left out."""
    out = []
    for place in places:
        out.append(_clipped(triangles, axis, place, -1.0))
        triangles = _clipped(triangles, axis, place, 1.0)
    return [slab for slab in (*out, triangles) if len(slab)]


def _joined(parts: list[np.ndarray]) -> list[np.ndarray]:
    """Parts as corners (M, 3), those that follow each other joined where their hull is hardly larger than theirs."""
    out: list[np.ndarray] = []
    for part in map(_corners, parts):
        both = np.vstack([out[-1], part]) if out else part
        if out and _volume(both) <= JOINED * (_volume(out[-1]) + _volume(part)):
            out[-1] = both
        else:
            out.append(part)
    return out


def _volume(points: np.ndarray) -> float:
    """Volume [m^3] of the convex hull of points (M, 3); 0 if they are flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return 0.0


def _corners(triangles: np.ndarray) -> np.ndarray:
    return np.unique(triangles.reshape(-1, 3).round(9), axis=0)


def _clipped(triangles: np.ndarray, axis: int, place: float, side: float) -> np.ndarray:
    """The parts of triangles (T, 3, 3) where side * (x - place) >= 0 along an axis, as triangles."""
    height = side * (triangles[..., axis] - place)
    height[np.abs(height) < ON] = 0.0
    beyond = (height > 0).any(axis=1)  # what lies in the plane alone belongs to no side
    triangles, height = triangles[beyond], height[beyond]
    inside = height >= 0
    count = inside.sum(axis=1)
    out = [triangles[count == 3]]
    for kept in (1, 2):  # the corner alone on its side comes first
        some = count == kept
        alone = np.argmax(inside[some] if kept == 1 else ~inside[some], axis=1)
        order = (alone[:, None] + np.arange(3)) % 3
        p = np.take_along_axis(triangles[some], order[:, :, None], axis=1)
        h = np.take_along_axis(height[some], order, axis=1)
        share = h[:, :1] / (h[:, :1] - h[:, 1:])  # from the first corner to the plane, along both edges
        b, c = (p[:, 0] + share[:, k, None] * (p[:, k + 1] - p[:, 0]) for k in range(2))
        out += [np.stack([p[:, 0], b, c], axis=1)] if kept == 1 else [
            np.stack([b, p[:, 1], p[:, 2]], axis=1), np.stack([b, p[:, 2], c], axis=1)
        ]  # fmt: skip
    return np.concatenate(out)
