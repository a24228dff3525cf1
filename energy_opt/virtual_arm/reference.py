"""What a virtual arm is asked to do: a trajectory given by samples, read at every time step of the simulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.motion.trajectory import Trajectory


@dataclass(frozen=True)
class Reference:
    """Samples of a motion; the arm is before the first and after the last.

    Attributes:
        name: what it is called in the set.
        time: (N,) s.
        position, velocity: (N, n) rad, rad/s.
    """

    name: str
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray

    @property
    def duration(self) -> float:
        """From the first to the last sample, s."""
        return float(self.time[-1] - self.time[0])

    @property
    def static(self) -> bool:
        """Whether nothing moves in it."""
        return bool(np.ptp(self.position, axis=0).max() < 1e-9)

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity (M, n) at times t (M,) from the first sample on: cubic Hermite, at rest outside."""
        x = self.time - self.time[0]
        k = np.clip(np.searchsorted(x, t, side="right") - 1, 0, len(x) - 2)
        h = (x[k + 1] - x[k])[:, None]
        s = np.clip((t - x[k])[:, None] / h, 0.0, 1.0)
        q0, q1, v0, v1 = self.position[k], self.position[k + 1], self.velocity[k], self.velocity[k + 1]
        rise, left, right = s * s * (3 - 2 * s), s * (1 - s) ** 2, s * s * (s - 1)
        position = q0 + rise * (q1 - q0) + h * (left * v0 + right * v1)
        velocity = 6 * s * (1 - s) * (q1 - q0) / h + (1 - s) * (1 - 3 * s) * v0 + s * (3 * s - 2) * v1
        outside = (t < 0) | (t > x[-1])
        return position, np.where(outside[:, None], 0.0, velocity)


def pose(name: str, position: np.ndarray, duration: float) -> Reference:
    """Standing at `position` (n,) for `duration` s."""
    two = np.tile(position, (2, 1))
    return Reference(name, np.array([0.0, duration]), two, np.zeros_like(two))


def reference_of(trajectory: Trajectory, name: str) -> Reference:
    """What the arm is asked to do by a trajectory."""
    return Reference(name, trajectory.time, trajectory.position, trajectory.velocity)
