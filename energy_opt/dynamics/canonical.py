"""Numeric rewriting of a kinematic tree so that its symbolic dynamics become short. Torques do not change.

1. Every link frame is turned so that its joint axis is +z, and its origin slid along that axis (for a prismatic
   joint: anywhere) to leave few non-zero offsets.
2. What the joint torques cannot tell from inertia of the parent is moved to the parent (base parameters). With the
   4 x 4 pseudo-inertia J = [[S, h], [h', m]], S the second moment, h the first and m the mass: a revolute joint about
   z cannot tell S_zz, h_z and m; a prismatic one cannot tell S.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.robot.links import Link, pseudo_inertia

ROUNDING = 1e-12  # what six-digit right angles in a URDF leave behind is smaller; coarser snapping would change torques


@dataclass(frozen=True)
class CanonicalLink:
    """A link whose joint axis is +z: parent index (-1 base), placement (4, 4) at q = 0, pseudo-inertia (4, 4).

    `from_original` (4, 4) maps a point's homogeneous coordinates in the link's original frame to this one.
    """

    prismatic: bool
    parent: int
    placement: np.ndarray
    pseudo_inertia: np.ndarray
    from_original: np.ndarray
    armature: float


def snapped(matrix: np.ndarray, tolerance: float = ROUNDING) -> np.ndarray:
    """Entries within `tolerance` of 0 and +-1 made exact, so that symbolic products with them vanish."""
    out = np.where(np.abs(matrix) < tolerance, 0.0, matrix)
    return np.where(np.abs(np.abs(out) - 1) < tolerance, np.sign(out), out)


def _pose(rotation: np.ndarray, offset: np.ndarray | None = None) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = rotation
    if offset is not None:
        out[:3, 3] = offset
    return out


def _turn_to_z(axis: np.ndarray) -> np.ndarray:
    """A rotation Q with Q e_z = axis; a signed permutation where the axis is a coordinate axis."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return snapped(np.column_stack([x, np.cross(axis, x), axis]))


class _Frames:
    """Placements of turned frames whose origins may still slide."""

    def __init__(self, links: Sequence[Link]) -> None:
        self.links = links
        turn = [_turn_to_z(link.axis) for link in links]
        self.turn = turn
        self.base = []
        for k, link in enumerate(links):
            parent = _pose(turn[link.parent]) if link.parent >= 0 else np.eye(4)
            pose = parent.T @ link.placement @ _pose(turn[k])
            self.base.append(_pose(snapped(pose[:3, :3]), snapped(pose[:3, 3])))
        self.shift = [np.zeros(3) for _ in links]
        self.parent_turns = [False] * len(links)
        turns = [False] * len(links)
        for k, link in enumerate(links):
            self.parent_turns[k] = link.parent >= 0 and turns[link.parent]
            turns[k] = self.parent_turns[k] or not link.prismatic

    def offset(self, k: int) -> np.ndarray:
        """Origin of frame k in its parent's frame at q = 0, (3,)."""
        parent = self.links[k].parent
        moved = self.base[k][:3, 3] + self.base[k][:3, :3] @ self.shift[k]
        return snapped(moved - (self.shift[parent] if parent >= 0 else 0.0))

    def cost(self) -> int:
        """Non-zero offsets that the recursion must multiply by."""
        return sum(int(np.count_nonzero(self.offset(k))) for k in range(len(self.links)) if self.parent_turns[k])

    def slide(self) -> None:
        """Coordinate descent on `cost` over origins that lie on the joint axes."""
        z = np.array([0.0, 0.0, 1.0])
        for _ in range(3):
            for k, link in enumerate(self.links):
                rotation, offset, here = self.base[k][:3, :3], self.offset(k), self.shift[k]
                trials = [here]
                if link.prismatic:
                    trials.append(here - rotation.T @ offset)
                else:
                    axis = rotation[:, 2]
                    trials += [here - z * offset[i] / axis[i] for i in range(3) if abs(axis[i]) > 1e-6]
                    trials += [here + z * self.offset(c)[2] for c, other in enumerate(self.links) if other.parent == k]
                costs = []
                for trial in trials:
                    self.shift[k] = trial
                    costs.append(self.cost())
                self.shift[k] = trials[int(np.argmin(costs))]


def canonical(links: Sequence[Link]) -> tuple[CanonicalLink, ...]:
    """The tree in canonical frames with base-parameter inertias."""
    frames = _Frames(links)
    frames.slide()
    placement = [_pose(frames.base[k][:3, :3], frames.offset(k)) for k in range(len(links))]
    maps, inertias = [], []
    for k, link in enumerate(links):
        maps.append(np.linalg.inv(_pose(frames.turn[k]) @ _pose(np.eye(3), frames.shift[k])))
        inertias.append(maps[k] @ pseudo_inertia(link.mass, link.lever, link.inertia) @ maps[k].T)
    for k in reversed(range(len(links))):
        hidden = np.zeros((4, 4))
        if links[k].prismatic:
            hidden[:3, :3] = inertias[k][:3, :3]
        else:
            hidden[2:, 2:] = inertias[k][2:, 2:]
        inertias[k] = inertias[k] - hidden
        if links[k].parent >= 0:
            inertias[links[k].parent] = inertias[links[k].parent] + placement[k] @ hidden @ placement[k].T
    return tuple(
        CanonicalLink(
            link.prismatic, link.parent, placement[k], snapped(inertias[k], 1e-14), snapped(maps[k]), link.armature
        )
        for k, link in enumerate(links)
    )
