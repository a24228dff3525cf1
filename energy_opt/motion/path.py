"""Paths in joint space: piecewise cubic C^2 curves q(s) for s in [0, 1] whose first derivative does not vanish.

A path contains no times. If it was read from a trajectory, it keeps that trajectory and its path speed at both ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from energy_opt.motion.standstills import STILL
from energy_opt.motion.trajectory import Trajectory

NO_LENGTH = 1e-12  # [rad] a shorter path counts as no move
HALVINGS = 30  # of the time between two samples, until a point of an even path is found
TRAJECTORY_PIECES = 200  # cubic pieces of the curve through a trajectory


@dataclass(frozen=True)
class JointPath:
    """q(s) on s in [0, 1].

    Attributes:
        knots: (K + 1,) from 0 to 1; the third derivative (of a straight path none) may jump there.
        coefficients: (4, K, n) [rad] of the powers 0 ... 3 of (s - knots[k]) on piece k.
        start_speed, end_speed: path speed ds/dt [1/s] with which the move begins and ends.
        source: the trajectory that the path was taken from, if any.
    """

    knots: np.ndarray
    coefficients: np.ndarray
    start_speed: float = 0.0
    end_speed: float = 0.0
    source: Trajectory | None = None

    def __call__(self, s: np.ndarray, order: int = 0) -> np.ndarray:
        """Derivative of order 0 ... 3 with respect to s, shape (M, n) for s (M,)."""
        s = np.atleast_1d(np.asarray(s, dtype=float))
        piece = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.knots) - 2)
        x = (s - self.knots[piece])[:, None]
        out = np.zeros((len(s), self.n))
        for power in range(self._degree, order - 1, -1):
            out = out * x + math.perm(power, order) * self.coefficients[power, piece]
        return out

    @cached_property
    def _degree(self) -> int:
        """The highest power with a coefficient that is not 0; 0 if there is none."""
        return int(np.flatnonzero(self.coefficients.any(axis=(1, 2))).max(initial=0))

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.coefficients.shape[2])

    @property
    def start(self) -> np.ndarray:
        """q(0), (n,) [rad]."""
        return self(np.zeros(1))[0]

    @property
    def goal(self) -> np.ndarray:
        """q(1), (n,) [rad]."""
        return self(np.ones(1))[0]

    @cached_property
    def moves(self) -> bool:
        """False if the path has no length: start and goal coincide and nothing lies between."""
        return bool(np.abs(self.coefficients[1:]).max() > NO_LENGTH)


def straight(start: Sequence[float] | np.ndarray, goal: Sequence[float] | np.ndarray) -> JointPath:
    """The straight line from `start` to `goal` (n,) [rad]; of no length if they coincide."""
    a, b = np.asarray(start, dtype=float), np.asarray(goal, dtype=float)
    flat = np.zeros_like(a)
    return JointPath(np.array([0.0, 1.0]), np.stack([a, b - a, flat, flat])[:, None, :])


def through(waypoints: np.ndarray) -> JointPath:
    """The natural cubic spline through `waypoints` (K, n) [rad], s in proportion to chord length.

    Waypoints that repeat the one before are skipped.
    """
    points = np.atleast_2d(np.asarray(waypoints, dtype=float))
    chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points = points[np.concatenate([[True], chord > NO_LENGTH])]
    if len(points) <= 2:
        return straight(points[0], points[-1])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return _spline(length / length[-1], points, "natural", "natural")


def inside(controls: np.ndarray, passed: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> JointPath:
    """The uniform cubic B-spline of `controls` (K, n) [rad], which stays in their convex hull, so within the bounds.

    It passes the controls of the indices `passed`, each at least 3 from both ends and from each other: at its knots it
    is (c[i - 1] + 4 c[i] + c[i + 1]) / 6, so the neighbours are moved to c[i] - d and c[i] + d. Bounds `lower` and
    `upper` are (n,) [rad].
    """
    from scipy.interpolate import BSpline

    c = np.array(controls, dtype=float)
    for i in passed:
        room = np.maximum(np.minimum(upper - c[i], c[i] - lower), 0.0)
        before, after = c[i] - c[i - 1], c[i + 1] - c[i]
        lengths = np.linalg.norm(before), np.linalg.norm(after)
        d = np.clip((before / lengths[0] + after / lengths[1]) / 2 * min(lengths), -room, room)
        c[i - 1], c[i + 1] = c[i] - d, c[i] + d
    knots = np.linspace(0.0, 1.0, len(c) - 2)
    spline = BSpline(np.concatenate([np.zeros(3), knots, np.ones(3)]), c, 3)
    return JointPath(knots, np.stack([spline(knots[:-1], m) / math.factorial(m) for m in range(4)]))


def of_trajectory(trajectory: Trajectory) -> JointPath:
    """The path of a trajectory, s in proportion to arc length, with its path speed at both ends.

    The path meets the trajectory's curve exactly at TRAJECTORY_PIECES + 1 points that are evenly spaced along it, and
    is a cubic spline between them; standstills inside the trajectory are dropped. If the trajectory begins (ends) in
    motion, the path has the same tangent there.
    """
    from scipy.interpolate import CubicHermiteSpline

    time = trajectory.denser(max(4, -(-4 * TRAJECTORY_PIECES // (len(trajectory.time) - 1))))
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(trajectory.sample(time)[0], axis=0), axis=1))])
    total = float(length[-1])
    if total <= NO_LENGTH:
        return replace(straight(trajectory.position[0], trajectory.position[0]), source=trajectory)
    advance = np.concatenate([[True], np.diff(length) > NO_LENGTH * total])
    s = np.linspace(0.0, 1.0, TRAJECTORY_PIECES + 1)
    along = CubicHermiteSpline(time, length, np.linalg.norm(trajectory.sample(time)[1], axis=1))
    behind = np.searchsorted(length[advance], s[1:-1] * total)
    low, high = time[advance][behind - 1], time[advance][behind]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        before = along(middle) < s[1:-1] * total
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    points = trajectory.sample(np.concatenate([time[:1], low, time[-1:]]))[0]
    speed = np.linalg.norm(trajectory.velocity[[0, -1]], axis=1)
    resting = np.abs(trajectory.velocity[[0, -1]]).max(axis=1) <= STILL * float(np.abs(trajectory.velocity).max())
    ends: list[str | tuple[int, np.ndarray]] = [
        "not-a-knot" if still else (1, v / norm * total)
        for v, norm, still in zip(trajectory.velocity[[0, -1]], speed, resting, strict=True)
    ]
    path = _spline(s, points, ends[0], ends[1])
    rates = np.where(resting, 0.0, speed / total)
    return replace(path, start_speed=float(rates[0]), end_speed=float(rates[1]), source=trajectory)


def _spline(
    s: np.ndarray, points: np.ndarray, first: str | tuple[int, np.ndarray], last: str | tuple[int, np.ndarray]
) -> JointPath:
    """The cubic spline through `points` (K, n) at `s` (K,) with the given end conditions."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(s, points, bc_type=(first, last))
    return JointPath(np.asarray(s), spline.c[::-1].copy())
