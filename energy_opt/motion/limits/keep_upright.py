"""The axis of a tool that points up at the start stays upright: its angle to what points up is at most a bound."""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.dynamics.compact import ToolState
from energy_opt.motion.limits.keep import Keep


class KeepUpright(Keep):
    """A bound [deg]; the reference is the axis in the tool's frame (3,), and up in the base frame (3,)."""

    name, unit, numbers = "upright", "deg", 6

    @classmethod
    def kept(cls, ends: np.ndarray, up: np.ndarray) -> np.ndarray:
        up = up / max(float(np.linalg.norm(up)), 1e-300)
        share = up @ ends[0, :3, :3]  # how much each axis points up
        axis = np.zeros(3)
        axis[np.argmax(np.abs(share))] = np.sign(share[np.argmax(np.abs(share))])
        return np.concatenate([axis, up])

    @staticmethod
    def width(bound: float) -> float:
        return float(2 * np.sin(np.radians(bound) / 2))

    @staticmethod
    def squared_size(place: ToolState, p: ca.SX) -> ca.SX:
        # |axis - up|^2 without its cancellation at zero
        return ca.sumsqr(ca.mtimes(place.rotation, p[:3]) - p[3:])

    def measure(self, poses: np.ndarray) -> np.ndarray:
        axis, up = poses[:, :3, :3] @ self.reference[:3], self.reference[3:]
        return np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, up), axis=1), axis @ up))

    def correction(self, poses: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        axis, up = poses[:, :3, :3] @ self.reference[:3], self.reference[3:]
        cross = np.cross(axis, up)
        sine = np.linalg.norm(cross, axis=1, keepdims=True)
        out, of = np.zeros((len(poses), 6)), np.zeros((len(poses), 6, 6))
        out[:, 3:] = cross / np.maximum(sine, 1e-12) * np.arctan2(sine, (axis @ up)[:, None])
        of[:, 3:, 3:] = np.eye(3) - axis[:, :, None] * axis[:, None, :]
        return out, of
