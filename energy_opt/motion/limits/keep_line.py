"""`--keep line[:MM]`: the tool's origin stays within MM of the segment between where it starts and where it ends."""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.dynamics.tool import ToolState
from energy_opt.motion.limits.keep import Keep

SHORT = 1e-9  # [m] a segment of this length is a point


class KeepLine(Keep):
    """A bound [m] of the distance from the segment."""

    name, unit = "line", "m"
    word, usual, per = "line", 1.0, 1e-3

    @staticmethod
    def reference(ends: np.ndarray) -> np.ndarray:
        return ends[:, :3, 3].ravel()

    @staticmethod
    def row(most: float) -> float:
        return most**2

    def deviation(self, poses: np.ndarray) -> np.ndarray:
        first, last = self.values.reshape(2, 3)
        along = last - first
        share = np.clip((poses[:, :3, 3] - first) @ along / max(along @ along, SHORT**2), 0, 1)
        return np.linalg.norm(poses[:, :3, 3] - first - share[:, None] * along, axis=1)

    def smooth(self, tool: ToolState, p: ca.SX) -> ca.SX:
        first, along = p[:3], p[3:] - p[:3]
        share = ca.dot(tool.position - first, along) / ca.fmax(ca.dot(along, along), SHORT**2)
        off = tool.position - first - ca.fmin(ca.fmax(share, 0), 1) * along
        return ca.dot(off, off)
