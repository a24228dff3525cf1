"""The room that ways have in a cell: a quick test of poses, by convex shapes, and the cell's proof for paths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from energy_opt.cell.bodies import Scenery
from energy_opt.cell.cell import Cell
from energy_opt.cell.curve import MotionCurve
from energy_opt.cell.proof import prove
from energy_opt.motion.path import JointPath
from energy_opt.robot import Link
from energy_opt.robot.kinematics import Coupling

STEP = 0.04  # [m] that the farthest point moves, about, between poses that are looked at along a line
WIDEST = 0.12  # [rad] and no joint turns further than this
TOOL = 0.2  # [m] that the last link reaches beyond its joint
KEPT = 0.002  # [m] that a way is proven to keep: what smooths it later bends it a little; half of an end's if less
LOOKED = 1.5  # times that, by which poses are looked at: room for rounding corners


def steps(links: Sequence[Link]) -> np.ndarray:
    """How far apart (n,) [rad, m] poses along a line are looked at: a joint that moves little goes further."""
    reach = np.full(len(links), TOOL)
    for link, own in zip(reversed(links), range(len(links) - 1, -1, -1), strict=True):  # children before their parents
        if link.parent >= 0:
            beyond = float(np.linalg.norm(link.placement[:3, 3])) + reach[own]
            reach[link.parent] = max(reach[link.parent], beyond)
    turning = np.minimum(STEP / reach, WIDEST)
    step = np.where([link.prismatic for link in links], STEP, turning)
    with np.errstate(divide="ignore"):  # one that takes others along goes no further than each of them may
        return np.asarray((step[:, None] / np.abs(Coupling.of(links).matrix)).min(axis=0))


class Room:
    """What ways between two poses keep clear of.

    Args:
        ends: (2, n) start and goal, both free.
        kept: what ways are proven to keep [m]; twice what the cell asks for where that is more.
    """

    def __init__(self, cell: Cell, ends: np.ndarray, kept: float = KEPT) -> None:
        self._bodies = cell.bodies
        self._kept = cell.wanted(ends, max(kept, 2 * cell.asked))
        parts: list[tuple[int, np.ndarray, Any]] = []
        known: dict[tuple[int, bool], range] = {}
        pairs, margins = [], []
        for p, pair in enumerate(cell.bodies.pairs.tolist()):
            margin = LOOKED * float(self._kept[p])
            fine = any(self._too_fat(p, q, margin) for q in ends)
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
                    margins.append(margin)
        check = cell.robot.body.collision_check
        self._touches = check(parts, np.array(pairs, dtype=int).reshape(-1, 2), np.array(margins))

    def _too_fat(self, pair: int, q: np.ndarray, margin: float) -> bool:
        """Whether a pair's convex shapes stand nearer than `margin` at an end, where the bodies themselves do not."""
        ruler, scene = self._bodies.ruler(pair), Scenery(self._bodies, q[None])
        if ruler.convex:
            return False
        at, bt = (scene.placed(0, k) for k in self._bodies.pairs[pair].tolist())
        return ruler.near(at, bt) <= margin and ruler.mid(at, bt) <= margin

    def clear(self, q: np.ndarray) -> bool:
        """Whether the pose q (n,) keeps the margin by which poses are looked at."""
        return not self._touches(q)

    def unproven(self, path: JointPath) -> float | None:
        """Where along the path (s) the clearance could not be proven; None where all of it is proven."""
        s = path.knots
        proof = prove(self._bodies, MotionCurve(s, path(s), path(s, 1), path(s, 2)), self._kept)
        if proof.verdict == "proven":
            return None
        where = proof.touches[0] if proof.touches else proof.least
        return 0.5 if where is None else where.time
