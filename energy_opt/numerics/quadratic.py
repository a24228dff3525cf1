"""Quadratic programs with a banded Hessian, by a primal-dual interior-point method with LAPACK's banded Cholesky.

    min  d'Hd / 2 + g'd + price * sum(e)     so that  low <= d <= high,  floor - e <= A d <= ceiling + e,  e >= 0

H is a band with a border of a few full rows and columns. Rows of A are elastic: the program always has a solution, and
rows that are out of reach are broken by as little as pays. With t the distance of a row from its bound and l its
multiplier, e is eliminated like t, so that a step needs one factorization of

    H + A' D A,    D = 1 / (t / l + e / (price - l)),

which is banded where each row of A touches one window of neighbours. Predictor and corrector follow S. Mehrotra (On the
implementation of a primal-dual interior point method, SIAM Journal on Optimization 2, 1992).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.linalg.blas import dsbmv
from scipy.linalg.lapack import dpbtrf, dpbtrs

BARRIER = 1e-3  # the first barrier parameter, where the cost is of order one
BEGIN_BOX, BEGIN_ROW = 1e-3, 1e-2  # least first distances from bounds
CLOSE = 0.995  # of the way to the nearest bound is gone
STEPS = 40
PRIMAL, DUAL = 1e-5, 1e-4  # residuals at which it ends
LEAST_DAMPING = 0.0005


@dataclass
class Banded:
    """A symmetric matrix: `band` (N, w), with entry (c + o, c) at [c, o]; `border` (N, k) and `corner` (k, k)."""

    band: np.ndarray
    border: np.ndarray
    corner: np.ndarray

    def times(self, d: np.ndarray) -> np.ndarray:
        """The product with d (N + k,)."""
        n, width = self.band.shape
        out = np.empty(len(d))
        out[:n] = dsbmv(width - 1, 1.0, self.band.T, d[:n], lower=1)
        if len(d) > n:
            out[:n] += self.border @ d[n:]
            out[n:] = self.border.T @ d[:n] + self.corner @ d[n:]
        return out

    def plus(self, other: Banded, share: float) -> Banded:
        """The sum with a share of another matrix."""
        return Banded(
            self.band + share * other.band, self.border + share * other.border, self.corner + share * other.corner
        )


class Factor:
    """The Cholesky factors of a banded matrix, which are written over it.

    Raises:
        np.linalg.LinAlgError: it is not positive definite.
    """

    def __init__(self, matrix: Banded) -> None:
        self._band, failed = dpbtrf(matrix.band.T, lower=1, overwrite_ab=1)
        if failed:
            raise np.linalg.LinAlgError("not positive definite")
        self._border = matrix.border
        if self._border.shape[1]:
            self._through = dpbtrs(self._band, self._border, lower=1)[0]
            self._rest = matrix.corner - self._border.T @ self._through
            np.linalg.cholesky(self._rest)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The solution of the linear system."""
        n = self._band.shape[1]
        inner = dpbtrs(self._band, right[:n], lower=1)[0]
        if len(right) == n:
            return np.asarray(inner)
        outer = np.linalg.solve(self._rest, right[n:] - self._border.T @ inner)
        return np.concatenate([inner - self._through @ outer, outer])


class Rows(Protocol):
    """The matrix A (R, N + k)."""

    @property
    def count(self) -> int: ...

    def times(self, d: np.ndarray) -> np.ndarray:
        """A d (R,)."""

    def back(self, y: np.ndarray) -> np.ndarray:
        """A' y (N + k,)."""

    def add_square(self, weights: np.ndarray, to: Banded) -> None:
        """Add A' diag(weights) A to a matrix."""


@dataclass(frozen=True)
class Minimum:
    """The step d, multipliers (R,) of rows (positive at the ceiling), sum of e, damping used, steps taken."""

    d: np.ndarray
    multipliers: np.ndarray
    broken: float
    damping: float
    steps: int


