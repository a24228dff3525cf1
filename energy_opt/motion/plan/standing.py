"""Rest instead of creeping: under dry friction, a joint that does not have to move takes least energy at rest.

A curve of few parameters never leaves a joint exactly at rest, and the friction smoothed for the solver makes creeping
nearly free. So the joints of a move that end where they began, and hardly left it, are also judged at rest.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel

# [rad/s] a joint that is never faster is also tried at rest: five times the width of the smoothed friction
CREEPING = 0.05


def creeping(trajectory: Trajectory) -> np.ndarray:
    """(n,) True for joints that end where they began, move, and are never faster than `CREEPING`."""
    peak = np.abs(trajectory.velocity).max(axis=0)
    stays = np.abs(trajectory.position[-1] - trajectory.position[0]) < 1e-9
    return np.asarray(stays & (peak > 0) & (peak < CREEPING))


def at_rest(trajectory: Trajectory, model: PowerModel) -> Trajectory | None:
    """The trajectory with its creeping joints at rest; None if none creeps or the model has no friction."""
    which = creeping(trajectory)
    if not which.any() or not any(e.stage == "torque" and e.dissipates for e in model.effects):
        return None
    q, v, a = trajectory.position.copy(), trajectory.velocity.copy(), trajectory.acceleration.copy()
    q[:, which], v[:, which], a[:, which] = q[0, which], 0.0, 0.0
    return replace(trajectory, position=q, velocity=v, acceleration=a)
