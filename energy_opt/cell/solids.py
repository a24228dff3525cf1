"""Solids and the distances between them. This is the only module that imports coal.

A solid is represented in up to three ways, each contained in the one before: its convex hull, convex pieces where the
hull is much larger (slabs of a link; what is beside the hollows of a scene's body), and the mesh of its surface. So the
distance between hulls is a lower bound of that between pieces, and this is a lower bound of that between meshes. The
first costs least, and often suffices.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import coal
import numpy as np

from energy_opt.cell.cutting import MOST_TRIANGLES, cut
from energy_opt.cell.shells import fills, flat_faces, tidy, walls
from energy_opt.errors import BadInput

# [m] a computed distance may be too large by this much; observed errors of GJK are 2e-6 of the distance
GJK_ERROR = 1e-5
SAME_VOLUME = 1.001  # a link's mesh is convex if its hull has at most this multiple of its own volume
FAT = 1.1  # volume of a hull over that of its mesh or pieces from which cutting pays
SLABS = 6  # pieces that such a part is cut into, along its longest side
ROUND = 12  # corners of the polygons that replace circles if vertices are needed
THIN = 1e-6  # share of their largest extent below which points are flat
SHEET = 1e-6  # [m] a mesh without volume is thickened by at least this much for its hull
SIGNS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])  # corners of a cube
FILES = 100  # most mesh files that a process keeps
LARGE = 10.0  # [m] half the edge of the box that replaces a half-space if a bounded body is needed


@dataclass(frozen=True, eq=False)
class Piece:
    """A convex body: `geometry` is coal's; it lies in the hull of `points` (V, 3) [m], `radius` [m] added all round.

    `exact`: it is this hull.
    """

    geometry: Any
    points: np.ndarray
    radius: float = 0.0
    exact: bool = True


@dataclass(frozen=True, eq=False)
class Solid:
    """A rigid body in its own frame.

    Attributes:
        hull: its convex hull, or itself where it is convex.
        pieces: convex pieces that cover it, `hull` alone where cutting does not pay.
        mesh: coal's mesh of its surface; None where it is convex.
        corners: (8, 3) corners of a box around it [m]; None for a half-space.
        walls: (W, 3, 3) [m] triangles of the mesh that bound its inside, maybe none; None: all do.
    """

    hull: Piece
    pieces: tuple[Piece, ...]
    mesh: Any = None
    corners: np.ndarray | None = None
    walls: np.ndarray | None = None

    @property
    def convex(self) -> bool:
        """Whether the hull is the solid itself."""
        return self.mesh is None

    @cached_property
    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) and triangles (T, 3) of the mesh."""
        count = self.mesh.num_tris
        triangles = np.array([[t[0], t[1], t[2]] for t in (self.mesh.tri_indices(i) for i in range(count))])
        return vertices_of(self.mesh), triangles

    @cached_property
    def inside(self) -> np.ndarray:
        """Triangles (W, 3, 3) [m] of the mesh that bound its inside; none where it is convex or an open surface."""
        if self.convex:
            return np.zeros((0, 3, 3))
        return self.surface[0][self.surface[1]] if self.walls is None else self.walls


def vertices_of(mesh: Any) -> np.ndarray:
    """The vertices (V, 3) of coal's mesh."""
    return np.array(mesh.vertices())


def primitive(kind: str, size: Sequence[float]) -> Solid:
    """A solid of a kind and its sizes [m], as scenes and descriptions have them.

    Args:
        kind: "box" of full edges about its centre, "sphere", "cylinder" or "cone" of radius and height along z about
            the middle of the height (a cone's tip is at the top), "capsule" (everything within the radius of a segment
            of that length along z about the origin), or "plane" (all with z <= 0).
        size: edges; radius; radius and height or length.
    """
    size = [float(x) for x in size]
    if kind == "plane":
        piece = Piece(coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), SIGNS * LARGE - [0, 0, LARGE])
        return Solid(piece, (piece,))
    if kind == "box":
        return _alone(coal.Box(*size), SIGNS * np.array(size) / 2)
    radius, half = size[0], np.array([0, 0, size[-1] / 2])
    if kind == "sphere":
        return _alone(coal.Sphere(radius), np.zeros((1, 3)), radius)
    if kind == "capsule":
        return _alone(coal.Capsule(*size), np.array([-half, half]), radius)
    angle, outside = 2 * np.pi * (np.arange(ROUND) + 0.5) / ROUND, radius / np.cos(np.pi / ROUND)
    rim = outside * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(ROUND)])  # a polygon around the circle
    if kind == "cylinder":
        return _alone(coal.Cylinder(*size), np.vstack([rim - half, rim + half]), exact=False)
    return _alone(coal.Cone(*size), np.vstack([rim - half, half[None]]), exact=False)


