"""Clearance of motions and paths in a cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.cell.cell import Cell, Clearance
from energy_opt.cell.curve import MotionCurve
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.path import JointPath
from energy_opt.motion.trajectory import Trajectory


def clearance_of(cell: Cell, trajectory: Trajectory, stops: np.ndarray | None = None) -> Clearance:
    """The proof for a trajectory, between its samples too; its ends determine the distances that can be required.

    Args:
        stops: (K, n) further ends, of the motions that the trajectory consists of.
    """
    t = trajectory
    wanted = None if stops is None else cell.wanted(np.vstack([t.position[[0, -1]], stops]))
    return cell.prove(t.time, t.position, t.velocity, t.acceleration, wanted)


def measured(cell: Cell | None, trajectory: Trajectory, certificate: Certificate) -> Certificate:
    """The certificate of a trajectory, to be stated: with the least distance of a proven motion."""
    if cell is None or certificate.clearance is None:
        return certificate
    t = trajectory
    curve = MotionCurve(t.time, t.position, t.velocity, t.acceleration)
    return replace(certificate, clearance=cell.measured(certificate.clearance, curve))


def clearance_along(cell: Cell, path: JointPath) -> Clearance:
    """The proof for a path; its `time` is the path's parameter. Cubic pieces are quintic ones between their knots."""
    s = path.knots
    return cell.prove(s, path(s), path(s, 1), path(s, 2))


def cell_beside(cell: Cell, path: JointPath) -> Cell:
    """The cell for a given path: see `Cell.beside`."""
    s = path.knots
    return cell.beside(s, path(s), path(s, 1), path(s, 2))
