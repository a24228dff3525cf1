"""`--keep orientation[:DEG]`: the tool stays turned by no more than DEG from how it stands at the start."""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.dynamics.tool import ToolState
from energy_opt.motion.limits.keep import Keep, angle_between


class KeepOrientation(Keep):
    """A bound [rad] of the angle of the rotation from the start's; its cosine is (trace - 1) / 2."""

    name, unit = "orientation", "rad"
    word, usual, per = "orientation", 2.0, np.pi / 180

    @staticmethod
    def reference(ends: np.ndarray) -> np.ndarray:
        return ends[0, :3, :3].ravel()

    @staticmethod
    def row(most: float) -> float:
        return float(1 - np.cos(most))

    def deviation(self, poses: np.ndarray) -> np.ndarray:
        return angle_between((poses[:, :3, :3].reshape(-1, 9) @ self.values - 1) / 2)

    def smooth(self, tool: ToolState, p: ca.SX) -> ca.SX:
        return (3 - ca.dot(ca.vec(tool.rotation.T), p)) / 2
