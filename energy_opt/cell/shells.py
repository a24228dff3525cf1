"""Surfaces with a large opening, such as a bin whose walls have no thickness: nothing is within them.

A surface counts as open only if every edge belongs to one or two triangles, the edges of one triangle form a few closed
loops, one of which spans a large opening, and no part of the surface is closed. So a solid whose surface has cracks, as
many CAD programs export it, still counts as a solid.
"""

from __future__ import annotations

import numpy as np

MOST_LOOPS = 4  # of edges that belong to one triangle
OPENING = 0.05  # least area of the opening, as a share of the surface
THICKNESS = 1e-5  # [m] added to both sides of a flat face, so that it has a hull
MOST_FACES = 24  # flat faces that become pieces of their own


def is_open(triangles: np.ndarray) -> bool:
    """Has the surface of triangles (T, 3, 3) a large opening?"""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    points, ends = np.unique(triangles.reshape(-1, 3).round(9), axis=0, return_inverse=True)  # STL repeats corners
    ends = ends.reshape(-1, 3)
    edges, counts = np.unique(
        np.sort(ends[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0, return_counts=True
    )
    rim = edges[counts == 1]
    if not len(rim) or counts.max() > 2 or (np.bincount(rim.ravel(), minlength=len(points)) > 2).any():
        return False
    part, loop = (
        connected_components(coo_matrix((np.ones(len(e)), e.T), shape=(len(points),) * 2), directed=False)[1]
        for e in (edges, rim)
    )
    if not np.isin(part, part[rim]).all():  # a closed part is a solid
        return False
    loop = loop[rim[:, 0]]
    loops = [rim[loop == k] for k in np.unique(loop)]
    widest = max(_area(points[edges] - points[edges].mean(axis=(0, 1))) for edges in loops)
    return len(loops) <= MOST_LOOPS and widest > OPENING * _area(triangles[:, 1:] - triangles[:, :1])


def _area(legs: np.ndarray) -> float:
    """The sum of the areas of triangles with these two legs (M, 2, 3)."""
    return float(np.linalg.norm(np.cross(legs[:, 0], legs[:, 1]), axis=1).sum() / 2)


def flat_faces(triangles: np.ndarray) -> list[np.ndarray]:
    """Corners (M, 3) of the flat faces of a surface, thickened on both sides; empty if there are many.

    Args:
        triangles: (T, 3, 3).
    """
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    triangles, normal = triangles[size[:, 0] > 0], (normal / np.maximum(size, 1e-300))[size[:, 0] > 0]
    first = np.take_along_axis(normal, np.argmax(np.abs(normal), axis=1)[:, None], axis=1)
    normal = normal * np.sign(first)  # a plane's normal, whatever the triangle's side
    planes = np.column_stack([normal, np.einsum("ti,ti->t", normal, triangles[:, 0])]).round(6)
    _, which = np.unique(planes, axis=0, return_inverse=True)
    which = which.ravel()
    if which.max() >= MOST_FACES:
        return []
    faces = [(triangles[which == k].reshape(-1, 3), normal[which == k][0]) for k in range(which.max() + 1)]
    return [np.vstack([face + THICKNESS * n, face - THICKNESS * n]) for face, n in faces]