def mesh(vertices: np.ndarray, triangles: np.ndarray) -> Solid:
    """A scene's body, such as a bin: the surface of triangles, and what it bounds; cut along its hollows.

    Args:
        vertices: (V, 3) [m]. triangles: (T, 3) indices.
    """
    vertices, triangles = tidy(vertices, triangles)
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), len(vertices))
    model.addVertices(np.ascontiguousarray(vertices, dtype=float))
    model.addTriangles(np.ascontiguousarray(triangles, dtype=np.int64))
    model.endModel()
    whole, corners = _uncut(model), vertices[triangles]
    if fills(corners, whole.hull.points):
        return replace(whole, mesh=None)
    bounds = walls(vertices, triangles)
    pieces = _hulls((cut(corners) if len(corners) <= MOST_TRIANGLES else []) if len(bounds) else flat_faces(corners))
    pieces = pieces or _slabs(vertices, triangles)
    pays = sum(piece.geometry.computeVolume() for piece in pieces) * FAT < whole.hull.geometry.computeVolume()
    return replace(whole, pieces=pieces if pieces and pays else whole.pieces, walls=bounds)


def mesh_file(path: Path, scale: tuple[float, ...], most: int) -> Solid:
    """The solid within the surface of a mesh file, scaled along x, y and z to metres.

    As in ROS, numbers of a COLLADA file are in the unit that it states. Coal ignores this unit. A process reads a file
    once, as long as its time of change and size stay the same.

    Args:
        most: triangles that it may have.

    Raises:
        BadInput: it cannot be read, has numbers that are not finite, or more triangles.
    """
    state = path.stat()
    return _read(path, scale, most, (state.st_mtime_ns, state.st_size))


@lru_cache(maxsize=FILES)
def _read(path: Path, scale: tuple[float, ...], most: int, state: tuple[int, int]) -> Solid:
    """See `mesh_file`; `state`: when the file was changed [ns], and its size [bytes]."""
    collada = path.suffix.lower() == ".dae"
    unit = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']\s*([0-9.eE+-]+)", path.read_bytes()) if collada else None
    try:
        size = np.array(scale, dtype=float) * (float(unit[1]) if unit else 1.0)
        model = coal.MeshLoader(coal.NODE_TYPE.BV_OBBRSS).load(str(path), size)
    except (ValueError, RuntimeError) as error:
        words = " ".join(str(error).rpartition("message:")[2].split())[:200]
        words = "it holds no triangles" if "No meshes" in words else words
        raise BadInput(f"{path}: not a mesh that can be read: {words}") from None
    vertices = vertices_of(model)
    if not model.num_tris or not np.isfinite(vertices).all():
        raise BadInput(f"{path}: not a mesh that can be read: its vertices are not all finite numbers")
    if model.num_tris > most:
        raise BadInput(
            f"{path}: {model.num_tris:,} triangles; expected a collision mesh of at most {most:,} "
            "(--allow-large reads it)"
        )
    return _of_link(model)


def _alone(geometry: Any, points: np.ndarray, radius: float = 0.0, exact: bool = True) -> Solid:
    """A convex solid that is its own hull and its only piece."""
    piece = Piece(geometry, points, radius, exact)
    return Solid(piece, (piece,), None, _box(geometry))


def _box(geometry: Any) -> np.ndarray:
    """Corners (8, 3) [m] of coal's box around a geometry."""
    geometry.computeLocalAABB()
    low, high = np.asarray(geometry.aabb_local.min_), np.asarray(geometry.aabb_local.max_)
    return (low + high) / 2 + SIGNS * (high - low) / 2


def _uncut(model: Any) -> Solid:
    """The solid of coal's mesh with nothing but its hull, or a thin box around a sheet."""
    points = vertices_of(model)
    hull = _hull(points)
    if hull is None:
        low, high = points.min(axis=0), points.max(axis=0)
        beside = max(SHEET, 2 * THIN * float((high - low).max()))
        low, high = low - beside, high + beside
        hull = _hull((low + high) / 2 + SIGNS * (high - low) / 2)
        assert hull is not None
    return Solid(hull, (hull,), model, _box(hull.geometry))


def _of_link(model: Any) -> Solid:
    """A link from coal's mesh: convex if its hull has the same volume, cut into slabs if the hull is much larger."""
    whole = _uncut(model)
    ratio = whole.hull.geometry.computeVolume() / max(abs(model.computeVolume()), 1e-12)
    if ratio <= SAME_VOLUME:
        return replace(whole, mesh=None)
    return whole if ratio < FAT else replace(whole, pieces=_slabs(*whole.surface) or whole.pieces)


def _hulls(parts: Sequence[np.ndarray]) -> tuple[Piece, ...]:
    """The convex hulls of sets of points (M, 3); empty if one is flat."""
    pieces = [_hull(part) for part in parts]
    return tuple(piece for piece in pieces if piece is not None) if None not in pieces else ()


