"""Joints that carry no tool stay where they are: fingers that hold a part, a second arm that has no task.

Their motion would cost little energy, and may even save some by its inertia, but the part would fall.
"""

from __future__ import annotations

from typing import Self

import numpy as np

from energy_opt.motion.limits.joint import Position
from energy_opt.motion.move import Move, Settings
from energy_opt.robot import Robot
from energy_opt.robot.kinematics import idle

STAY = 1e-4  # [rad, m] a joint whose ends are nearer to each other, and that never leaves them by more, stays
SEARCHED = 0.1  # share of `STAY` that a search may use


class Held(Position):
    """Bounds around the positions of joints that stay; infinite for the others."""

    name = "held position"

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None, gravity: np.ndarray) -> Self | None:
        """The limit of a reshaped move whose ends, via points and given path leave such a joint where it is."""
        if move is None or move.mode == "retime":
            return None
        given = [] if move.path is None else list(move.path(move.path.knots))
        poses = np.stack([move.start, move.goal, *move.via, *given])
        if poses.shape[1] != robot.n:
            return None  # the check of the move reports it
        low, high = poses.min(axis=0), poses.max(axis=0)
        staying = idle(robot.body.tree(), robot.body.coupling, high - low > STAY)
        if not staying.any():
            return None
        return cls(np.where(staying, low - STAY, -np.inf), np.where(staying, high + STAY, np.inf))

    def box(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Narrower bounds, so that a search leaves room to those of the judge."""
        room = (1 - SEARCHED) * STAY
        return self.lower + room, self.upper - room
