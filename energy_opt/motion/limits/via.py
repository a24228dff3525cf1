"""Via points: positions that a move passes in order, at times it chooses.

Reshaping makes them equality constraints with the times as unknowns (`reshape.model`). Here the judge looks for the
instant at which a sampled motion is nearest to each.
"""

from __future__ import annotations

from typing import Self

import numpy as np

from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Limit, Violation
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.trajectory import Trajectory
from energy_opt.robot import Robot

PASSED = 1e-4  # [rad] largest joint error at a passed point: less than an arm's repeatability
NEWTON = 8  # most Newton steps from the nearest sample to the nearest instant


def distinct(move: Move) -> list[np.ndarray]:
    """The via points (n,) [rad, m] of a move without those that it passes with the point before, or with its goal."""
    out, close = [move.start], PASSED / 2
    for point in move.via:
        if np.abs(point - out[-1]).max() > close:
            out.append(point)
    while len(out) > 1 and np.abs(move.goal - out[-1]).max() <= close:
        out.pop()
    return out[1:]


class ViaPoints(Limit):
    """Points (vias, n) [rad]."""

    name, unit = "via", "rad"

    def __init__(self, via: np.ndarray) -> None:
        self.via = np.asarray(via, dtype=float)

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None, gravity: np.ndarray) -> Self | None:
        """The limit of a move's via points; None if it has none."""
        return cls(np.stack(move.via)) if move is not None and move.via else None

    def worst(self, x: Dense) -> Violation:
        """The via point that is missed most, each searched after the previous one was passed."""
        begin, found = 0.0, []
        for point in self.via:
            time, miss = _nearest(x, point, begin)
            found.append((float(miss.max()), time, int(np.argmax(miss))))
            begin = time
        value, time, j = max(found)
        return Violation(self.name, value / PASSED - 1, x.joints[j], time, value, PASSED)


def _nearest(x: Dense, point: np.ndarray, begin: float) -> tuple[float, np.ndarray]:
    """When, from `begin` [s] on, a point is first passed, or else nearest; and |q - point| (n,) then."""
    start = int(np.searchsorted(x.time, begin - 1e-12))
    distance = np.linalg.norm(x.q[start:] - point, axis=1)
    padded = np.concatenate([[np.inf], distance, [np.inf]])
    low = np.flatnonzero((padded[1:-1] <= padded[:-2]) & (padded[1:-1] <= padded[2:]))
    step = np.gradient(x.time)[start:]
    speed = np.linalg.norm(x.v[start:], axis=1)
    # between two samples a curve comes nearer by at most the distance it covers
    low = low[distance[low] <= 2 * step[low] * speed[low] + distance.min() + 2 * PASSED]
    best: tuple[float, np.ndarray] | None = None
    for k in low:
        time = _settled(x.trajectory, point, float(x.time[start + k]), max(begin, 0.0))
        miss = np.abs(x.trajectory.sample(np.array([time + x.trajectory.time[0]]))[0][0] - point)
        if miss.max() <= PASSED:
            return time, miss
        if best is None or miss.max() < best[1].max():
            best = time, miss
    assert best is not None
    return best


def _settled(trajectory: Trajectory, point: np.ndarray, time: float, begin: float) -> float:
    """The instant near `time` at which the curve is nearest to a point: Newton on (q - point) . v = 0."""
    for _ in range(NEWTON):
        q, v, a, _ = (x[0] for x in trajectory.sample(np.array([time + trajectory.time[0]])))
        slope, curvature = float((q - point) @ v), float(v @ v + (q - point) @ a)
        if curvature <= 0:
            break
        time = float(np.clip(time - slope / curvature, begin, trajectory.duration))
    return time
