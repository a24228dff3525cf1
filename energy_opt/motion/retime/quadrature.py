"""The grid of a retiming: points along the path, quadrature weights, and maps from control values to the points.

Integrals over time are sums over points, int F dt = sum_g weight_g F_g / sqrt(b_g), with positive weights: a term that
is convex in (a, b) at a point stays convex in the sum. Simpson's rule on every knot interval uses the same points for
integrals and limits (knots and middles). Towards an end at rest, b vanishes like s, so the rule is applied in sqrt(s)
(from the other end, sqrt(1 - s)), and the first interval at such an end has three Gauss points instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from scipy.sparse import coo_array, csr_array

from energy_opt.numerics.bspline import quadratic_basis

_X, _W = np.polynomial.legendre.leggauss(3)
GAUSS = ((_X + 1) / 2, _W / 2)


@dataclass(frozen=True)
class Grid:
    """Points s (M,) and weights (M,); s rises and contains every knot except those at rest."""

    s: np.ndarray
    weight: np.ndarray


def quadrature(knots: np.ndarray, rest: tuple[bool, bool]) -> Grid:
    """The grid for `knots` (N + 1,); `rest`: which ends are at rest."""
    middle = 0.5
    left, right = knots[:-1], knots[1:]
    from_start = rest[0] & (right <= middle)
    from_goal = rest[1] & (left >= middle)
    s, weight = [], []
    for side in ("start", "goal", "plain"):
        chosen = {"start": from_start, "goal": from_goal, "plain": ~(from_start | from_goal)}[side]
        lo, hi = left[chosen], right[chosen]
        if side == "goal":
            lo, hi = 1 - hi, 1 - lo
        if side != "plain":
            lo, hi = np.sqrt(np.maximum(lo, 0)), np.sqrt(hi)
        singular = (lo < 1e-12) & (side != "plain")
        for part, (x, w) in ((singular, GAUSS), (~singular, (np.array([0, 0.5, 1]), np.array([1, 4, 1]) / 6))):
            h = (hi - lo)[part, None]
            at, share = lo[part, None] + h * x, h * w
            if side != "plain":
                at, share = at**2, 2 * at * share
            s.append((1 - at if side == "goal" else at).ravel())
            weight.append(share.ravel())
    every, shares = np.concatenate(s), np.concatenate(weight)
    order = np.argsort(every, kind="stable")
    every, shares = every[order], shares[order]
    new = np.concatenate([[True], np.diff(every) > 1e-12])
    merged = np.zeros(int(new.sum()))
    np.add.at(merged, np.cumsum(new) - 1, shares)
    return Grid(every[new], merged)


@dataclass(frozen=True)
class Band:
    """Symmetric matrices (N, N) whose entries more than two off the diagonal are zero.

    Each interval depends on three neighbouring control values, so the Hessian of any sum over points has this form. It
    is stored as its upper triangle (3 N,), entry (i, j) at 3 j + 2 - (j - i), of which three places are outside.
    """

    count: int

    @cached_property
    def inside(self) -> np.ndarray:
        """The places (3 N - 3,) inside the matrix, column by column."""
        place = np.arange(3 * self.count)
        return place[place // 3 + place % 3 >= 2]

    @cached_property
    def pattern(self) -> ca.Sparsity:
        """The upper triangle's sparsity."""
        column = self.inside // 3
        starts = np.searchsorted(column, np.arange(self.count + 1))
        return ca.Sparsity(self.count, self.count, starts.tolist(), (column + self.inside % 3 - 2).tolist())


# pairs of the three control values that a point depends on
PAIRS = tuple((p, q) for q in range(3) for p in range(q + 1))


