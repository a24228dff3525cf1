"""The nearest point of a path, and its derivatives with respect to the position.

s*(q) minimises |q - p(s)|. With e = q - p(s*) and h = |p'|^2 - e p'', differentiating (q - p) p' = 0 gives

    ds*/dq = p' / h        d2s*/dq2 = (p'' ds*^T + ds* p''^T - (3 p' p'' - e p''') ds* ds*^T) / h

Both are zero if s* is an end of the path. h is the curvature of the distance: positive at a minimum.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from energy_opt.motion.path import JointPath

PLACES = 400  # least number of places along a path among which the nearest is looked up, before Newton's method
PER_PIECE = 6  # least number of places on each piece
STEPS = 60  # most steps of Newton's method or halvings: enough for the last digit
SETTLED = 1e-14  # step of s at which Newton's method ends
FLAT = 1e-3  # share of |p'|^2: lower bound of h, which vanishes where the nearest point jumps


@dataclass(frozen=True)
class Foot:
    """Nearest points of positions (M, n): s (M,), and the path there.

    Attributes:
        off: e (M, n), from the path to the position.
        p1, p2, p3: derivatives of the path (M, n).
    """

    s: np.ndarray
    off: np.ndarray
    p1: np.ndarray
    p2: np.ndarray
    p3: np.ndarray

    @cached_property
    def h(self) -> np.ndarray:
        """h (M,), bounded from below."""
        square = _dot(self.p1, self.p1)
        return np.maximum(square - _dot(self.off, self.p2), np.maximum(FLAT * square, 1e-300))

    @cached_property
    def slope(self) -> np.ndarray:
        """ds*/dq (M, n)."""
        inner = (self.s > 0) & (self.s < 1)
        return np.asarray(np.where(inner, 1 / self.h, 0.0)[:, None] * self.p1)

    @cached_property
    def curvature(self) -> np.ndarray:
        """d2s*/dq2 (M, n, n)."""
        cross = _outer(self.p2, self.slope)
        bend = 3 * _dot(self.p1, self.p2) - _dot(self.off, self.p3)
        whole = cross + cross.transpose(0, 2, 1) - bend[:, None, None] * _outer(self.slope, self.slope)
        return np.asarray(whole / self.h[:, None, None])

    @cached_property
    def off_slope(self) -> np.ndarray:
        """de/dq (M, n, n), the derivatives of e_j in row j."""
        return np.eye(self.off.shape[1]) - _outer(self.p1, self.slope)

    def off_curvature(self, weight: np.ndarray) -> np.ndarray:
        """Sum of the second derivatives of e_j times weight (M, n), (M, n, n)."""
        first = _dot(weight, self.p2)[:, None, None] * _outer(self.slope, self.slope)
        return -first - _dot(weight, self.p1)[:, None, None] * self.curvature


class NearestOf:
    """Finds nearest points of one path."""

    def __init__(self, path: JointPath) -> None:
        from scipy.spatial import cKDTree

        parts = max(PER_PIECE, -(-PLACES // (len(path.knots) - 1)))
        inner = path.knots[:-1, None] + np.diff(path.knots)[:, None] * np.arange(parts) / parts
        self.path, self._s = path, np.append(inner.ravel(), 1.0)
        self._tree = cKDTree(path(self._s))

    def __call__(self, q: np.ndarray) -> Foot:
        """Nearest points of positions q (M, n)."""
        nearest = np.asarray(self._tree.query(q)[1])
        s = self._settled(q, nearest)
        return Foot(s, q - self.path(s), *(self.path(s, order) for order in (1, 2, 3)))

    def _settled(self, q: np.ndarray, nearest: np.ndarray) -> np.ndarray:
        """The nearest point, from the nearest of the places looked up (M,), between its two neighbours."""
        s = self._s[nearest]
        low, high = self._s[np.maximum(nearest - 1, 0)], self._s[np.minimum(nearest + 1, len(self._s) - 1)]
        begins, ends = (low == 0) & (self._slope(q, low)[0] >= 0), (high == 1) & (self._slope(q, high)[0] <= 0)
        s = np.where(begins, 0.0, np.where(ends, 1.0, s))
        open_ = np.flatnonzero(~(begins | ends))
        for _ in range(STEPS):
            if not len(open_):
                break
            at = s[open_]
            slope, bend = self._slope(q[open_], at)
            high[open_] = np.where(slope > 0, at, high[open_])
            low[open_] = np.where(slope < 0, at, low[open_])
            newton = at - slope / np.where(bend > 0, bend, np.inf)
            middle = (low[open_] + high[open_]) / 2
            inside = (bend > 0) & (newton >= low[open_]) & (newton <= high[open_])
            s[open_] = np.where(slope == 0, at, np.where(inside, newton, middle))
            open_ = open_[np.abs(s[open_] - at) > SETTLED]
        return s

    def _slope(self, q: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and second derivative of |q - p(s)|^2 / 2 with respect to s (M,)."""
        off, p1 = q - self.path(s), self.path(s, 1)
        return -_dot(off, p1), _dot(p1, p1) - _dot(off, self.path(s, 2))


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("mi,mi->m", a, b))


def _outer(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, :, None] * b[:, None, :]
