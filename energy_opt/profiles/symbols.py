"""A chain of standard moves as CasADi expressions of its unknowns: any place of any piece, in closed form.

Pieces in order: rise, hold and fall of ramp 0, line 0, rise, hold and fall of ramp 1, line 1, ...
"""

from __future__ import annotations

import casadi as ca
import numpy as np

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
