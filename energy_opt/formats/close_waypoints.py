"""Paths past waypoints that are rounded and hardly farther apart, as a scanned path has them.

A spline through them is full of small corners, which no arm passes fast. A smooth curve passes them within their
rounding.
"""

from __future__ import annotations

import numpy as np

from energy_opt.motion.path import JointPath, through
from energy_opt.numerics.bspline import DEGREE, Basis

DIGITS = 3, 4  # decimal places to which waypoints may be rounded
CLOSE = 10.0  # times their rounding: waypoints nearer to each other are not passed exactly
NEAR = 0.75  # times their rounding: largest distance of the path from them
MOST = 200  # control points of the curve near rounded waypoints: timings have as many intervals
PROJECTIONS = 4  # fits of the curve near rounded waypoints
FEWEST = 20  # least waypoints
PIECES = 4  # pieces of the path for each control point of the curve


def past(q: np.ndarray, where: str) -> tuple[JointPath, tuple[str, ...]]:
    """The spline through waypoints (K, n), or one past close ones within their rounding; and notes.

    Args:
        where: they were read, for a note.
    """
    rounding = next((10.0**-d for d in DIGITS if np.abs(q - np.round(q, d)).max() < 1e-9), 0.0)
    apart = np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0)
    exact = through(q), ()
    if len(q) < FEWEST or float(np.median(apart)) >= CLOSE * rounding:
        return exact
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
    controls = DEGREE + 1
    while controls < min(len(q) / 3, MOST) and length[-1] > 0:
        basis, u = Basis(controls, packing=0.0), length / length[-1]
        for _ in range(PROJECTIONS):
            points = basis.fit(u, q, q[:1], q[-1:])
            off, along = q - basis.matrix(u) @ points, basis.matrix(u, 1) @ points
            # each waypoint to the nearest place of the curve: rounding makes the way between waypoints uneven
            step = np.sum(off * along, axis=1) / np.maximum(np.sum(along**2, axis=1), 1e-12)
            u[1:-1] = np.clip(u + step, 0.0, 1.0)[1:-1]
        if np.abs(off).max() <= NEAR * rounding:
            u = np.linspace(0.0, 1.0, PIECES * controls + 1)
            note = f"{where}: waypoints rounded to {rounding:g} are passed within {NEAR * rounding:g} rad or m"
            return through(basis.matrix(u) @ points), (note,)
        controls = int(1.3 * controls) + 1
    return exact
