"""Overlaps of bodies that no joint moves: those of an arm's base, or of an object, with what is fixed in the cell.

Fixed bodies may overlap as they are given: a base is bolted to its table. At another place they may not. Also overlaps
of the bodies on a joint, such as a hand, wherever the joints before it are.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from energy_opt.cell.bodies import Body
from energy_opt.cell.cell import Cell, Contact
from energy_opt.cell.proof import overlap
from energy_opt.cell.scene import FLOOR, Scene, facing
from energy_opt.cell.solids import Ruler, placement
from energy_opt.cell.words import length

SUNK = 0.002  # [m] fixed bodies that overlap by no more stand on each other


class Standing:
    """The overlaps of an arm's fixed links, or of an object, with the fixed bodies of a scene.

    Args:
        cell: with both as they are given. moved: the name of the object; None for the arm's base.
    """

    def __init__(self, cell: Cell, moved: str | None) -> None:
        scene = cell.scene or Scene()
        still = {thing.name for thing in scene.objects if not (thing.frame or thing.attached_to)}
        fixed = [(body, k < cell.links) for k, body in enumerate(cell.bodies.all) if body.joint < 0]
        self._base, self._joint = moved is None, cell.robot.body.tree()[0].placement[:3, 3]
        if moved is not None:
            still -= {moved}
            things = [body for body, own in fixed if not own and body.name == moved]
            around = [body for body, own in fixed if own or body.name in {*still, FLOOR}]
        else:  # the floor does not concern the base
            things = [body for body, own in fixed if own]
            around = [body for body, own in fixed if not own and body.name in still]
        apart = ((a, b) for a in things for b in around if not scene.allowed.allows(a.name, b.name))
        self._pairs = [(a, b, Ruler(a.solid, b.solid)) for a, b in apart]
        self._given = self._depths(np.eye(4))

    def overlap(self, motion: np.ndarray) -> str | None:
        """Where a body is deeper in another than as given, or than one that rests on it; None if none is.

        Args:
            motion: (4, 4) from the given place to the new one, in the frame of the given base.
        """
        deeper = {pair: depth for pair, depth in self._depths(motion).items() if depth > self._given[pair] + SUNK}
        if not deeper:
            return None
        a, b = max(deeper, key=lambda pair: deeper[pair])
        how = f"{length(deeper[a, b])} deep in" if np.isfinite(deeper[a, b]) else "inside"
        return f"{a} would be {how} {b}"

    def _depths(self, motion: np.ndarray) -> dict[tuple[str, str], float]:
        """How deep [m] the bodies of each pair of names overlap; infinite if one is inside the other's surface."""
        out: dict[tuple[str, str], float] = {}
        for a, b, ruler in self._pairs:
            depth = _depth(ruler, motion @ a.pose, self._faced(b, motion))
            out[a.name, b.name] = max(depth, out.get((a.name, b.name), 0.0))
        return out

    def _faced(self, body: Body, motion: np.ndarray) -> np.ndarray:
        """The pose of a body; a plane leaves the side of the moved arm free."""
        if not self._base or body.solid.corners is not None:
            return body.pose
        return motion @ facing(np.linalg.inv(motion) @ body.pose, self._joint)


def touching_anyhow(
    cell: Cell, joint: int, poses: Iterable[np.ndarray], moved: str | None, along: bool
) -> Contact | None:
    """The contact of the bodies on a joint with objects that do not move, at the pose where the deepest is least deep.

    Args:
        joint: its index. poses: (4, 4) of its frame in that of the base. moved: an object that is moved.
        along: whether the poses move with that object, and so only touch it; else they touch only others.

    Returns:
        None if nothing touches at one of the poses. Planes do not count: they leave the side of the arm free.
    """
    bodies, found = cell.bodies, list[tuple[float, str, str]]()
    pairs = [
        (bodies.ruler(p), bodies.all[a], bodies.all[b]) for p, (a, b) in enumerate(bodies.pairs.tolist())
        if bodies.joint[a] == joint and b >= cell.obstacles and bodies.still[b] and not bodies.flat[b]
        and (bodies.all[b].name == moved) == along
    ]  # fmt: skip
    for pose in poses:
        depths = ((_depth(ruler, pose @ a.pose, b.pose), a.name, b.name) for ruler, a, b in pairs)
        found.append(max(depths, default=(0.0, "", "")))
        if not found[-1][0]:
            return None
    depth, *names = min(found)
    return Contact((names[0], names[1]), -depth, depth, listed=True)


def _depth(ruler: Ruler, a: np.ndarray, b: np.ndarray) -> float:
    """How deep [m] two bodies overlap at poses (4, 4); infinite if one is inside the other's surface."""
    at, bt = (placement(pose[:3, :3], pose[:3, 3]) for pose in (a, b))
    return overlap(ruler, at, bt)
