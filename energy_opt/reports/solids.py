"""A cell's bodies as triangles to draw: the hulls that distances are measured between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import ConvexHull

from energy_opt.cell.bodies import Body
from energy_opt.cell.cell import Cell
from energy_opt.cell.solids import LARGE, Piece
from energy_opt.reports.motion import Solid

MOST_CORNERS = 300  # of one hull: more are not seen
POINTS = 200  # of which a body with a radius is drawn, shared among its corners
LEAST_POINTS = 12  # around one corner


def drawn(cell: Cell | None) -> tuple[list[Solid], list[Solid]]:
    """The arm with what it carries, and what is around it; neither where no bodies are known."""
    arm: list[Solid] = []
    scene: list[Solid] = []
    if cell is None:
        return arm, scene
    for k, body in enumerate(cell.bodies.all):
        (arm if k < cell.links or body.joint >= 0 else scene).extend(_solids(body))
    return arm, scene


def _solids(body: Body) -> list[Solid]:
    if body.solid.corners is None:  # a half-space: its surface
        half = LARGE / 5
        square = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
        return [replace(_placed(body, square, np.array([[0, 1, 2], [0, 2, 3]])), surface=True)]
    return [solid for piece in body.solid.pieces if (solid := _hull(body, piece)) is not None]


def _hull(body: Body, piece: Piece) -> Solid | None:
    points = piece.points
    if piece.radius > 0:
        ball = directions(max(POINTS // len(points), LEAST_POINTS))
        points = (points[:, None] + piece.radius * ball).reshape(-1, 3)
    hull = ConvexHull(points, qhull_options="QJ")
    if len(hull.vertices) > MOST_CORNERS:
        hull = ConvexHull(points[_spread(points[hull.vertices], hull.vertices)], qhull_options="QJ")
    a, b, c = hull.points[hull.simplices].transpose(1, 0, 2)
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    simplices = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)  # seen from outside, all alike
    corners, faces = np.unique(simplices, return_inverse=True)
    return _placed(body, hull.points[corners], faces.reshape(-1, 3))


def directions(count: int) -> np.ndarray:
    """Unit vectors (count, 3), spread evenly over the sphere (Fibonacci's lattice)."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)


def _spread(points: np.ndarray, index: np.ndarray) -> np.ndarray:
    """The farthest points in directions that are spread evenly over the sphere."""
    return np.unique(index[np.argmax(points @ directions(MOST_CORNERS).T, axis=0)])


def _placed(body: Body, points: np.ndarray, faces: np.ndarray) -> Solid:
    return Solid(body.joint, points @ body.pose[:3, :3].T + body.pose[:3, 3], faces, body.name)
