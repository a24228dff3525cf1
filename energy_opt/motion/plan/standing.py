"""Standing still in place of creeping: under dry friction a joint that need not move costs least where it is.

A curve of few numbers never leaves a joint quite alone, and friction smoothed for the solver makes creeping nearly
free. So a move's joints that end where they began, and hardly left it, are judged at rest, too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel

CREEPING = 0.05  # [rad/s] a joint that is never faster may as well stand: five times the width of the smoothed friction


def creeping(trajectory: Trajectory) -> np.ndarray:
    """(n,) joints that end where they began, never stand still for good, and are never faster than `CREEPING`."""
    peak = np.abs(trajectory.velocity).max(axis=0)
    stays = np.abs(trajectory.position[-1] - trajectory.position[0]) < 1e-9
    return np.asarray(stays & (peak > 0) & (peak < CREEPING))


def at_rest(trajectory: Trajectory, model: PowerModel) -> Trajectory | None:
    """The trajectory with its creeping joints at rest; None where none creeps or no friction is in the model."""
    which = creeping(trajectory)
    if not which.any() or not any(e.stage == "torque" and e.dissipates for e in model.effects):
        return None
    q, v, a = trajectory.position.copy(), trajectory.velocity.copy(), trajectory.acceleration.copy()
    q[:, which], v[:, which], a[:, which] = q[0, which], 0.0, 0.0
    return replace(trajectory, position=q, velocity=v, acceleration=a)
