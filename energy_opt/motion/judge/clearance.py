"""Clearance of motions and paths in a cell."""

from __future__ import annotations

from energy_opt.cell.cell import Cell, Clearance
from energy_opt.motion.path import JointPath
from energy_opt.motion.trajectory import Trajectory


def clearance_of(cell: Cell, trajectory: Trajectory) -> Clearance:
    """The proof for a trajectory, between its samples too; its ends determine the distances that can be required."""
    t = trajectory
    return cell.prove(t.time, t.position, t.velocity, t.acceleration)


def clearance_along(cell: Cell, path: JointPath) -> Clearance:
    """The proof for a path; its `time` is the path's parameter. Cubic pieces are quintic ones between their knots."""
    s = path.knots
    return cell.prove(s, path(s), path(s, 1), path(s, 2))


def cell_beside(cell: Cell, path: JointPath) -> Cell:
    """The cell for a given path: see `Cell.beside`."""
    s = path.knots
    return cell.beside(s, path(s), path(s, 1), path(s, 2))
