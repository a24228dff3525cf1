"""Timing of a path: the squared path speed b(s) = (ds/dt)^2 as a quadratic B-spline.

Knots s_0 = 0 < ... < s_N = 1 (both ends threefold) and N + 2 control values c at the Greville points
g = (0, s_1 / 2, (s_1 + s_2) / 2, ..., 1). At a knot, b lies on the control polygon and the path acceleration
a = d^2 s/dt^2 = b'(s) / 2 is half the polygon's slope; a is linear in s between knots and continuous everywhere.

On one interval a = a_0 + w x with x = s - s_k, so s(t) solves x'' = a_0 + w x in closed form: from speed v_0 to v_1
over the length h takes 2 / sqrt(w) artanh(sqrt(w) h / (v_0 + v_1)) (w < 0: arctan), at ends at rest too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from energy_opt.motion.path import JointPath
from energy_opt.motion.trajectory import Trajectory, row_step, whole
from energy_opt.numerics.bspline import greville, quadratic_basis

CLOSE = 1e-3  # share of the sample step: samples nearer to each other are merged
HOLD = 1e-3  # [s] default duration of a move of no length


def _tau(w: np.ndarray, x: np.ndarray, v_sum: np.ndarray) -> np.ndarray:
    """Time to cover the length x, where a grows by w per length and v_sum is the sum of the speeds at both ends."""
    z = x / v_sum
    k = w * z * z
    root = np.sqrt(np.abs(k))
    with np.errstate(divide="ignore", invalid="ignore"):
        # artanh is infinite at 1, which a start from rest may reach by rounding
        exact = np.where(k > 0, np.arctanh(np.minimum(root, 1 - 1e-16)), np.arctan(root)) / root
    return 2 * z * np.where(root < 1e-4, 1 + k / 3, exact)


@dataclass(frozen=True)
class Timing:
    """A path and the squared speed along it.

    Attributes:
        path: the path.
        knots: (N + 1,) of the B-spline.
        control: (N + 2,) its control values [1/s^2], first and last the squared end speeds.
        hold: duration [s] if the path has no length.
    """

    path: JointPath
    knots: np.ndarray
    control: np.ndarray
    hold: float = HOLD

    @cached_property
    def _pieces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Per interval: v at both knots (2, N), a at its left knot (N,), w (N,)."""
        c, g = self.control, greville(self.knots)
        slope = np.diff(c) / np.diff(g)
        at_knots = np.concatenate([c[:1], c[1:-2] + slope[1:-1] * (self.knots[1:-1] - g[1:-2]), c[-1:]])
        v = np.sqrt(np.maximum(at_knots, 0.0))
        a = slope / 2
        return np.stack([v[:-1], v[1:]]), a[:-1], np.diff(a) / np.diff(self.knots)

    @cached_property
    def times(self) -> np.ndarray:
        """Time at each knot, (N + 1,) [s]."""
        v, _, w = self._pieces
        return np.concatenate([[0.0], np.cumsum(_tau(w, np.diff(self.knots), v[0] + v[1]))])

    @property
    def duration(self) -> float:
        """Time from start to goal, s."""
        return float(self.times[-1]) if self.path.moves else self.hold

    def speed(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """b = (ds/dt)^2, a = d^2 s/dt^2 and w = da/ds at s (M,)."""
        at = quadratic_basis(self.knots, s)
        c = self.control[at.first[:, None] + np.arange(3)]
        return (at.b * c).sum(1), (at.a * c).sum(1), (at.w * c).sum(1)

    def time_at(self, s: np.ndarray) -> np.ndarray:
        """Time at path positions s (M,), s."""
        k = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.knots) - 2)
        v, a, w = self._pieces
        x = s - self.knots[k]
        speed = np.sqrt(np.maximum(v[0, k] ** 2 + 2 * a[k] * x + w[k] * x * x, 0.0))
        total = v[0, k] + speed
        return self.times[k] + np.where(x > 0, _tau(w[k], x, np.where(total > 0, total, np.inf)), 0.0)

    def at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """s, ds/dt and d^2 s/dt^2 at times (M,) from 0 to the duration."""
        k = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.knots) - 2)
        v, a, w = self._pieces
        v0, a0, t, w = v[0, k], a[k], time - self.times[k], w[k]
        z = np.sqrt(np.abs(w)) * t
        small = z < 1e-3
        safe = np.where(small, 1.0, z)
        sign = np.sign(w)
        z2 = sign * z * z
        # sinh(z)/z and (cosh(z) - 1)/z^2, for w < 0 with sin and cos
        first = np.where(small, 1 + z2 / 6, np.where(w > 0, np.sinh(safe), np.sin(safe)) / safe)
        half = np.where(w > 0, np.sinh(safe / 2), np.sin(safe / 2)) / safe
        second = np.where(small, 0.5 + z2 / 24, 2 * half**2)
        x = v0 * t * first + a0 * t * t * second
        s = np.clip(self.knots[k] + x, self.knots[k], self.knots[k + 1])
        return s, v0 * (1 + z2 * second) + a0 * t * first, a0 + w * x

    def slowed(self, duration: float) -> Timing:
        """The same timing stretched evenly to `duration` (s); speeds at moving ends are reduced as well."""
        if not self.path.moves:
            return replace(self, hold=duration)
        return replace(self, control=self.control * (self.duration / duration) ** 2)

    def trajectory(self, joints: tuple[str, ...]) -> Trajectory:
        """Samples at most 4 ms apart (beyond 80 s, a 20,000th of the duration), at least 200, one at every knot.

        Position, velocity and acceleration of a sample are exactly those of path(s(t)); the third derivative jumps only
        at samples (within half a nanosecond), so that the quintic polynomials between them follow the curve closely.
        Samples lie on whole nanoseconds.
        """
        if not self.path.moves:
            q = np.repeat(self.path.start[None], 3, axis=0)
            return Trajectory(joints, whole(np.linspace(0, self.hold, 3)), q, np.zeros_like(q), np.zeros_like(q))
        timing = self.slowed(float(whole(self.duration)))  # changes it by at most half a nanosecond
        time = np.unique(whole(timing._row_times()))
        s, v, a = timing.at(time)
        s[-1] = 1.0
        v[[0, -1]] = np.sqrt(timing.control[[0, -1]])
        q1, q2 = self.path(s, 1), self.path(s, 2)
        v, a = v[:, None], a[:, None]
        return Trajectory(joints, time, self.path(s), q1 * v, q1 * a + q2 * v * v)

    def _row_times(self) -> np.ndarray:
        duration = self.duration
        step = row_step(duration)
        marks = np.unique(np.concatenate([self.times, self.time_at(self.path.knots[1:-1])]))
        keep = np.concatenate([[True], np.diff(marks) > CLOSE * step])
        marks = marks[keep & (marks < duration - CLOSE * step)]
        marks = np.append(marks, duration)
        counts = np.ceil(np.diff(marks) / step - 1e-9).astype(int)
        piece = np.repeat(np.arange(len(counts)), counts)
        share = (np.arange(len(piece)) - (np.cumsum(counts) - counts)[piece]) / counts[piece]
        return np.append(marks[piece] + share * np.diff(marks)[piece], duration)
