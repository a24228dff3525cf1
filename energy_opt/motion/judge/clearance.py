"""What a cell has to say of motions and paths."""

from __future__ import annotations

import numpy as np

from energy_opt.cell.cell import Cell, Clearance
from energy_opt.motion.path import JointPath
from energy_opt.motion.trajectory import Trajectory

ROOM = 2.0  # ways keep so many times the clearance that is asked for, as far as the ends allow


def clearance_of(cell: Cell, trajectory: Trajectory) -> Clearance:
    """The proof for a trajectory, between its rows too; its ends say what may be asked of it."""
    t = trajectory
    return cell.prove(t.time, t.position, t.velocity, t.acceleration)


def clearance_along(cell: Cell, path: JointPath, wanted: np.ndarray | None = None) -> Clearance:
    """The proof for a path; its `time` is the path's parameter. Cubic pieces are quintic ones between their knots."""
    s = path.knots
    return cell.prove(s, path(s), path(s, 1), path(s, 2), wanted)


class FreeIn:
    """Poses and paths that are free in a cell, for the search for ways between two ends (see `ways.Free`)."""

    def __init__(self, cell: Cell, start: np.ndarray, goal: np.ndarray) -> None:
        self._cell = cell
        self._wanted = cell.wanted(np.stack([start, goal]))
        held = self._wanted < cell.asked  # half of what an end has: a little more than that is all there is
        self._room = np.where(held, 1.5, ROOM) * self._wanted

    def clear(self, q: np.ndarray) -> bool:
        """Whether the pose q (n,) is free with room to spare."""
        return self._cell.clear(q, self._room)

    def unproven(self, path: JointPath) -> float | None:
        """Where along the path its freedom could not be proven; None where all of it is."""
        found = clearance_along(self._cell, path, self._wanted)
        if found.proven:
            return None
        return 0.5 if found.time is None else found.time
