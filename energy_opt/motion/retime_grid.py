"""The grid of a retiming: points along the path, quadrature weights, and maps from control values to the points.

Integrals over time are sums over points, int F dt = sum_g weight_g F_g / sqrt(b_g), with positive weights: a term that
is convex in (a, b) at a point stays convex in the sum. Simpson's rule on every knot interval serves integrals and
limits with the same points (knots and middles). Towards an end at rest b vanishes like s, so the rule is applied in
sqrt(s) (from the other end, sqrt(1 - s)), and the first interval at such an end has three Gauss points instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from energy_opt.motion.timing_law import Basis, basis

_X, _W = np.polynomial.legendre.leggauss(3)
GAUSS = ((_X + 1) / 2, _W / 2)


@dataclass(frozen=True)
class Grid:
    """Points s (M,) and weights (M,); s rises, and holds every knot but those at rest."""

    knots: np.ndarray
    s: np.ndarray
    weight: np.ndarray


def quadrature(knots: np.ndarray, rest: tuple[bool, bool]) -> Grid:
    """The grid for `knots` (N + 1,); `rest` says which ends are at rest."""
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
    return Grid(knots, every[new], merged)


@dataclass(frozen=True)
class Lift:
    """Point quantities z (d, M), such as (a, b) at every point, as linear maps of the free control values (N,).

    Attributes:
        first: (M,) the first of the three control values (ends included) that a point depends on.
        maps: (d, M, 3) the coefficients.
        count: number of control values, ends included; the first and the last are given, not free.
    """

    first: np.ndarray
    maps: np.ndarray
    count: int

    @classmethod
    def of(cls, at: Basis, kinds: str, count: int) -> Lift:
        """From the B-spline's basis; `kinds` is "ab" or "abw"."""
        return cls(at.first, np.stack([getattr(at, kind) for kind in kinds]), count)

    def values(self, control: np.ndarray) -> np.ndarray:
        """z (d, M) of control values (count,), ends included."""
        return np.einsum("dmk,mk->dm", self.maps, control[self.first[:, None] + np.arange(3)])

    def pulled(self, gradient: np.ndarray) -> np.ndarray:
        """Gradient with respect to the free control values, from that with respect to z (d, M)."""
        out = np.zeros(self.count)
        np.add.at(out, self.first[:, None] + np.arange(3), np.einsum("dmk,dm->mk", self.maps, gradient))
        return out[1:-1]

    @cached_property
    def matrix(self) -> ca.DM:
        """(d M, N) from free control values to vec(z)."""
        d, m, _ = self.maps.shape
        columns = np.broadcast_to(self.first[:, None] + np.arange(3) - 1, (d, m, 3))
        rows = np.broadcast_to((np.arange(m) * d)[None, :, None] + np.arange(d)[:, None, None], (d, m, 3))
        return sparse(rows, columns, self.maps, (d * m, self.count - 2))

    @cached_property
    def ends(self) -> np.ndarray:
        """(d M, 2) from the first and last control value to vec(z)."""
        out = np.zeros((2, self.count))
        out[0, 0] = out[1, -1] = 1
        return np.stack([self.values(unit).T.ravel() for unit in out], axis=1)

    @cached_property
    def curvature(self) -> tuple[ca.Sparsity, ca.DM]:
        """Pattern of the Hessian's upper triangle (N, N), and the map from (d (d + 1) / 2, M) point Hessians to it.

        A point's Hessian is given by its upper triangle, column by column.
        """
        d, m, _ = self.maps.shape
        n = self.count - 2
        index = self.first[:, None] + np.arange(3) - 1
        pairs = [(i, j) for j in range(d) for i in range(j + 1)]
        rows, columns, entries, values = [], [], [], []
        for entry, (i, j) in enumerate(pairs):
            for p in range(3):
                for q in range(p, 3):
                    value = self.maps[i, :, p] * self.maps[j, :, q]
                    if i != j:
                        value = value + self.maps[j, :, p] * self.maps[i, :, q]
                    keep = (index[:, p] >= 0) & (index[:, q] < n)
                    rows.append(index[keep, p])
                    columns.append(index[keep, q])
                    entries.append(np.flatnonzero(keep) * len(pairs) + entry)
                    values.append(value[keep])
        row, column = np.concatenate(rows), np.concatenate(columns)
        pattern, place = _pattern(row, column, (n, n))
        assembly = sparse(place, np.concatenate(entries), np.concatenate(values), (pattern.nnz(), len(pairs) * m))
        return pattern, assembly

    def rows(self, per_point: int) -> tuple[ca.Sparsity, ca.DM]:
        """Pattern of the Jacobian (per_point M, N) of `per_point` functions of z at each point, and the map to it.

        The map takes the points' Jacobians (per_point, d), each column by column, one point after the other.
        """
        d, m, _ = self.maps.shape
        n = self.count - 2
        point, r, p, i = np.meshgrid(np.arange(m), np.arange(per_point), np.arange(3), np.arange(d), indexing="ij")
        column = self.first[point] + p - 1
        keep = (column >= 0) & (column < n)
        point, r, p, i, column = (x[keep] for x in (point, r, p, i, column))
        pattern, place = _pattern(point * per_point + r, column, (per_point * m, n))
        source = point * per_point * d + i * per_point + r
        return pattern, sparse(place, source, self.maps[i, point, p], (pattern.nnz(), per_point * d * m))


def lift(knots: np.ndarray, s: np.ndarray, kinds: str = "ab", piece: np.ndarray | None = None) -> Lift:
    """The maps from control values to the points `s`; `piece` says which interval where s is a knot."""
    return Lift.of(basis(knots, s, piece), kinds, len(knots) + 1)


def _pattern(rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]) -> tuple[ca.Sparsity, np.ndarray]:
    """The sparsity pattern of the given places, and each place's position among its non-zeros."""
    key = columns * shape[0] + rows
    distinct, place = np.unique(key, return_inverse=True)
    starts = np.searchsorted(distinct, np.arange(shape[1] + 1) * shape[0])
    return ca.Sparsity(*shape, starts.tolist(), (distinct % shape[0]).tolist()), place


def sparse(rows: np.ndarray, columns: np.ndarray, values: np.ndarray, shape: tuple[int, int]) -> ca.DM:
    """The matrix with the given entries; entries at the same place add up, those outside are dropped."""
    rows, columns, values = (np.ravel(x) for x in (rows, columns, values))
    inside = (columns >= 0) & (columns < shape[1])
    rows, columns, values = rows[inside], columns[inside], values[inside]
    pattern, place = _pattern(rows, columns, shape)
    summed = np.zeros(pattern.nnz())
    np.add.at(summed, place, values)
    return ca.DM(pattern, ca.DM(summed))
