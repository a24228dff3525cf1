"""The moving arm as data for the page's player: kinematic tree, hull meshes, scene, and the positions to play."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from scipy.spatial import ConvexHull

from energy_opt.cell.bodies import Body
from energy_opt.cell.cell import Cell
from energy_opt.cell.load import own_body
from energy_opt.cell.solids import LARGE, Piece
from energy_opt.reports.charts import rounded
from energy_opt.robot import Link, Robot
from energy_opt.robot.kinematics import Kinematics

FRAMES = 150  # instants of one motion; the player interpolates between them
COLOURS = {"result": "#2f74c0", "scaled": "#e07b28"}
OTHER = "#2e9a60"


class Motion(Protocol):
    """A sampled motion: time (N,) [s]; position, velocity, acceleration and effort (N, n), power (N,) [W], or None."""

    @property
    def time(self) -> np.ndarray: ...
    @property
    def position(self) -> np.ndarray: ...
    @property
    def velocity(self) -> np.ndarray: ...
    @property
    def acceleration(self) -> np.ndarray: ...
    @property
    def effort(self) -> np.ndarray | None: ...
    @property
    def power(self) -> np.ndarray | None: ...


@dataclass(frozen=True)
class Solid:
    """A body to draw: vertices (V, 3) [m] in the frame of joint `joint` (-1: the base), triangles (F, 3).

    Attributes:
        surface: of a half-space: drawn from its free side only.
    """

    joint: int
    vertices: np.ndarray
    triangles: np.ndarray
    name: str = ""
    surface: bool = False


@dataclass(frozen=True)
class Closest:
    """Where a motion comes nearest to touching: the names of both bodies, their distance [m], and when [s]."""

    pair: tuple[str, str]
    distance: float
    time: float

    @property
    def label(self) -> str:
        """The names and the distance, in words."""
        return f"closest: {' and '.join(self.pair)}, {1000 * self.distance:.3g} mm"


@dataclass(frozen=True)
class Played:
    """A motion to play; a ghost is drawn half transparent."""

    name: str
    trajectory: Motion
    ghost: bool = False
    shown: bool = True


def player(
    robot: Robot,
    motions: Sequence[Played],
    cell: Cell | None = None,
    closest: Closest | None = None,
    phases: Sequence[tuple[float, str]] = (),
) -> dict[str, Any] | None:
    """Data for the page's player; None if the robot has no bodies to draw.

    Args:
        cell: the robot among the bodies around it; None: the robot alone.
        closest: marked, and a time to jump to.
        phases: start [s] and name of each phase, shown while it plays.
    """
    links, shown, (bodies, scene) = robot.body.tree(), [], drawn(cell or own_body(robot))
    for played in motions:
        t = played.trajectory
        time = np.linspace(t.time[0], t.time[-1], FRAMES)
        q = np.column_stack([np.interp(time, t.time, column) for column in np.asarray(t.position).T])
        shown.append(
            {**_motion(links, time - time[0], q, [robot.body.last]), "name": played.name, "ghost": played.ghost,
             "shown": played.shown, "colour": COLOURS.get(played.name, OTHER)}
        )  # fmt: skip
    near = None
    if closest is not None:
        near = {"label": closest.label, "time": rounded(closest.time), "pair": list(closest.pair)}
    said = [{"time": rounded(time), "name": name} for time, name in phases]
    return _playing(links, [{"joint": body.joint, **_solid(body)} for body in bodies], scene, shown, near, said)


def cell_player(
    links: Sequence[Link],
    motion: tuple[np.ndarray, np.ndarray],
    tools: Sequence[int],
    bodies: Sequence[tuple[Solid, str]],
    scene: Sequence[Solid] = (),
) -> dict[str, Any] | None:
    """Data for the page's player for several arms in one scene; None if there are no bodies to draw.

    Args:
        links: of all arms in one tree.
        motion: time (N,) [s] and positions (N, n) of all arms' joints.
        tools: the last link of each arm, whose path is drawn.
        bodies: with their colours.
    """
    solids = [{"joint": body.joint, "colour": colour, **_solid(body)} for body, colour in bodies]
    about = {"name": "result", "colour": COLOURS["result"], "ghost": False, "shown": True}
    return _playing(links, solids, scene, [{**_motion(links, *motion, tools), **about}])


def _playing(
    links: Sequence[Link], bodies: list[dict[str, Any]], scene: Sequence[Solid], motions: list[dict[str, Any]],
    closest: dict[str, Any] | None = None, phases: Sequence[dict[str, Any]] = (),
) -> dict[str, Any] | None:  # fmt: skip
    """Input of the player; None without bodies."""
    tree = [
        {"parent": link.parent, "placement": rounded(link.placement), "axis": rounded(link.axis),
         "prismatic": link.prismatic}
        for link in links
    ]  # fmt: skip
    shown = {"tree": tree, "bodies": bodies, "scene": [_solid(body) for body in scene], "motions": motions}
    return {**shown, "closest": closest, "phases": list(phases)} if bodies else None


def _solid(body: Solid) -> dict[str, Any]:
    """A body for the player."""
    shape = {"vertices": rounded(body.vertices, 5), "faces": np.asarray(body.triangles).tolist()}
    return {"name": body.name, "surface": body.surface, **shape}


def _motion(links: Sequence[Link], time: np.ndarray, q: np.ndarray, tools: Sequence[int]) -> dict[str, Any]:
    """Times (N,) [s], positions of all joints of the tree out of those (N, n) that move by themselves, tools' ways."""
    kinematics = Kinematics(links)
    origin = kinematics(q).origin
    return {
        "time": rounded(time),
        "position": rounded(kinematics.coupling.positions(q), 5),
        "tools": [rounded(origin[:, tool], 4) for tool in tools],
    }


