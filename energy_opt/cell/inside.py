"""Is one body inside of another whose surface is a mesh? Distances between surfaces cannot tell."""

from __future__ import annotations

from typing import Any

import numpy as np

from energy_opt.cell.solids import Ruler, Solid


def one_inside_the_other(ruler: Ruler, at: Any, bt: Any) -> bool:
    """Whether a part of one body, away from all surfaces, lies within the other's mesh."""
    a, b = ruler.a, ruler.b
    if ruler.exact(at, bt) <= 0:
        return False  # surfaces meet: that is found without help
    return any(
        not outer.convex and enclosed(_moved(_probes(inner), its, other), *outer.surface)
        for inner, outer, its, other in ((a, b, at, bt), (b, a, bt, at))
    )


def enclosed(points: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether any of `points` (M, 3) is within a surface: it sees more than half of the sphere around it covered.

    The solid angle of a triangle after van Oosterom and Strackee (1983); gaps in a surface do no harm.
    """
    corners = vertices[triangles]
    for point in points:
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        triple = np.einsum("ti,ti->t", a, np.cross(b, c))
        below = (
            la * lb * lc
            + np.einsum("ti,ti->t", a, b) * lc
            + np.einsum("ti,ti->t", b, c) * la
            + np.einsum("ti,ti->t", c, a) * lb
        )
        if abs(np.sum(np.arctan2(triple, below))) > np.pi:  # half of the solid angle; 2 pi inside, 0 outside
            return True
    return False


def _probes(solid: Solid) -> np.ndarray:
    """A point of every connected part of a body."""
    if solid.convex:
        return solid.hull.points.mean(axis=0, keepdims=True)
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    vertices, triangles = solid.surface
    used, ends = np.unique(triangles, return_inverse=True)  # files have vertices that no triangle takes
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