def minimise(
    h: Banded, g: np.ndarray, box: tuple[np.ndarray, np.ndarray], rows: Rows,
    bounds: tuple[np.ndarray, np.ndarray], price: float, mass: Banded, damping: float = 0.0, tolerance: float = 1e-6,
) -> Minimum:  # fmt: skip
    """Solve the program; where H is not convex enough, as much `mass` as is needed is added to it.

    Args:
        box: low, high with low <= 0 <= high.
        bounds: floor, ceiling (R,), infinite where there is none.
        mass: positive definite.
        damping: the share of mass to begin with.
        tolerance: the last barrier parameter.
    """
    size = len(g)
    low = np.flatnonzero(np.isfinite(bounds[0]))
    high = np.flatnonzero(np.isfinite(bounds[1]))
    begin = 2 * size
    b = np.concatenate([box[0], -box[1], bounds[0][low], -bounds[1][high]])
    soft = slice(begin, None)
    t = np.maximum(-b, BEGIN_BOX)
    t[soft] = np.maximum(-b[soft], BEGIN_ROW)
    lam = BARRIER / t
    lam[soft] = np.minimum(lam[soft], price / 2)
    e = np.zeros(len(b))
    room = np.full(len(b), np.inf)  # price - lam
    room[soft] = price - lam[soft]
    e[soft] = BARRIER / room[soft]
    pairs = 2 * len(b) - begin

    def forward(d: np.ndarray) -> np.ndarray:
        moved = rows.times(d)
        return np.concatenate([d, -d, moved[low], -moved[high]])

    def backward(y: np.ndarray) -> np.ndarray:
        by_row = np.zeros(rows.count)
        middle = begin + len(low)
        by_row[low] = y[begin:middle]
        by_row[high] -= y[middle:]
        return rows.back(by_row) + y[:size] - y[size:begin]

    matrix = h.plus(mass, damping) if damping else h
    d, v = np.zeros(size), np.zeros(len(b))
    residual = g - backward(lam)  # a share `way` of a Newton step leaves 1 - way of it, and of the primal one
    primal, dual = float(np.abs(e - b - t).max()), float(np.abs(residual).max())
    steps = 0
    while steps < STEPS:
        mu = (t @ lam + e[soft] @ room[soft]) / pairs
        if mu < tolerance and dual < DUAL and primal < PRIMAL:
            break
        steps += 1
        weights = 1 / (t / lam + e / room)
        by_row = np.zeros(rows.count)
        middle = begin + len(low)
        by_row[low] = weights[begin:middle]
        by_row[high] += weights[middle:]
        diagonal = weights[:size] + weights[size:begin]
        while True:
            whole = Banded(matrix.band.copy(), matrix.border.copy(), matrix.corner.copy())
            inner = len(whole.band)
            whole.band[:, 0] += diagonal[:inner]
            whole.corner[np.diag_indices(size - inner)] += diagonal[inner:]
            rows.add_square(by_row, whole)
            try:
                factor = Factor(whole)
                break
            except np.linalg.LinAlgError:
                more = max(LEAST_DAMPING, damping)
                damping += more
                matrix = matrix.plus(mass, more)
                if damping > 1e9:
                    raise
                residual = matrix.times(d) + g - backward(lam)
                dual = float(np.abs(residual).max())
        # predictor
        off = b - v
        s = weights * off
        change = factor.solve(backward(s) - residual)
        slope = forward(change)
        dl = s - weights * slope
        dt = -t * dl / lam - t
        de = e * dl / room - e
        way = _way(t, lam, e, room, dt, dl, de, soft)
        after = (t + way * dt) @ (lam + way * dl) + (e + way * de)[soft] @ (room - way * dl)[soft]
        centre = mu * min(1.0, max((after / pairs / mu) ** 3, 1e-6))
        # corrector
        to_t, to_e = centre - dt * dl, centre + de * dl
        s = weights * (off + to_t / lam - to_e / room)
        change = factor.solve(backward(s) - residual)
        slope = forward(change)
        dl = s - weights * slope
        dt = (to_t - t * dl) / lam - t
        de = (to_e + e * dl) / room - e
        way = min(1.0, CLOSE * _way(t, lam, e, room, dt, dl, de, soft))
        residual *= 1 - way
        primal, dual = (1 - way) * primal, (1 - way) * dual
        d += way * change
        v += way * slope
        t += way * dt
        lam += way * dl
        e += way * de
        room[soft] = price - lam[soft]
    out = np.zeros(rows.count)
    middle = begin + len(low)
    out[low] = -lam[begin:middle]
    out[high] += lam[middle:]
    return Minimum(np.clip(d, *box), out, float(e[soft].sum()), damping, steps)


def _way(
    t: np.ndarray, lam: np.ndarray, e: np.ndarray, room: np.ndarray, dt: np.ndarray, dl: np.ndarray, de: np.ndarray,
    soft: slice,
) -> float:  # fmt: skip
    """The share of a step at which the first of t, lam, e and price - lam becomes zero; at most about one."""
    most = max(float((-dt / t).max()), float((-dl / lam).max()), 1.0)
    if len(e[soft]):
        most = max(most, float((-de[soft] / e[soft]).max()), float((dl[soft] / room[soft]).max()))
    return 1 / most
