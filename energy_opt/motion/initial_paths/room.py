"""The space for paths in a cell: a quick check of poses, by convex shapes, and the cell's proof for paths."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from energy_opt.cell.bodies import Scenery
from energy_opt.cell.cell import Cell
from energy_opt.cell.curve import MotionCurve
from energy_opt.cell.proof import prove
from energy_opt.motion.path import JointPath
from energy_opt.robot import Link
from energy_opt.robot.kinematics import Coupling

STEP = 0.04  # [m] approximate largest motion of the farthest point between checked poses along a line
WIDEST = 0.12  # [rad] largest motion of a joint between them
TOOL = 0.2  # [m] reach of the last link beyond its joint
# [m] clearance of a path beyond what is asked for, but not more than this again: smoothing bends it slightly later; in
# all at most half of an end's
KEPT = 0.002
LOOKED = 0.5, 0.002  # share of this clearance, and most [m], that poses keep in addition: room for rounding corners
MANY = 200  # bodies from which on Pinocchio's check, whose time grows with their square, is the slower one


def steps(links: Sequence[Link]) -> np.ndarray:
    """Spacing (n,) [rad, m] of the checked poses along a line: larger for joints that move the arm little."""
    reach = np.full(len(links), TOOL)
    for link, own in zip(reversed(links), range(len(links) - 1, -1, -1), strict=True):  # children before their parents
        if link.parent >= 0:
            beyond = float(np.linalg.norm(link.placement[:3, 3])) + reach[own]
            reach[link.parent] = max(reach[link.parent], beyond)
    turning = np.minimum(STEP / reach, WIDEST)
    step = np.where([link.prismatic for link in links], STEP, turning)
    with np.errstate(divide="ignore"):  # a joint that drives others moves at most as far as each of them may
        return np.asarray((step[:, None] / np.abs(Coupling.of(links).matrix)).min(axis=0))


class Room:
    """Collision checks for paths between two poses.

    Args:
        ends: (2, n) start and goal, both free. Near those that leave little, paths keep what the cell asks for there.
    """

    def __init__(self, cell: Cell, ends: np.ndarray) -> None:
        self._bodies = cell.bodies
        self._kept = np.maximum(cell.wanted(ends, cell.asked + min(KEPT, cell.asked)), cell.wanted(ends))
        looked = self._kept + np.minimum(LOOKED[0] * self._kept, LOOKED[1])
        for q in ends:  # an end itself must keep the margin
            for p, distance in cell.distances(q, float(looked.max(initial=0.0))):
                looked[p] = min(looked[p], (self._kept[p] + distance) / 2)
        self._looked, self._fine = looked, self._only_hulls_are_near(ends, looked)
        self._touches = self._by_boxes if len(cell.bodies.all) > MANY else self._by_pinocchio(cell)

    def _by_pinocchio(self, cell: Cell) -> Callable[[np.ndarray], bool]:
        """A check of one pose (n,) that takes microseconds where there are few bodies."""
        parts: list[tuple[int, np.ndarray, Any]] = []
        known: dict[tuple[int, bool], range] = {}
        pairs, margins = [], []
        for p, pair in enumerate(cell.bodies.pairs.tolist()):
            fine = p in self._fine
            for k in pair:
                if (k, fine) not in known:
                    body = cell.bodies.all[k]
                    exact = fine and body.solid.mesh is not None
                    shapes = [body.solid.mesh] if exact else [piece.geometry for piece in body.solid.pieces]
                    known[k, fine] = range(len(parts), len(parts) + len(shapes))
                    parts += [(body.joint, body.pose, shape) for shape in shapes]
            for a in known[pair[0], fine]:
                for b in known[pair[1], fine]:
                    pairs.append((a, b))
                    margins.append(float(self._looked[p]))
        check = cell.robot.body.collision_check
        return check(parts, np.array(pairs, dtype=int).reshape(-1, 2), np.array(margins))

    def _by_boxes(self, q: np.ndarray) -> bool:
        """The same check of the pose q (n,) in a time that grows with the number of bodies."""
        return any(
            (ruler.exact if p in self._fine else ruler.mid)(at, bt) <= self._looked[p]
            for _, p, ruler, at, bt, _ in Scenery(self._bodies, q[None]).hulls(self._looked)
        )

    def _only_hulls_are_near(self, ends: np.ndarray, margins: np.ndarray) -> set[int]:
        """Pairs whose convex shapes are nearer than their margins (P,) [m] at an end, but the bodies are not."""
        near = Scenery(self._bodies, ends).hulls(margins)
        return {p for _, p, ruler, at, bt, _ in near if not ruler.convex and ruler.mid(at, bt) <= margins[p]}

    def clear(self, q: np.ndarray) -> bool:
        """True if the pose q (n,) keeps the margin of pose checks."""
        return not self._touches(q)

    def unproven(self, path: JointPath) -> float | None:
        """A place along the path (s) whose clearance could not be proven; None if all of it is proven."""
        s = path.knots
        proof = prove(self._bodies, MotionCurve(s, path(s), path(s, 1), path(s, 2)), self._kept)
        if proof.verdict == "proven":
            return None
        where = proof.touches[0] if proof.touches else proof.least
        return 0.5 if where is None else where.time
