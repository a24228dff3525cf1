"""What a virtual arm is asked to do: a trajectory given by samples, read at every time step of the simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import read_table


@dataclass(frozen=True)
class Reference:
    """Samples of a motion; the arm stands before the first and after the last.

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


def read_reference(path: Path, joints: Sequence[str]) -> Reference:
    """A trajectory.csv: time, <joint>.position and, where given, <joint>.velocity.

    Raises:
        BadInput: a joint's position is missing, or time does not increase.
    """
    table = read_table(path)
    for column in ["time", *(f"{joint}.position" for joint in joints)]:
        if column not in table:
            raise BadInput(f"{path}: row 1: column {column!r} is missing")
    time = table["time"]
    if len(time) < 2:
        raise BadInput(f"{path}: row 2: a trajectory needs two rows or more")
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        raise BadInput(
            f"{path}: row {late[0] + 3}, column time: {time[late[0] + 1]:g} does not follow {time[late[0]]:g}"
        )
    position = np.column_stack([table[f"{joint}.position"] for joint in joints])
    names = [f"{joint}.velocity" for joint in joints]
    if all(name in table for name in names):
        velocity = np.column_stack([table[name] for name in names])
    else:
        velocity = np.gradient(position, time, axis=0)
        velocity[[0, -1]] = 0.0
    return Reference(path.stem, time, position, velocity)
