"""A tool keeps the orientation that it has at the start: the angle of the rotation from there is at most a bound."""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.dynamics.compact import ToolState
from energy_opt.motion.limits.keep import Keep


class KeepOrientation(Keep):
    """A bound [deg]; the reference is the rotation at the start, (9,) column by column."""

    name, unit, numbers = "orientation", "deg", 9

    @classmethod
    def kept(cls, ends: np.ndarray, up: np.ndarray) -> np.ndarray:
        return ends[0, :3, :3].T.ravel()

    @staticmethod
    def width(bound: float) -> float:
        return float(2 * np.sin(np.radians(bound) / 2))

    @staticmethod
    def squared_size(place: ToolState, p: ca.SX) -> ca.SX:
        # |R - R0|^2 = 8 sin^2(angle / 2) over all entries; half of it is the chord's square
        return ca.sumsqr(ca.vec(place.rotation) - p) / 2

    def measure(self, poses: np.ndarray) -> np.ndarray:
        return np.degrees(np.linalg.norm(_turn(self._still @ poses[:, :3, :3].transpose(0, 2, 1)), axis=1))

    @property
    def _still(self) -> np.ndarray:
        return self.reference.reshape(3, 3).T

    def correction(self, poses: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        out, of = np.zeros((len(poses), 6)), np.zeros((len(poses), 6, 6))
        out[:, 3:] = _turn(self._still @ poses[:, :3, :3].transpose(0, 2, 1))
        of[:, 3:, 3:] = np.eye(3)
        return out, of


def _turn(rotation: np.ndarray) -> np.ndarray:
    """Rotation vectors (M, 3) [rad] of rotations (M, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotation).as_rotvec())
