"""The curve through a trajectory's samples, and bounds of how far it moves within any interval of time.

Between two samples the curve is the quintic through their positions, velocities and accelerations. A polynomial lies
within the hull of its Bernstein coefficients. An interval of several samples is bounded by the least and greatest of
its pieces' coefficients. Only intervals shorter than one sample are cut by de Casteljau's algorithm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

ROUNDING = 1e-12  # [rad, m] margin of bounds for rounding errors

# With p(x) = sum_i b_i B_i(x): p(0) = b_0, p'(0) = 5 (b_1 - b_0), p''(0) = 20 (b_2 - 2 b_1 + b_0); the same at x = 1.
# Bernstein coefficients of a quintic on [0, 1] from (q0, h v0, h^2 a0, q1, h v1, h^2 a1).
_ENDS = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [1, 1 / 5, 0, 0, 0, 0],
        [1, 2 / 5, 1 / 20, 0, 0, 0],
        [0, 0, 0, 1, -2 / 5, 1 / 20],
        [0, 0, 0, 1, -1 / 5, 0],
        [0, 0, 0, 1, 0, 0],
    ]
)


@dataclass(frozen=True)
class Spans:
    """M intervals of a curve.

    Attributes:
        first, last: (M,) samples at which an interval begins and ends.
        low, high: (M,) if `last` is `first` + 1, the part [low, high] of this one piece, as shares; else 0 and 1.
    """

    first: np.ndarray
    last: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def __len__(self) -> int:
        return len(self.first)

    def take(self, which: np.ndarray) -> Spans:
        """The intervals of the indices or the mask `which` (M,)."""
        return Spans(self.first[which], self.last[which], self.low[which], self.high[which])

    def halves(self) -> Spans:
        """Each cut at its middle, (2 M): the first halves, then the second halves."""
        many = self.last - self.first > 1
        middle_row, middle = (self.first + self.last) // 2, (self.low + self.high) / 2
        return Spans(
            np.concatenate([self.first, np.where(many, middle_row, self.first)]),
            np.concatenate([np.where(many, middle_row, self.last), self.last]),
            np.concatenate([self.low, np.where(many, 0.0, middle)]),
            np.concatenate([np.where(many, 1.0, middle), self.high]),
        )


class MotionCurve:
    """The curve through the samples of a motion: time (N,) [s]; position, velocity, acceleration (N, n)."""

    def __init__(self, time: np.ndarray, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> None:
        h = np.diff(time)[:, None]
        ends = (
            position[:-1], h * velocity[:-1], h**2 * acceleration[:-1],
            position[1:], h * velocity[1:], h**2 * acceleration[1:],
        )  # fmt: skip
        self._hold(time, np.tensordot(_ENDS, np.stack(ends), axes=1))

    @classmethod
    def of_pieces(cls, time: np.ndarray, bernstein: np.ndarray) -> Self:
        """A curve of quintic pieces between the times (N,) [s], by their Bernstein coefficients (6, N - 1, n)."""
        out = cls.__new__(cls)
        out._hold(time, bernstein)
        return out

    def _hold(self, time: np.ndarray, bernstein: np.ndarray) -> None:
        """Keep times and coefficients (6, N - 1, n)."""
        self.time, self.samples = time, len(time)
        self.bernstein = bernstein
        self._position = np.vstack([bernstein[0], bernstein[-1, -1:]])
        # of each piece; one more, as the end of a range is the first piece that does not belong to it
        self._low, self._high = (np.vstack([x, x[-1:]]) for x in (bernstein.min(axis=0), bernstein.max(axis=0)))

    def whole(self, pieces: int) -> Spans:
        """The whole curve as about `pieces` intervals."""
        cuts = np.unique(np.linspace(0, self.samples - 1, min(pieces, self.samples - 1) + 1).astype(int))
        return Spans(cuts[:-1], cuts[1:], np.zeros(len(cuts) - 1), np.ones(len(cuts) - 1))

    def middles(self, spans: Spans) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The middles of intervals, and how far the curve moves from there.

        Returns:
            Time (M,) [s] and position (M, n) in the middle of each interval, and an upper bound (M, n) of |q(t) -
                middle| for all t of the interval.
        """
        many = spans.last - spans.first > 1
        row = np.where(many, (spans.first + spans.last) // 2, 0)
        q = self._position[row]
        time = self.time[row].copy()
        low, high = np.empty_like(q), np.empty_like(q)
        if many.any():
            pieces = np.column_stack([spans.first[many], spans.last[many]]).ravel()
            low[many] = np.minimum.reduceat(self._low, pieces)[::2]
            high[many] = np.maximum.reduceat(self._high, pieces)[::2]
        one = ~many
        if one.any():
            first, a, b = spans.first[one], spans.low[one], spans.high[one]
            b_points = _part(self.bernstein[:, first], a[:, None], b[:, None])
            low[one], high[one] = b_points.min(axis=0), b_points.max(axis=0)
            middle = (a + b) / 2
            q[one] = _part(self.bernstein[:, first], middle[:, None], b[:, None])[0]
            time[one] = self.time[first] + middle * (self.time[first + 1] - self.time[first])
        return time, q, np.maximum(high - q, q - low) + ROUNDING

    def seconds(self, spans: Spans) -> np.ndarray:
        """How long each interval is, (M,) [s]."""
        return (self.time[spans.last] - self.time[spans.first]) * (spans.high - spans.low)

    def sample(self, time: float) -> np.ndarray:
        """Position (n,) at a time [s]."""
        return self.positions(np.array([time]))[0]

    def positions(self, time: np.ndarray) -> np.ndarray:
        """Positions (M, n) at times (M,) [s]."""
        k = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, self.samples - 2)
        share = (time - self.time[k]) / (self.time[k + 1] - self.time[k])
        return _part(self.bernstein[:, k], share[:, None], np.ones((len(k), 1)))[0]

    def cut(self, piece: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Bernstein coefficients (6, M, n) of parts of pieces (M,): from share `begin` to share `end` of each."""
        return _part(self.bernstein[:, piece], begin[:, None], end[:, None])

    def at(self, row: int) -> np.ndarray:
        """Position (n,) of a sample."""
        return self._position[row]


def _part(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Bernstein coefficients (6, M, n) of the part [a, b] of quintics.

    De Casteljau at a gives the coefficients of [a, 1]. Then de Casteljau at (b - a) / (1 - a) of these gives those of
    [a, b].

    Args:
        points: (6, M, n) coefficients on [0, 1]. a, b: (M, 1) shares, 0 <= a < b <= 1.
    """
    right = list(points)  # coefficients of [a, 1]: the last ones of each stage of the scheme
    for k in range(5):
        for i in range(5 - k):
            right[i] = right[i] + a * (right[i + 1] - right[i])
    share = (b - a) / np.maximum(1 - a, 1e-300)
    left, out = right, [right[0]]
    for _ in range(5):
        left = [p + share * (q - p) for p, q in zip(left[:-1], left[1:], strict=True)]
        out.append(left[0])
    return np.stack(out)
