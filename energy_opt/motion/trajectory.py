"""A sampled trajectory: the rows of trajectory.csv, and the curve that these rows stand for.

Between two rows the curve is the quintic polynomial with the rows' positions, velocities and accelerations, so these
three are continuous and everything that is judged can be recomputed from the file alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import read_table, write_table

# Quintic on x in [0, 1] from (q0, q1, h v0, h v1, h^2 a0, h^2 a1); rows: coefficients of x^0 ... x^5.
_HERMITE = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [0, 0, 1, 0, 0, 0],
        [0, 0, 0, 0, 0.5, 0],
        [-10, 10, -6, -4, -1.5, 0.5],
        [15, -15, 8, 7, 1.5, -1],
        [-6, 6, -3, -3, -0.5, 0.5],
    ]
)


@dataclass(frozen=True)
class Trajectory:
    """Samples of a motion: time (N,) [s]; position, velocity, acceleration (N, n) [rad, rad/s, rad/s^2].

    effort (N, n) [N m] (the motors' torque) and power (N,) [W] are there once a model has been applied.
    """

    joints: tuple[str, ...]
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    effort: np.ndarray | None = None
    power: np.ndarray | None = None

    @property
    def duration(self) -> float:
        """From the first to the last row, s."""
        return float(self.time[-1] - self.time[0])

    def sample(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity, acceleration and jerk (M, n) of the curve at `time` (M,)."""
        k = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        h = (self.time[k + 1] - self.time[k])[:, None]
        x = (time - self.time[k])[:, None] / h
        data = np.stack(
            [
                self.position[k],
                self.position[k + 1],
                h * self.velocity[k],
                h * self.velocity[k + 1],
                h**2 * self.acceleration[k],
                h**2 * self.acceleration[k + 1],
            ]
        )
        # Relative to the first position, so that the differences of nearly equal positions keep their digits.
        data[1] -= data[0]
        start = data[0].copy()
        data[0] = 0.0
        c = np.tensordot(_HERMITE, data, axes=1)
        out = []
        for order in range(4):
            value = np.zeros_like(x * c[0])
            for degree in range(5, order - 1, -1):
                factor = float(np.prod(np.arange(degree - order + 1, degree + 1)))
                value = value * x + factor * c[degree]
            out.append(value / h**order)
        out[0] = out[0] + start
        return out[0], out[1], out[2], out[3]

    def denser(self, factor: int) -> np.ndarray:
        """Times of a grid `factor` times denser than the rows, rows included; shape ((N - 1) * factor + 1,)."""
        steps = np.arange(factor) / factor
        inner = (self.time[:-1, None] + np.diff(self.time)[:, None] * steps).ravel()
        return np.append(inner, self.time[-1])

    def slowed(self, duration: float) -> Trajectory:
        """The same path with time stretched evenly to `duration` (s)."""
        k = duration / self.duration
        time = self.time[0] + (self.time - self.time[0]) * k
        return Trajectory(self.joints, time, self.position, self.velocity / k, self.acceleration / k**2)

    def write_csv(self, path: Path) -> None:
        """Write time, <joint>.position, .velocity, .acceleration, and .effort and power where known."""
        header, columns = ["time"], [self.time]
        blocks = [("position", self.position), ("velocity", self.velocity), ("acceleration", self.acceleration)]
        if self.effort is not None:
            blocks.append(("effort", self.effort))
        for kind, block in blocks:
            header += [f"{joint}.{kind}" for joint in self.joints]
            columns += list(block.T)
        if self.power is not None:
            header.append("power")
            columns.append(self.power)
        write_table(path, header, columns)

    def write_yaml(self, path: Path, effort: np.ndarray | None = None) -> None:
        """Write the rows as a trajectory_msgs/JointTrajectory message."""
        from energy_opt.files import write_text

        def row(values: np.ndarray) -> str:
            return "[" + ", ".join(repr(float(x)) for x in values) + "]"

        lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", "  frame_id: ''", "joint_names:"]
        lines += [f"- {joint}" for joint in self.joints]
        lines.append("points:")
        for k, t in enumerate(self.time - self.time[0]):
            total = round(float(t) * 1e9)
            lines.append(f"- positions: {row(self.position[k])}")
            lines.append(f"  velocities: {row(self.velocity[k])}")
            lines.append(f"  accelerations: {row(self.acceleration[k])}")
            lines.append(f"  effort: {row(effort[k]) if effort is not None else '[]'}")
            lines.append(f"  time_from_start: {{sec: {total // 10**9}, nanosec: {total % 10**9}}}")
        write_text(path, "\n".join(lines) + "\n")


def columns_of(table: dict[str, np.ndarray], joints: Sequence[str], kind: str, where: str) -> np.ndarray | None:
    """The columns <joint>.<kind> in the order of `joints`, (N, n); None where no joint has one.

    Raises:
        BadInput: some joints have the column and others do not.
    """
    present = [joint for joint in joints if f"{joint}.{kind}" in table]
    if not present:
        return None
    missing = [joint for joint in joints if joint not in present]
    if missing:
        raise BadInput(f"{where}: row 1: column {missing[0]}.{kind} is missing, though {present[0]}.{kind} is there")
    return np.column_stack([table[f"{joint}.{kind}"] for joint in joints])


def read_trajectory(path: Path, joints: Sequence[str]) -> Trajectory:
    """Read a trajectory file; velocity and acceleration are taken from it, or from splines where they are missing.

    Raises:
        BadInput: a column is missing, or time does not rise from row to row.
    """
    from scipy.interpolate import CubicSpline

    table = read_table(path)
    if "time" not in table:
        raise BadInput(f"{path}: row 1: no column time")
    time = table["time"]
    falls = np.flatnonzero(np.diff(time) <= 0)
    if falls.size:
        k = int(falls[0])
        raise BadInput(f"{path}: row {k + 3}, column time: {time[k + 1]:g} does not come after {time[k]:g}")
    if len(time) < 2:
        raise BadInput(f"{path}: one row; a trajectory has at least two")
    position = columns_of(table, joints, "position", str(path))
    if position is None:
        raise BadInput(f"{path}: row 1: no column {joints[0]}.position; joints are {', '.join(joints)}")
    velocity = columns_of(table, joints, "velocity", str(path))
    acceleration = columns_of(table, joints, "acceleration", str(path))
    if velocity is None:
        velocity = CubicSpline(time, position)(time, 1)
    if acceleration is None:
        acceleration = CubicSpline(time, velocity)(time, 1)
    return Trajectory(tuple(joints), time, position, velocity, acceleration)
