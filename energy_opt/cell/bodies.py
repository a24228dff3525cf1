"""All bodies that can touch: those of the links, the bodies that links carry, and those of the cell. The module `pairs`
selects the pairs that must not touch.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell import solids
from energy_opt.cell.solids import GJK_ERROR, Ruler, Solid, placement
from energy_opt.errors import BadInput
from energy_opt.numerics.hulls import Hulls, Pairs
from energy_opt.robot import Robot
from energy_opt.robot.checks import placed
from energy_opt.robot.kinematics import Kinematics, Poses
from energy_opt.robot.meshes import mesh_files


@dataclass(frozen=True, eq=False)
class Body:
    """A solid on a joint.

    Attributes:
        name: of the link or object. joint: index of the joint; -1 for the fixed base. pose: (4, 4) in that joint's
            frame. solid: its shape.
    """

    name: str
    joint: int
    pose: np.ndarray
    solid: Solid


class Bodies:
    """All bodies of a cell, and the pairs of them that must not touch.

    Args:
        kinematics: of the arm. bodies: in any order.
        pairs: (P, 2) indices of bodies. In each pair the body that more joints move comes first.

    Attributes:
        joint: (B,) joint of each body. still: (B,) whether it never moves. flat: (B,) whether it is a half-space.
        corners: (B, 8, 3) [m] corners of the bodies' boxes in their joints' frames.
        moves: (2, P, L) whether joint l moves the first (second) body of a pair and not the other one.
        planar: (P,) whether a plane fixed in the second body can bound the distance: both are convex, and no joint
            moves the second body alone.
    """

    def __init__(self, kinematics: Kinematics, bodies: Sequence[Body], pairs: np.ndarray) -> None:
        self.kinematics, self.all = kinematics, tuple(bodies)
        self.joint = np.array([body.joint for body in bodies], dtype=int)
        self.rotation = np.array([body.pose[:3, :3] for body in bodies]).reshape(-1, 3, 3)
        self.shift = np.array([body.pose[:3, 3] for body in bodies]).reshape(-1, 3)
        self.still = self.joint < 0
        self.flat = np.array([body.solid.corners is None for body in bodies], dtype=bool)
        boxes = [np.zeros((8, 3)) if b.solid.corners is None else b.solid.corners for b in bodies]
        self.corners = np.array([box @ b.pose[:3, :3].T + b.pose[:3, 3] for box, b in zip(boxes, bodies, strict=True)])
        moved = kinematics.moves[self.joint].sum(axis=1)
        pairs = np.asarray(pairs, dtype=int).reshape(-1, 2)
        swap = moved[pairs[:, 0]] < moved[pairs[:, 1]]
        self.pairs = np.where(swap[:, None], pairs[:, ::-1], pairs)
        # moves[k, pair, joint]: True if the joint moves body k of the pair and not the other one
        a, b = kinematics.moves[self.joint[self.pairs[:, 0]]], kinematics.moves[self.joint[self.pairs[:, 1]]]
        self.moves = np.stack([a & ~b, b & ~a])
        self._rulers: dict[int, Ruler] = {}
        # pairs that a plane can separate: convex bodies, of which joints move only the first against the second
        convex = np.array([body.solid.convex for body in bodies], dtype=bool)
        first, second = self.pairs.T
        self.planar = convex[first] & convex[second] & ~self.moves[1].any(axis=1) & ~self.flat[first]

    def poses(self, q: np.ndarray, u: np.ndarray) -> Poses:
        """Frames of the links at q (K, n); u (K,) in [0, 1] along a move matters where other arms move (`moving`)."""
        return self.kinematics(q)

    def frames(self, poses: Poses, k: np.ndarray, body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (M, 3, 3) and origins (M, 3) [m] of bodies in the base frame.

        Args:
            poses: of all joints, by configuration. k: (M,) indices of configurations. body: (M,) indices of bodies.
        """
        turn, joint = poses.rotation[k, self.joint[body]], self.joint[body]
        shift = np.matmul(turn, self.shift[body][:, :, None])[..., 0]
        return np.matmul(turn, self.rotation[body]), shift + poses.origin[k, joint]

    def frame(self, poses: Poses, k: int, body: int) -> tuple[np.ndarray, np.ndarray]:
        """The same of body number `body` at configuration number `k`: (3, 3) and (3,) [m]."""
        turn, joint = poses.rotation[k, self.joint[body]], self.joint[body]
        return turn @ self.rotation[body], turn @ self.shift[body] + poses.origin[k, joint]

    def placements(self, poses: Poses, k: np.ndarray, body: np.ndarray) -> dict[tuple[int, int], Any]:
        """Poses of bodies as coal's transforms, by configuration and body.

        Args:
            poses: of all joints, by configuration. k: (M,) indices of configurations. body: (M,) indices of bodies.
        """
        k, body = np.divmod(np.unique(k * len(self.all) + body), len(self.all))
        names, frames = zip(k.tolist(), body.tolist(), strict=True), zip(*self.frames(poses, k, body), strict=True)
        return {name: placement(*frame) for name, frame in zip(names, frames, strict=True)}

    def ruler(self, pair: int) -> Ruler:
        """The ruler that measures a pair's distance; it is built once."""
        if pair not in self._rulers:
            a, b = self.pairs[pair]
            self._rulers[pair] = Ruler(self.all[a].solid, self.all[b].solid)
        return self._rulers[pair]

    def corners_of(self, body: int) -> tuple[np.ndarray, float]:
        """A convex body's vertices (V, 3) [m] in the frame of its joint, and the radius around them; of a half-space
        a point of its plane."""
        hull = self.all[body].solid.hull
        points = np.zeros((1, 3)) if self.flat[body] else hull.points
        return points @ self.rotation[body].T + self.shift[body], hull.radius

    @cached_property
    def hulls(self) -> Hulls:
        """The convex hulls of all bodies."""
        corners = [self.corners_of(i) for i in range(len(self.all))]
        radius = np.array([radius for _, radius in corners])
        face = np.where(self.flat[:, None], self.rotation[:, :, 2], 0.0)
        return Hulls([points for points, _ in corners], radius, self.joint, face)

    @cached_property
    def hull_pairs(self) -> Pairs:
        """The pairs of hulls, with what moves them."""
        of = self.kinematics
        return Pairs(self.pairs, self.moves, self.planar, self.corners, of.prismatic, of.coupling.matrix)

    def names(self, pair: int) -> tuple[str, str]:
        """The names of a pair's bodies."""
        a, b = self.pairs[pair]
        return self.all[a].name, self.all[b].name


