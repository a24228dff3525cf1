"""A chain of standard moves: straight lines in joint space from corner to corner, with ramps of velocity between them.

The corners are P_0 ... P_{K+1} (n,); the inner ones are via points. On the line to P_i all joints move together at the
constant velocity

    w_i = (P_i - P_{i-1}) / L_i

L_i is the time from the middle of one ramp to the middle of the next. Ramp i changes w_i into w_{i+1} (w_0 and w_{K+2}
are rest) within tau_i seconds. The acceleration rises for u_i seconds, holds, and falls for u_i seconds:

    peak acceleration  |w_{i+1} - w_i| / (tau_i - u_i)        jerk  peak / u_i

So a move without via points is the seven-segment S-curve; for u -> 0 it is the trapezoid. At a via point the ramp is
the blend. It leaves the line at P_i - w_i tau_i / 2, joins the next line at P_i + w_{i+1} tau_i / 2, and stays inside
the triangle between; it does not touch P_i. All of this is closed form and smooth in P, L, tau and u.

The pieces are, in order: rise, hold and fall of ramp 0, line 0, rise, hold and fall of ramp 1, line 1, and so on. The
same formulas serve numbers and the CasADi expressions of a program.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from energy_opt.motion.trajectory import Trajectory, row_step, whole

LEAST = 1e-12  # [s] shorter pieces get no sample of their own
RISE, HOLD, FALL, LINE = range(4)


@dataclass(frozen=True)
class Chain:
    """Corners and times of a chain.

    Attributes:
        corners: P (K + 2, n) [rad, m]. spans: L (K + 1,) [s]. ramps: tau (K + 2,) [s]. rises: u (K + 2,) [s]. As
            expressions, corners are a list of columns (n, 1), and the others are columns.
    """

    corners: Any
    spans: Any
    ramps: Any
    rises: Any

    @classmethod
    def of(cls, x: ca.SX, ends: tuple[np.ndarray, np.ndarray], vias: int) -> Chain:
        """Expressions of the unknowns x (see `profile_program`), between ends (n,), with `vias` free corners."""
        n, k = len(ends[0]), vias
        corners = [ca.DM(ends[0]), *(x[i * n : (i + 1) * n] for i in range(k)), ca.DM(ends[1])]
        at = n * k
        return cls(corners, x[at : at + k + 1], x[at + k + 1 : at + 2 * k + 3], x[at + 2 * k + 3 :])

    def lasting(self, duration: float) -> Chain:
        """The same corners with all times stretched evenly to `duration` (s)."""
        k = duration / self.duration
        return Chain(self.corners, self.spans * k, self.ramps * k, self.rises * k)

    @cached_property
    def lines(self) -> list[Any]:
        """Velocity on each line, K + 1 times (n,) [rad/s]."""
        return [(self.corners[i + 1] - self.corners[i]) / self.spans[i] for i in range(len(self.corners) - 1)]

    @cached_property
    def changes(self) -> list[Any]:
        """Change of velocity over each ramp, K + 2 times (n,) [rad/s]."""
        rest = 0 * self.corners[0]
        return [after - before for before, after in zip([rest, *self.lines], [*self.lines, rest], strict=True)]

    @cached_property
    def rests(self) -> list[Any]:
        """Duration [s] of each line between its ramps, K + 1 values."""
        return [self.spans[i] - (self.ramps[i] + self.ramps[i + 1]) / 2 for i in range(len(self.lines))]

    @cached_property
    def middles(self) -> list[Any]:
        """Time [s] of the middle of each ramp, K + 2 values."""
        out = [self.ramps[0] / 2]
        for i in range(len(self.lines)):
            out.append(out[-1] + self.spans[i])
        return out

    @property
    def duration(self) -> Any:
        """Duration [s]."""
        end = self.middles[-1] + self.ramps[-1] / 2
        return float(end) if isinstance(end, float) else end

    @property
    def velocities(self) -> np.ndarray:
        """`lines` as numbers, (K + 1, n) [rad/s]."""
        return np.array(self.lines)

    @property
    def accelerations(self) -> np.ndarray:
        """Peak acceleration in each ramp, with sign, (K + 2, n) [rad/s^2]."""
        return np.asarray(np.array(self.changes) / (self.ramps - self.rises)[:, None])

    @property
    def ramp_starts(self) -> np.ndarray:
        """Start time of each ramp, (K + 2,) [s]."""
        return np.asarray(self.middles - self.ramps / 2)

    @property
    def count(self) -> int:
        """Number of pieces."""
        return 4 * len(self.changes) - 1

    def length(self, piece: int) -> Any:
        """Duration of a piece, s."""
        i, kind = divmod(piece, 4)
        if kind == LINE:
            return self.rests[i]
        return self.ramps[i] - 2 * self.rises[i] if kind == HOLD else self.rises[i]

    def at(self, piece: int, share: Any) -> tuple[Any, Any, Any, Any]:
        """Position, velocity, acceleration (n,) and time [s] at a share of a piece.

        In a ramp that changes the velocity by c, with peak = 1 / (tau - u) and t from the ramp's start, acceleration a
        c, velocity w + v c and displacement w t + r c follow from integration:

            rise (t <= u):         a = peak t / u,    v = peak t^2 / (2 u),       r = peak t^3 / (6 u)
            hold (y = t - u):      a = peak,          v = peak (u / 2 + y),       r = peak (u^2 / 6 + u y / 2 + y^2 / 2)
            fall (y = tau - t):    a = peak y / u,    v = 1 - peak y^2 / (2 u),   r = tau / 2 - y + peak y^3 / (6 u)

        Args:
            piece: its number. share: in [0, 1]; of numbers, shares (M, 1) give (M, n), or (n,) for values that do not
                depend on the share.
        """
        i, kind = divmod(piece, 4)
        tau, u, change = self.ramps[i], self.rises[i], self.changes[i]
        if kind == LINE:
            t, line = share * self.rests[i], self.lines[i]
            return self.corners[i] + line * (tau / 2 + t), line, 0 * line, self.middles[i] + tau / 2 + t
        before = self.lines[i - 1] if i else 0 * self.corners[0]
        peak = 1 / (tau - u)
        if kind == RISE:
            t = share * u
            a, v, r = peak * share, peak * t * t / (2 * u), peak * t**3 / (6 * u)
        elif kind == HOLD:
            y = share * (tau - 2 * u)
            t = u + y
            a, v, r = peak, peak * (u / 2 + y), peak * (u * u / 6 + u * y / 2 + y * y / 2)
        else:
            y = (1 - share) * u
            t = tau - y
            a, v, r = peak * (1 - share), 1 - peak * y * y / (2 * u), tau / 2 - y + peak * y**3 / (6 * u)
        q = self.corners[i] - before * tau / 2 + before * t + change * r
        return q, before + change * v, change * a, self.middles[i] - tau / 2 + t

    def places(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The piece of each time (M,), and its share of the piece in [0, 1]."""
        starts, lengths = self._spread
        k = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, self.count - 1)
        return k, np.clip((time - starts[k]) / np.maximum(lengths[k], LEAST), 0.0, 1.0)

    @cached_property
    def _spread(self) -> tuple[np.ndarray, np.ndarray]:
        """Start time and duration of each piece [s]."""
        pieces = range(self.count)
        return np.array([self.at(k, 0.0)[3] for k in pieces]), np.array([self.length(k) for k in pieces])

    def states(self, time: np.ndarray) -> np.ndarray:
        """Position, velocity and acceleration, (3, M, n), at times (M,) [s]."""
        piece, share = self.places(time)
        out = np.empty((3, len(time), self.corners.shape[1]))
        for k in np.unique(piece).tolist():
            here = piece == k
            for part, values in zip(out, self.at(k, share[here, None]), strict=False):
                part[here] = values
        return out

    def along(self, u: np.ndarray) -> np.ndarray:
        """Positions (M, n) at shares u (M,) in [0, 1] of the duration."""
        return np.asarray(self.states(np.asarray(u) * self.duration)[0])

    def trajectory(self, joints: tuple[str, ...]) -> Trajectory:
        """The motion itself: samples at the spacing of `row_step`, and where each piece begins and ends.

        Pieces are of at most third degree, so the quintic between two samples is the exact profile, except within half
        a nanosecond of the ends of pieces: samples lie on whole nanoseconds.
        """
        times, step = [np.zeros(1)], row_step(self.duration)
        for start, length in zip(*self._spread, strict=True):
            if length > LEAST:
                count = max(1, int(np.ceil(length / step - 1e-9)))
                times.append(start + np.arange(count + 1) / count * length)
        time = np.unique(whole(np.concatenate(times)))
        q, v, a = self.states(time)
        q[-1], v[-1], a[-1], a[0] = self.corners[-1], 0.0, 0.0, 0.0
        return Trajectory(joints, time, q, v, a)