@dataclass(frozen=True)
class Lift:
    """Point quantities z (d, M), such as (a, b) at every point, as linear maps of the control values.

    Attributes:
        first: (M,) the first of the three control values (ends included) that a point depends on.
        maps: (d, M, 3) the coefficients.
        count: number of control values, ends included; the first and the last are given, not free.
    """

    first: np.ndarray
    maps: np.ndarray
    count: int

    def part(self, places: np.ndarray) -> Lift:
        """The maps to some of the points."""
        return Lift(self.first[places], self.maps[:, places], self.count)

    @cached_property
    def touched(self) -> np.ndarray:
        """(M, 3) the control values that each point depends on."""
        return self.first[:, None] + np.arange(3)

    @cached_property
    def _matrix(self) -> csr_array:
        """(d M, count) from control values to vec(z)."""
        d, m, _ = self.maps.shape
        starts = 3 * np.arange(d * m + 1)
        columns = np.broadcast_to(self.touched, (d, m, 3)).ravel()
        return csr_array((self.maps.ravel(), columns, starts), shape=(d * m, self.count))

    @cached_property
    def _down(self) -> csr_array:
        """The transpose of the matrix, for the free control values only."""
        return self._matrix[:, 1:-1].T.tocsr()

    def values(self, control: np.ndarray) -> np.ndarray:
        """z (d, M) of control values (count,), ends included."""
        return (self._matrix @ control).reshape(len(self.maps), -1)

    def adjoint(self, gradient: np.ndarray) -> np.ndarray:
        """Gradient (N,) with respect to the free control values, from that with respect to z (d, M)."""
        return self._down @ gradient.ravel()

    @cached_property
    def _assembly(self) -> csr_array:
        """(3 N, d (d + 1) / 2 M) from the points' Hessians to the sum of them, in the form of `Band`."""
        d, m, _ = self.maps.shape
        n = self.count - 2
        triangle = [(i, j) for j in range(d) for i in range(j + 1)]
        at_row, columns, values = [], [], []
        for p, q in PAIRS:
            row, column = self.first + p - 1, self.first + q - 1
            free = np.flatnonzero((row >= 0) & (column < n))
            for entry, (i, j) in enumerate(triangle):
                value = self.maps[i, :, p] * self.maps[j, :, q]
                if i != j:
                    value = value + self.maps[j, :, p] * self.maps[i, :, q]
                at_row.append((3 * column + 2 + row - column)[free])
                columns.append(entry * m + free)
                values.append(value[free])
        places = np.concatenate(at_row), np.concatenate(columns)
        return coo_array((np.concatenate(values), places), shape=(3 * n, len(triangle) * m)).tocsr()

    def hessian(self, hessians: np.ndarray) -> np.ndarray:
        """The sum (3 N,), in the form of `Band`, of the points' Hessians (d (d + 1) / 2, M).

        A point's Hessian is given by its upper triangle, column by column.
        """
        return self._assembly @ hessians.ravel()


def gathered(first: np.ndarray, entries: np.ndarray, count: int) -> np.ndarray:
    """The sum over points of their entries at control values, (count - 2,) for the free ones of `count`.

    Args:
        first: (M,) the first control value of each point. entries: (M, 3) at this one and the next two.
    """
    touched = first[:, None] + np.arange(3)
    return np.bincount(touched.ravel(), entries.ravel(), count)[1:-1]


def lift(knots: np.ndarray, s: np.ndarray, kinds: str = "ab", piece: np.ndarray | None = None) -> Lift:
    """The maps from control values of the timing to quantities at points.

    Args:
        knots: (N + 1,). s: (M,) points. kinds: "ab" for (a, b), "abw" for (a, b, w), as in `Lift.maps`.
        piece: (M,) the interval of each point, which matters at knots; None: the one to the right of a knot.
    """
    at = quadratic_basis(knots, s, piece)
    return Lift(at.first, np.stack([getattr(at, kind) for kind in kinds]), len(knots) + 1)


@lru_cache(maxsize=8)
def _kept(knots: bytes, s: bytes) -> Lift:
    """`lift` of arrays as bytes, so that results can be cached."""
    return lift(np.frombuffer(knots), np.frombuffer(s))


def kept_lift(knots: np.ndarray, s: np.ndarray) -> Lift:
    """The maps to (a, b) at the points of a grid; cached with their derived matrices for further moves."""
    return _kept(knots.tobytes(), s.tobytes())
