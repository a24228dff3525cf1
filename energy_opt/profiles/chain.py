"""A chain of standard moves: joint-space lines from corner to corner, with ramps of velocity at both ends and between.

Corners P_0 ... P_{K+1} (n,), of which the inner ones are via points. On the line to P_i all joints run together at the
constant velocity

    w_i = (P_i - P_{i-1}) / L_i

where L_i is the time from the middle of one ramp to the middle of the next. Ramp i turns w_i into w_{i+1} (w_0 and
w_{K+2} are rest) within tau_i seconds: the acceleration rises for u_i seconds, holds, and falls for u_i seconds,

    peak acceleration  |w_{i+1} - w_i| / (tau_i - u_i)        jerk  peak / u_i

so that a move without via points is the seven-segment S-curve, and with u -> 0 the trapezoid. At a via point the ramp
is the blend: it leaves the line at P_i - w_i tau_i / 2, joins the next at P_i + w_{i+1} tau_i / 2, and stays inside the
triangle between; P_i itself is not touched. Everything is closed form and smooth in P, L, tau and u.

A chain of standard moves as CasADi expressions of its unknowns: any place of any piece, in closed form.

Pieces in order: rise, hold and fall of ramp 0, line 0, rise, hold and fall of ramp 1, line 1, ...
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from energy_opt.motion.trajectory import Trajectory, row_step, whole

LEAST = 1e-12  # [s] pieces that are shorter than this have no row of their own


@dataclass(frozen=True)
class Piece:
    """One polynomial piece: when it begins, how long it lasts [s], and position and its derivatives there, (n,)."""

    start: float
    length: float
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    jerk: np.ndarray


@dataclass(frozen=True)
class Chain:
    """Corners (K + 2, n) [rad], spans L (K + 1,), ramps tau (K + 2,) and their rises u (K + 2,), all in s."""

    corners: np.ndarray
    spans: np.ndarray
    ramps: np.ndarray
    rises: np.ndarray

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.spans.sum() + (self.ramps[0] + self.ramps[-1]) / 2)

    def lasting(self, duration: float) -> Chain:
        """The same corners with all times stretched evenly to `duration` (s)."""
        k = duration / self.duration
        return Chain(self.corners, self.spans * k, self.ramps * k, self.rises * k)

    @property
    def velocities(self) -> np.ndarray:
        """Velocity on each line, (K + 1, n) [rad/s]."""
        return np.diff(self.corners, axis=0) / self.spans[:, None]

    @property
    def changes(self) -> np.ndarray:
        """Change of velocity over each ramp, (K + 2, n) [rad/s]."""
        rest = np.zeros((1, self.corners.shape[1]))
        return np.diff(np.vstack([rest, self.velocities, rest]), axis=0)

    @property
    def accelerations(self) -> np.ndarray:
        """Peak acceleration in each ramp, with sign, (K + 2, n) [rad/s^2]."""
        return self.changes / (self.ramps - self.rises)[:, None]

    @property
    def ramp_starts(self) -> np.ndarray:
        """When each ramp begins, (K + 2,) [s]."""
        middles = self.ramps[0] / 2 + np.concatenate([[0.0], np.cumsum(self.spans)])
        return np.asarray(middles - self.ramps / 2)

    def pieces(self) -> Iterator[Piece]:
        """The polynomial pieces in order: rise, hold and fall of every ramp, and the lines between."""
        velocities, peaks, starts = self.velocities, self.accelerations, self.ramp_starts
        before = np.zeros(self.corners.shape[1])
        for i, (tau, u) in enumerate(zip(self.ramps, self.rises, strict=True)):
            q, v = self.corners[i] - before * tau / 2, before
            a, t, jerk = np.zeros_like(before), float(starts[i]), peaks[i] / u
            for length, slope in ((u, jerk), (tau - 2 * u, 0 * jerk), (u, -jerk)):
                yield Piece(t, float(length), q, v, a, slope)
                x = float(length)
                q, v, a = q + x * v + x * x / 2 * a + x**3 / 6 * slope, v + x * a + x * x / 2 * slope, a + x * slope
                t += x
            if i < len(self.spans):
                before = velocities[i]
                q = self.corners[i] + before * tau / 2
                yield Piece(t, float(starts[i + 1] - t), q, before, np.zeros_like(before), np.zeros_like(before))

    def places(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which piece each time (M,) lies in, and its share of the piece in [0, 1]."""
        pieces = list(self.pieces())
        starts, lengths = np.array([p.start for p in pieces]), np.array([p.length for p in pieces])
        k = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(pieces) - 1)
        return k, np.clip((time - starts[k]) / np.maximum(lengths[k], LEAST), 0.0, 1.0)

    def along(self, u: np.ndarray) -> np.ndarray:
        """Positions (M, n) at shares u (M,) in [0, 1] of the duration."""
        pieces = list(self.pieces())
        out = []
        for k, share in zip(*self.places(np.asarray(u) * self.duration), strict=True):
            p = pieces[int(k)]
            x = share * p.length
            out.append(p.q + x * (p.v + x * (p.a / 2 + x * (p.jerk / 6))))
        return np.array(out).reshape(len(out), self.corners.shape[1])

    def trajectory(self, joints: tuple[str, ...]) -> Trajectory:
        """The motion itself: a row where each piece begins and ends, and as near as `row_step` says.

        Pieces are of third degree at most, so the quintic between two samples is the profile, but for half a nanosecond
        beside the ends of pieces: samples lie on whole nanoseconds.
        """
        times, step = [np.zeros(1)], row_step(self.duration)
        for piece in self.pieces():
            if piece.length > LEAST:
                count = max(1, int(np.ceil(piece.length / step - 1e-9)))
                times.append(piece.start + np.arange(count + 1) / count * piece.length)
        time = np.unique(whole(np.concatenate(times)))
        pieces, shares = list(self.pieces()), self.places(time)
        at = [pieces[int(k)] for k in shares[0]]
        q0, v0, a0, jerk = (np.array([getattr(p, name) for p in at]) for name in ("q", "v", "a", "jerk"))
        x = (shares[1] * np.array([p.length for p in at]))[:, None]
        q = q0 + x * (v0 + x * (a0 / 2 + x * (jerk / 6)))
        v, a = v0 + x * (a0 + x * (jerk / 2)), a0 + x * jerk
        q[-1], v[-1], a[-1], a[0] = self.corners[-1], 0.0, 0.0, 0.0
        return Trajectory(joints, time, q, v, a)


