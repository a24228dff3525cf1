"""A motion from rest to rest, and ends of it on a UR arm, for tests of files."""

from __future__ import annotations

import numpy as np

from energy_opt.motion.trajectory import Trajectory

UR_START, UR_GOAL = np.array([0.0, -1.5, 1.2, -1.0, 0.3, 0.0]), np.array([0.8, -1.0, 0.7, -1.4, -0.2, 0.3])


def swing(joints: tuple[str, ...], start: np.ndarray, goal: np.ndarray, seconds: float, rows: int = 401) -> Trajectory:
    """The polynomial of degree seven from rest to rest, acceleration and jerk zero at both ends."""
    x = np.linspace(0, 1, rows)[:, None]
    shape = x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)
    slope = 140 * x**3 * (1 - x) ** 3
    bend = 420 * x**2 * (1 - x) ** 2 * (1 - 2 * x)
    d = goal - start
    return Trajectory(joints, x[:, 0] * seconds, start + shape * d, slope * d / seconds, bend * d / seconds**2)