def _slabs(vertices: np.ndarray, triangles: np.ndarray) -> tuple[Piece, ...]:
    """Hulls of the parts between parallel planes across the longest side: each solid slab lies in its piece.

    The hull of a part of the surface between two planes is that of its vertices and of where edges cross the planes.
    """
    ends = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), 1).astype(np.int64)
    one = np.unique(ends[:, 0] * len(vertices) + ends[:, 1])  # edges as numbers: sorted ten times as fast
    edges = np.column_stack([one // len(vertices), one % len(vertices)])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    along = int(np.argmax(high - low))
    cuts = np.linspace(low[along], high[along], SLABS + 1)
    a, b = vertices[edges[:, 0]], vertices[edges[:, 1]]
    crossings = []
    for place in cuts:
        across = (a[:, along] - place) * (b[:, along] - place) < 0
        share = (place - a[across, along]) / (b[across, along] - a[across, along])
        crossings.append(a[across] + share[:, None] * (b[across] - a[across]))
    out = []
    for k in range(SLABS):
        inside = (vertices[:, along] >= cuts[k]) & (vertices[:, along] <= cuts[k + 1])
        points = np.vstack([vertices[inside], crossings[k], crossings[k + 1]])
        if len(points):
            piece = _hull(points)
            if piece is None:  # a piece without volume; the whole hull replaces it
                return ()
            out.append(piece)
    return tuple(out)


def _hull(points: np.ndarray) -> Piece | None:
    """The convex hull of points (N, 3); None if they are flat, of which coal may crash."""
    if len(points) < 4:
        return None
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if extents[-1] <= THIN * extents[0]:
        return None
    cloud = coal.StdVec_Vec3s()
    for point in points:
        cloud.append(point)
    try:
        geometry = coal.Convex.convexHull(cloud, True, "Qt")
    except (RuntimeError, ValueError):
        return None
    return Piece(geometry, np.array(geometry.points()))


class Gauge:
    """Measures the distance [m] of two convex pieces repeatedly; each time it starts from the last result."""

    def __init__(self, a: Piece, b: Piece) -> None:
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._measure = coal.ComputeDistance(a.geometry, b.geometry)
        self.exact = a.exact and b.exact

    def __call__(self, at: Any, bt: Any) -> float:
        """The distance of the pieces placed at `at` and `bt` (coal's transforms); negative where they overlap."""
        self._result.clear()
        return float(self._measure(at, bt, self._request, self._result))

    @property
    def normal(self) -> np.ndarray:
        """Direction (3,) from the second piece towards the first, by the last measurement."""
        return -np.asarray(self._result.normal)


class Ruler:
    """Measures distances between two solids repeatedly.

    `near` is the distance between hulls, `mid` between pieces, `exact` between the solids themselves: each a lower
    bound of the next. Negative where convex bodies overlap (by how deep); 0 where meshes touch. Placements are coal's
    transforms (see `placement`).
    """

    def __init__(self, a: Solid, b: Solid) -> None:
        self.a, self.b = a, b
        self.convex = (a.convex or b.corners is None) and (b.convex or a.corners is None)
        self.cut = not self.convex and len(a.pieces) * len(b.pieces) > 1
        self.near = Gauge(a.hull, b.hull)

    @cached_property
    def _pieces(self) -> list[Gauge]:
        """A gauge for each pair of pieces."""
        return [Gauge(p, q) for p in self.a.pieces for q in self.b.pieces]

    def mid(self, at: Any, bt: Any) -> float:
        """Distance [m] between the nearest pieces."""
        return min(gauge(at, bt) for gauge in self._pieces)

    def exact(self, at: Any, bt: Any) -> float:
        """Distance [m] between the solids."""
        if self.convex:
            return self.near(at, bt)
        a, b = self._exact
        return max(0.0, float(coal.distance(a, at, b, bt, coal.DistanceRequest(), coal.DistanceResult())))

    @property
    def _exact(self) -> tuple[Any, Any]:
        """The geometries between which the exact distance is computed: hulls of convex solids, else meshes."""
        return (
            self.a.hull.geometry if self.a.convex else self.a.mesh,
            self.b.hull.geometry if self.b.convex else self.b.mesh,
        )

    def depth(self, at: Any, bt: Any) -> float:
        """Depth [m] of the deepest triangles of two bodies, of which one is a mesh; 0 if their surfaces do not meet."""
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        request.num_max_contacts = 100
        a, b = self._exact
        coal.collide(a, at, b, bt, request, result)
        return max((abs(result.getContact(i).penetration_depth) for i in range(result.numContacts())), default=0.0)


def placement(rotation: np.ndarray, origin: np.ndarray) -> Any:
    """A rotation (3, 3) and an origin (3,) [m] as coal's transform."""
    return coal.Transform3s(rotation, origin)