RISE, HOLD, FALL, LINE = range(4)


class ChainSymbols:
    """Corners, spans L, ramps tau and rises u of a chain with `vias` free corners as functions of the unknowns x."""

    def __init__(self, ends: tuple[np.ndarray, np.ndarray], vias: int) -> None:
        n, k = len(ends[0]), vias
        x = self.x = ca.SX.sym("x", n * k + 3 * k + 5)
        self.corners = [ca.DM(ends[0]), *(x[i * n : (i + 1) * n] for i in range(k)), ca.DM(ends[1])]
        at = n * k
        self.spans, self.ramps, self.rises = x[at : at + k + 1], x[at + k + 1 : at + 2 * k + 3], x[at + 2 * k + 3 :]
        self.lines = [(self.corners[i + 1] - self.corners[i]) / self.spans[i] for i in range(k + 1)]
        rest = ca.DM.zeros(n)
        self.changes = [b - a for a, b in zip([rest, *self.lines], [*self.lines, rest], strict=True)]
        self.rests = [self.spans[i] - (self.ramps[i] + self.ramps[i + 1]) / 2 for i in range(k + 1)]  # between ramps
        middles = [self.ramps[0] / 2]
        for i in range(k + 1):
            middles.append(middles[-1] + self.spans[i])
        self.middles = middles
        self.duration = middles[-1] + self.ramps[-1] / 2

    @property
    def count(self) -> int:
        """Number of pieces."""
        return 4 * len(self.changes) - 1

    def length(self, piece: int) -> ca.SX:
        """How long a piece lasts, s."""
        i, kind = divmod(piece, 4)
        if kind == LINE:
            return self.rests[i]
        return self.ramps[i] - 2 * self.rises[i] if kind == HOLD else self.rises[i]

    def at(self, piece: int, share: float) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Position, velocity, acceleration (n, 1) and time [s] at a share in [0, 1] of a piece."""
        i, kind = divmod(piece, 4)
        tau, u, change = self.ramps[i], self.rises[i], self.changes[i]
        if kind == LINE:
            t, line = share * self.rests[i], self.lines[i]
            q = self.corners[i] + line * (tau / 2 + t)
            return q, line, ca.DM.zeros(change.numel()), self.middles[i] + tau / 2 + t
        before = self.lines[i - 1] if i else ca.DM.zeros(change.numel())
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
