"""What a surface of triangles bounds: the inside of its closed parts, and nothing behind an open one, such as a scan.

A part without a rim is closed. The others count as open if together they have a large opening, such as a bin whose
walls have no thickness. So a solid whose surface has cracks or small holes, as many CAD programs export it, still
counts as a solid: their rims bound little area.
"""

from __future__ import annotations

import numpy as np

MOST_LOOPS = 4  # of edges that belong to one triangle, where the openings of a surface face each other, as a tube's do
OPENING = 0.05  # least area of the opening, as a share of the surface
THICKNESS = 1e-5  # [m] added to both sides of a flat face, so that it has a hull
MOST_FACES = 24  # flat faces that become pieces of their own
LOOKS = 50  # most corners of a part that are looked for within another one
SAME_VOLUME, SAME_AREA = 1e-3, 1e-5  # largest relative differences of a convex body from its hull


def alike(values: np.ndarray) -> np.ndarray:
    """Numbers (N,) from 0 on that are the same where values (N, K) are, much faster than by `np.unique`."""
    out = np.zeros(len(values), dtype=np.int64)
    for column in values.T:
        _, rank = np.unique(column, return_inverse=True)
        _, out = np.unique(out * (rank.max(initial=0) + 1) + rank, return_inverse=True)
    return out


def tidy(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and triangles (T, 3) with each of both once, and no vertex unused.

    Two triangles that face opposite ways both stay: they are between two solids that touch.
    """
    _, first, name = np.unique(alike(vertices.round(9)), return_index=True, return_inverse=True)
    triangles = name[triangles]
    from_least = (triangles.argmin(axis=1)[:, None] + np.arange(3)) % 3
    _, once = np.unique(alike(np.take_along_axis(triangles, from_least, axis=1)), return_index=True)
    used, ends = np.unique(triangles[np.sort(once)], return_inverse=True)
    return vertices[first[used]], ends.reshape(-1, 3)


def fills(triangles: np.ndarray, hull: np.ndarray) -> bool:
    """Is the surface of triangles (T, 3, 3) that of its convex hull, of corners (V, 3)?

    The volume alone does not tell: that of bodies which overlap counts several times, and that of an open surface
    depends on the origin.
    """
    from scipy.spatial import ConvexHull

    whole, legs = ConvexHull(hull), triangles[:, 1:] - triangles[:, :1]
    volume = abs(_volume(triangles - hull.mean(axis=0)))
    return abs(volume / whole.volume - 1) < SAME_VOLUME and abs(_area(legs) / whole.area - 1) < SAME_AREA


def walls(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangles (W, 3, 3) of a surface that bound its inside; none if nothing is within it.

    Those of a closed part within another one face the other way: it is a cavity, whichever way the file has them.

    Args:
        vertices: (V, 3), each once. triangles: (T, 3) indices.
    """
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    name = alike(np.sort(edges, axis=1))
    counts = np.bincount(name)[name]
    part = _joined(edges, len(vertices))
    torn = np.isin(part, part[edges[(counts == 1) & (edges[:, 0] != edges[:, 1])]])
    of = part[triangles[:, 0]]
    rest, closed = torn[edges[:, 0]], np.flatnonzero(~torn[triangles[:, 0]])
    closed = closed[np.argsort(of[closed], kind="stable")]
    corners = vertices[triangles]
    parts = np.split(corners[closed], np.flatnonzero(np.diff(of[closed])) + 1) if len(closed) else []
    open_ = _is_open(vertices, edges[rest], counts[rest])
    return np.concatenate([*_facing(parts), corners[:0] if open_ else corners[torn[triangles[:, 0]]]])


def _is_open(vertices: np.ndarray, edges: np.ndarray, counts: np.ndarray) -> bool:
    """Have triangles a large opening? Of their edges (3 T, 2) `counts` (3 T,) says how many triangles have each."""
    corners, rim = vertices[edges[:, 0]].reshape(-1, 3, 3), edges[(counts == 1) & (edges[:, 0] != edges[:, 1])]
    area = _area(corners[:, 1:] - corners[:, :1])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    if np.linalg.norm(normals.sum(axis=0)) > OPENING * area:  # the sum over a closed surface is 0
        return True
    if not len(rim) or counts.max() > 2 or np.bincount(rim.ravel()).max() > 2:
        return False
    loop = _joined(rim, len(vertices))[rim[:, 0]]
    loops = [vertices[rim[loop == k]] for k in np.unique(loop)[: MOST_LOOPS + 1]]
    widest = max(_area(each - each.mean(axis=(0, 1))) for each in loops)
    return len(loops) <= MOST_LOOPS and widest > OPENING * area


def _facing(parts: list[np.ndarray]) -> list[np.ndarray]:
    """Closed parts, (T, 3, 3) each, turned so that they face outwards, those within an odd number of others inwards."""
    parts = sorted(parts, key=lambda part: float(part[..., 0].min()))
    low, high = (np.array([end(part, axis=(0, 1)) for part in parts]).reshape(-1, 3) for end in (np.min, np.max))
    depth = np.zeros(len(parts), dtype=int)
    for k, (part, end) in enumerate(zip(parts, np.searchsorted(low[:, 0], high[:, 0]).tolist(), strict=True)):
        within = (low[k:end] > low[k]).all(axis=1) & (high[k:end] < high[k]).all(axis=1)
        for other in (k + np.flatnonzero(within)).tolist():
            some = parts[other][:: len(parts[other]) // LOOKS + 1, :1]
            depth[other] += all(enclosed(point, part) for point in some)
    turned = [_volume(part) * (-1) ** around < 0 for part, around in zip(parts, depth.tolist(), strict=True)]
    return [part[:, ::-1] if turn else part for part, turn in zip(parts, turned, strict=True)]


def enclosed(points: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether a point is within a surface: it sees more than half of the sphere around it covered.

    The solid angle of a triangle after van Oosterom and Strackee (1983); gaps in a surface do no harm.

    Args:
        points: (M, 3) [m]. triangles: (T, 3, 3) [m].
    """
    for point in points:
        a, b, c = np.moveaxis(triangles - point, 1, 0)
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


def _joined(edges: np.ndarray, count: int) -> np.ndarray:
    """Numbers (count,) of corners that are the same where edges (E, 2) join them."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _area(legs: np.ndarray) -> float:
    """The sum of the areas of triangles with these two legs (M, 2, 3)."""
    return float(np.linalg.norm(np.cross(legs[:, 0], legs[:, 1]), axis=1).sum() / 2)


def _volume(triangles: np.ndarray) -> float:
    """The volume [m^3] within a closed surface of triangles (T, 3, 3) that face outwards."""
    return float(np.einsum("ti,ti->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6)


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
    which = alike(np.column_stack([normal, np.einsum("ti,ti->t", normal, triangles[:, 0])]).round(6))
    if which.max(initial=MOST_FACES * (not len(which))) >= MOST_FACES:
        return []
    faces = [(triangles[which == k].reshape(-1, 3), normal[which == k][0]) for k in range(which.max() + 1)]
    return [np.vstack([face + THICKNESS * n, face - THICKNESS * n]) for face, n in faces]