MOST_CORNERS = 300  # most corners of one hull: more are not visible
POINTS, ALL_POINTS = 200, 20_000  # most points for drawing one body with a radius, and all of them
LEAST_POINTS = 12  # least points around one corner


def drawn(cell: Cell | None) -> tuple[list[Solid], list[Solid]]:
    """The arm with what it carries, and its surroundings; both empty if no bodies are known."""
    arm: list[Solid] = []
    scene: list[Solid] = []
    if cell is None:
        return arm, scene
    points = min(POINTS, ALL_POINTS // max(len(cell.bodies.all), 1))
    for k, body in enumerate(cell.bodies.all):
        if k < cell.links or body.joint >= 0:
            arm += _solids(body, points)
        elif k >= cell.obstacles:  # else it is of another arm
            scene += _solids(body, points)
    return arm, scene


def _solids(body: Body, points: int) -> list[Solid]:
    """The bodies to draw for one body: its pieces, of `points` if they are round; of a half-space a square."""
    if body.solid.corners is None:  # a half-space: its surface
        half = LARGE / 5
        square = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
        return [replace(_placed(body, square, np.array([[0, 1, 2], [0, 2, 3]])), surface=True)]
    return [_hull(body, piece, points) for piece in body.solid.pieces]


def _hull(body: Body, piece: Piece, count: int) -> Solid:
    """The convex hull of a piece, with all triangles seen from outside and at most about MOST_CORNERS corners."""
    points = piece.points
    if len(points) < 4:  # a ball or a capsule; some have no radius
        ball = directions(max(count // len(points), LEAST_POINTS))
        points = (points[:, None] + piece.radius * ball).reshape(-1, 3)
    hull = ConvexHull(points, qhull_options="QJ")
    if len(hull.vertices) > MOST_CORNERS:
        farthest = np.argmax(points[hull.vertices] @ directions(MOST_CORNERS).T, axis=0)  # in even directions
        hull = ConvexHull(points[np.unique(hull.vertices[farthest])], qhull_options="QJ")
    a, b, c = hull.points[hull.simplices].transpose(1, 0, 2)
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    simplices = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)  # all triangles seen from outside
    corners, faces = np.unique(simplices, return_inverse=True)
    return _placed(body, hull.points[corners], faces.reshape(-1, 3))


def directions(count: int) -> np.ndarray:
    """Unit vectors (count, 3), spread evenly over the sphere (Fibonacci's lattice)."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)


def _placed(body: Body, points: np.ndarray, faces: np.ndarray) -> Solid:
    """A body to draw, with its points in the frame of its joint."""
    return Solid(body.joint, points @ body.pose[:3, :3].T + body.pose[:3, 3], faces, body.name)
