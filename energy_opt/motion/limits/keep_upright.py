"""`--keep upright[:DEG]`: the direction of the tool that points up at the start stays within DEG of up."""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.dynamics.tool import ToolState
from energy_opt.motion.limits.keep import Keep, angle_between


class KeepUpright(Keep):
    """A bound [rad] of the angle between up and what was up at the start; turns about up are free."""

    name, unit = "upright", "rad"
    word, usual, per = "upright", 5.0, np.pi / 180

    @staticmethod
    def reference(ends: np.ndarray) -> np.ndarray:
        return ends[0, 2, :3]  # up, in the tool's frame: the last row of its rotation

    @staticmethod
    def row(most: float) -> float:
        return float(1 - np.cos(most))

    def deviation(self, poses: np.ndarray) -> np.ndarray:
        return angle_between(poses[:, 2, :3] @ self.values)

    def smooth(self, tool: ToolState, p: ca.SX) -> ca.SX:
        return 1 - ca.dot(tool.rotation[2, :].T, p)
