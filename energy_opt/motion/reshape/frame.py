"""Banded matrices of a reshaping problem: which entries of the Hessian the nodes, places and rows of a shape touch.

A node or place touches six control points, a window of 6 n neighbouring unknowns; so the Hessian over control points is
a band of width 6 n, kept as its lower diagonals. All sums into it are products with constant sparse matrices.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix

from energy_opt.motion.reshape.layout import LOCAL, Shape


class Frame:
    """Index arithmetic of one shape."""

    def __init__(self, shape: Shape) -> None:
        self.shape = shape
        n = shape.joints
        self.size, self.width = n * shape.free, LOCAL * n
        row, column = np.tril_indices(self.width)
        self._lower = row, column
        self._from = column * self.width + row - column  # of the window's first unknown
        self.entries = self.size * self.width
        self._linear: dict[tuple[int, ...], tuple[csr_matrix, csr_matrix, csr_matrix]] = {}

    def _targets(self, first: np.ndarray) -> np.ndarray:
        """Where the lower triangles (M, L) of windows that begin at control points `first` (M,) lie in the band; -1
        where a control point is pinned."""
        s, n = self.shape, self.shape.joints
        begin = (first - s.pinned) * n
        row, column = self._lower
        inside = (begin[:, None] + column >= 0) & (begin[:, None] + row < self.size)
        return np.where(inside, begin[:, None] * self.width + self._from, -1)

    def squares(self, first: np.ndarray, rows: np.ndarray) -> csc_matrix:
        """(entries, R): from weights of rows (R, 6 n) over windows to the band of their weighted square."""
        row, column = self._lower
        target = self._targets(first)
        data = rows[:, row] * rows[:, column]
        data[target < 0] = 0.0
        pointer = np.arange(len(first) + 1) * target.shape[1]
        return csc_matrix((data.ravel(), np.maximum(target, 0).ravel(), pointer), shape=(self.entries, len(first)))

    def linear(self, orders: tuple[int, ...]) -> tuple[csr_matrix, csr_matrix, csr_matrix]:
        """Control points of derivatives of those orders, site by site and joint by joint.

        As functions of all control points and of the free ones, and, as `squares`, to the band.
        """
        if orders not in self._linear:
            s, n = self.shape, self.shape.joints
            first = [np.repeat(s.site_local[k - 1][0], n) for k in orders]
            local = [np.repeat(s.site_local[k - 1][1], n, axis=0) for k in orders]
            joint = [np.tile(np.arange(n), len(s.site_local[k - 1][0])) for k in orders]
            f, c, j = (np.concatenate(x) for x in (first, local, joint)) if orders else (
                np.zeros(0, dtype=int), np.zeros((0, LOCAL)), np.zeros(0, dtype=int))  # fmt: skip
            size = s.basis.controls * n
            index = (f[:, None] + np.arange(LOCAL)) * n + j[:, None]
            rows = np.repeat(np.arange(len(f)), LOCAL)
            every = csr_matrix((c.ravel(), (rows, index.ravel())), shape=(len(f), size))
            free = every[:, s.pinned * n : size - s.pinned * n].tocsr()
            a, b = np.tril_indices(LOCAL)
            row, column = ((f[:, None] - s.pinned + x) * n + j[:, None] for x in (a, b))
            keep = (column >= 0) & (row < self.size)
            target = (column * self.width + row - column)[keep]
            source = np.broadcast_to(np.arange(len(f))[:, None], row.shape)[keep]
            square = csr_matrix(((c[:, a] * c[:, b])[keep], (target, source)), shape=(self.entries, len(f)))
            self._linear[orders] = every, free, square
        return self._linear[orders]

    def of_places(self, first: np.ndarray, local: np.ndarray) -> csr_matrix:
        """(entries, K n n): from matrices (K, n, n) at places with basis values `local` (K, 6) to the band."""
        n, target = self.shape.joints, self._targets(first)
        (a, i), (b, j) = (np.divmod(x, n) for x in self._lower)
        data = local[:, a] * local[:, b]
        keep = (target >= 0) & (data != 0)
        source = np.arange(len(first))[:, None] * n * n + i * n + j
        return csr_matrix((data[keep], (target[keep], source[keep])), shape=(self.entries, len(first) * n * n))

    @cached_property
    def spans(self) -> csr_matrix:
        """(entries, spans 6 n n 6): from blocks of knot spans, with axes as `blocks` gives them, to the band."""
        s, n = self.shape, self.shape.joints
        first = np.arange(len(s.basis.breaks) - 1)
        (a, i), (b, j) = (np.divmod(x, n) for x in self._lower)
        target = self._targets(first)
        inside = ((a * n + i) * n + j) * LOCAL + b
        source = first[:, None] * self.width**2 + inside
        keep = target >= 0
        shape = (self.entries, len(first) * self.width**2)
        return csr_matrix((np.ones(int(keep.sum())), (target[keep], source[keep])), shape=shape)

    def band_of(self, c: np.ndarray, local: np.ndarray) -> np.ndarray:
        """The band (N, w) of sum_k L_k' C_k L_k over nodes, as many in each knot span and in order.

        Args:
            c: (K, nz, nz) Hessians by (q, q', q'', T); local: (K, 3, 6).
        """
        n, count = self.shape.joints, len(c)
        spans = len(self.shape.basis.breaks) - 1
        core = c[:, : 3 * n, : 3 * n].reshape(count, 3, n * 3 * n)
        half = np.matmul(local.transpose(0, 2, 1), core).reshape(spans, count // spans, LOCAL, n, 3, n)
        half = half.transpose(0, 2, 3, 5, 1, 4).reshape(spans, LOCAL * n * n, -1)
        block = np.matmul(half, local.reshape(spans, -1, LOCAL))
        return np.asarray((self.spans @ block.ravel()).reshape(self.size, self.width))

    @cached_property
    def mass(self) -> np.ndarray:
        """The band of the integral of |q|^2 over u."""
        s, n = self.shape, self.shape.joints
        u, w = s.grid
        quad = np.flatnonzero(w)
        eye = np.broadcast_to(np.eye(n), (len(quad), n, n)) * w[quad, None, None]
        matrix = self.of_places(s.first(u[quad]), s.local[quad, 0])
        return np.asarray((matrix @ eye.ravel()).reshape(self.size, self.width))

    def columns(self, first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unknowns (R, 6 n) of windows, 0 where a control point is pinned; and whether they are free."""
        n = self.shape.joints
        index = (first[:, None] - self.shape.pinned) * n + np.arange(self.width)
        free = (index >= 0) & (index < self.size)
        return np.where(free, index, 0), free