class Scenery:
    """The bodies at N configurations q (N, n) [rad, m]. Boxes and placements are computed on demand."""

    def __init__(self, bodies: Bodies, q: np.ndarray) -> None:
        self.bodies, self.q = bodies, q
        self.poses: Poses = bodies.kinematics(q)
        self._placed: dict[tuple[int, int], Any] = {}

    def corners(self, k: np.ndarray, body: np.ndarray) -> np.ndarray:
        """Corners (M, 8, 3) [m] in the base frame of the boxes of bodies (M,) at configurations k (M,)."""
        joint = self.bodies.joint[body]
        turned = np.matmul(self.bodies.corners[body], self.poses.rotation[k, joint].transpose(0, 2, 1))
        return turned + self.poses.origin[k, joint][:, None]

    def placed(self, k: int, body: int) -> Any:
        """A body's placement as coal's transform."""
        key = (0 if self.bodies.still[body] else k, body)
        if key not in self._placed:
            self._placed[key] = placement(*self.bodies.frame(self.poses, *key))
        return self._placed[key]

    def place(self, k: np.ndarray, body: np.ndarray) -> None:
        """Make placements of bodies (M,) at configurations (M,) ready: many at once cost far less than one by one."""
        self._placed |= self.bodies.placements(self.poses, np.where(self.bodies.still[body], 0, k), body)

    def apart(self, k: np.ndarray, pair: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lower bounds (M,) [m] of pairs' distances from boxes along the axes of the base (0: none), and both boxes'
        corners.

        The distance of two boxes is the norm of their gaps along the axes. To a half-space it is the least height of
        the other body's corners.

        Args:
            k: (M,) configurations. pair: (M,) numbers of pairs.

        Returns:
            Bounds (M,), corners of the first and of the second bodies, (M, 8, 3) [m] each.
        """
        b = self.bodies
        bodies = b.pairs[pair]
        boxes, low, high = [], [], []
        for side in (0, 1):
            at = np.where(b.still[bodies[:, side]], 0, k)  # a fixed body has one box for all configurations
            key, back = np.unique(at * len(b.all) + bodies[:, side], return_inverse=True)
            box = self.corners(key // len(b.all), key % len(b.all))
            boxes.append(box[back])
            low.append(box.min(axis=1)[back])
            high.append(box.max(axis=1)[back])
        gap = np.maximum(low[0] - high[1], low[1] - high[0]).clip(0)
        out = np.sqrt(np.sum(gap**2, axis=1))
        for side in (0, 1):
            flat = np.flatnonzero(b.flat[bodies[:, side]])
            if len(flat):
                turn, through = b.frames(self.poses, k[flat], bodies[flat, side])
                heights = np.einsum("mci,mi->mc", boxes[1 - side][flat] - through[:, None], turn[:, :, 2])
                out[flat] = heights.min(axis=1).clip(0)
        return out, boxes[0], boxes[1]

    def hulls(self, reach: float | np.ndarray) -> Iterator[tuple[int, int, Ruler, Any, Any, float]]:
        """Pairs whose convex hulls are no farther apart than `reach` [m], one for all or (P,), at each configuration.

        Yields:
            Configuration, number of the pair, its ruler, both placements, and the distance [m] of the hulls.
        """
        pairs, far = self.bodies.pairs, np.broadcast_to(reach, len(self.bodies.pairs))
        if not len(pairs):
            return
        normals = np.zeros((len(self.q), len(pairs), 3))
        most = float(far.max()) + GJK_ERROR
        bound = self.bodies.hulls.apart(self.poses.rotation, self.poses.origin, pairs[:, 0], pairs[:, 1], most, normals)
        k, pair = np.nonzero(~(bound > far + GJK_ERROR))
        for side in (0, 1):
            self.place(k, pairs[pair, side])
        for i, p in zip(k.tolist(), pair.tolist(), strict=True):
            ruler, at, bt = self.bodies.ruler(p), *(self.placed(i, body) for body in pairs[p].tolist())
            distance = ruler.near(at, bt)
            if distance <= far[p]:
                yield i, p, ruler, at, bt, distance

    def travel(
        self, k: np.ndarray, pair: np.ndarray, boxes: tuple[np.ndarray, np.ndarray], far: np.ndarray
    ) -> np.ndarray:
        """Upper bounds (M,) [m] of how far the bodies of a pair come towards each other when joints turn by up to
        `far`.

        Joints are moved one after the other, the outermost first. A joint that turns by d moves a point by at most d
        times its distance from the axis. This distance is that in the middle of the interval plus how far the joints
        before have moved the point. A joint that slides by d moves every point by d.

        Args:
            k: (M,) configurations. pair: (M,) numbers of pairs. boxes: corners as `apart` returns them. far:
                (M, L) [rad, m] largest change of each joint from configuration k.
        """
        b, out = self.bodies, np.zeros(len(k))
        for side in (0, 1):
            moved = np.zeros(len(k))
            used = b.moves[side][pair]
            for j in range(b.kinematics.count - 1, -1, -1):
                here = np.flatnonzero(used[:, j] & (far[:, j] > 0))
                if not len(here):
                    continue
                if b.kinematics.prismatic[j]:
                    moved[here] += far[here, j]
                    continue
                arm = boxes[side][here] - self.poses.origin[k[here], j][:, None]
                axis = self.poses.axis[k[here], j]
                along = np.einsum("mci,mi->mc", arm, axis)
                reach = np.sqrt((np.einsum("mci,mci->mc", arm, arm) - along**2).max(axis=1).clip(0))
                moved[here] += far[here, j] * (reach + moved[here])
            out += moved
        return out


MOST_TRIANGLES = 1_000_000  # most triangles of a mesh, as in a scene
OVERSIZE = 10.0  # [reaches of the arm, at least metres] a longer mesh of a moving link is in another unit


def arm_bodies(robot: Robot, package_dirs: Sequence[Path] = (), allow_large: bool = False) -> list[Body]:
    """Every collision body of the description, with locked joints at their positions.

    Args:
        robot: the arm. package_dirs: folders in which `package://` paths of meshes are found.
        allow_large: meshes may have more than MOST_TRIANGLES triangles.

    Raises:
        BadInput: a mesh is missing, too large, in another unit, or cannot be read; names the link.
    """
    description, frames = robot.description, robot.body.link_frames()
    longest = OVERSIZE * max(1.0, sum(float(np.linalg.norm(link.placement[:3, 3])) for link in robot.body.tree()))
    files = mesh_files(description, package_dirs, allow_large)
    known: dict[tuple[object, ...], Solid] = {}
    most = sys.maxsize if allow_large else MOST_TRIANGLES
    out = []
    for link in description.links.values():
        joint, at = frames[link.name]
        for body in link.collisions:
            key = body.kind, body.size, body.file
            if key not in known:
                try:
                    known[key] = (
                        solids.primitive(body.kind, body.size)
                        if body.kind != "mesh"
                        else solids.mesh_file(files[body.file], body.size, most)
                    )
                except BadInput as error:
                    remedy = "; --self-collision off plans without the arm's body"
                    raise BadInput(f"{description.path}: link {link.name}: {error}{remedy}") from None
            extent = float(np.ptp(known[key].hull.points, axis=0).max())
            if joint >= 0 and body.kind == "mesh" and extent > longest:
                raise BadInput(
                    f"{description.path}: link {link.name}: {body.file} is {extent:.4g} m long; if it is in "
                    'millimetres, scale="0.001 0.001 0.001" is missing'
                )
            out.append(Body(link.name, joint, at @ placed(body.pose), known[key]))
    return out
