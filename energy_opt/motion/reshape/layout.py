"""The form of a reshaping problem: which unknowns there are, where its nodes lie, and which entries are not zero."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.sparse import csr_matrix

from energy_opt.numerics.bspline import DEGREE, Basis

LOCAL = DEGREE + 1  # control points that a node touches


@dataclass(frozen=True)
class Shape:
    """What is fixed about a program's form.

    Attributes:
        joints: n.
        basis: the B-splines.
        per_span: Gauss nodes per knot span.
        free_acceleration: end accelerations are free; else zero.
        vias: number of via points.
    """

    joints: int
    basis: Basis
    per_span: int = 3
    free_acceleration: bool = False
    vias: int = 0

    @property
    def pinned(self) -> int:
        """Control points at each end that the end conditions determine."""
        return 2 if self.free_acceleration else 3

    @property
    def free(self) -> int:
        """Free control points."""
        return self.basis.controls - 2 * self.pinned

    @property
    def unknowns(self) -> int:
        return self.joints * self.free + 1 + self.vias

    @cached_property
    def grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes u (K,) and weights (K,): Gauss nodes of every span, and its breakpoints with weight zero."""
        u, w = self.basis.gauss(self.per_span)
        u = np.concatenate([u, self.basis.breaks])
        w = np.concatenate([w, np.zeros(len(self.basis.breaks))])
        order = np.argsort(u, kind="stable")
        return u[order], w[order]

    @cached_property
    def matrices(self) -> list[np.ndarray]:
        """Basis matrices at the nodes for derivatives 0 to 3, (K, controls) each."""
        return [self.basis.matrix(self.grid[0], order) for order in range(4)]

    @cached_property
    def stacked(self) -> np.ndarray:
        """`matrices` of derivatives 0 to 2 as one, (3 K, controls), node by node."""
        return np.stack(self.matrices[:3], axis=1).reshape(-1, self.basis.controls)

    def first(self, u: np.ndarray) -> np.ndarray:
        """First of the six control points that each place u (M,) touches, (M,)."""
        inside = np.searchsorted(self.basis.breaks, u, side="right") - 1
        return np.clip(inside, 0, len(self.basis.breaks) - 2)

    @cached_property
    def local(self) -> np.ndarray:
        """Basis values of the touched control points for derivatives 0 to 3, (K, 4, 6)."""
        columns = self.first(self.grid[0])[:, None] + np.arange(LOCAL)
        return np.stack([np.take_along_axis(m, columns, axis=1) for m in self.matrices], axis=1)

    @cached_property
    def sites(self) -> list[np.ndarray]:
        """Matrices (sites, controls) to the control points of velocity, acceleration and jerk (times powers of T)."""
        return [self.basis.polygon(order) for order in (1, 2, 3)]

    @cached_property
    def site_local(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """For each of `sites`: first control point that a site touches (S,), and its six coefficients (S, 6)."""
        out = []
        for matrix in self.sites:
            first = np.minimum(np.argmax(np.abs(matrix) > 0, axis=1), self.basis.controls - LOCAL)
            out.append((first, np.take_along_axis(matrix, first[:, None] + np.arange(LOCAL), axis=1)))
        return out

    @cached_property
    def end_slopes(self) -> np.ndarray:
        """Control-point offsets (2, pinned) per unit of u-velocity at the start and the end, acceleration zero."""
        zero, one = np.zeros(1), np.ones(1)
        acceleration = None if self.free_acceleration else zero
        return np.stack([self.basis.ends(zero, one, acceleration, last)[:, 0] for last in (False, True)])


@dataclass(frozen=True)
class Ends:
    """What is fixed at both ends, and what must be passed: q, v (n,) and via points (vias, n)."""

    start: np.ndarray
    goal: np.ndarray
    v_start: np.ndarray
    v_goal: np.ndarray
    via: np.ndarray


class Pattern:
    """What all programs of one shape share: index maps of unknowns, the Hessian's pattern and its scatter matrix."""

    def __init__(self, shape: Shape) -> None:
        self.shape = shape
        self.time = shape.joints * shape.free  # index of T
        self.index = self.touched(shape.grid[0])

    def touched(self, u: np.ndarray) -> np.ndarray:
        """The unknown of each (control point, joint) that a place u (M,) touches, (M, 6 n); -1 where it is pinned."""
        s = self.shape
        points = s.first(u)[:, None] + np.arange(LOCAL) - s.pinned
        index = points[:, :, None] * s.joints + np.arange(s.joints)
        index = np.where(((points >= 0) & (points < s.free))[:, :, None], index, -1)
        return index.reshape(len(u), LOCAL * s.joints)

    def positions(self, rows: np.ndarray, columns: np.ndarray, pattern: ca.Sparsity) -> np.ndarray:
        """Where entries (rows, columns) lie among a pattern's nonzeros."""
        lookup = np.full(pattern.shape, -1)
        r, c = pattern.get_triplet()
        lookup[r, c] = np.arange(len(r))
        return lookup[rows, columns]

    @cached_property
    def hessian(self) -> ca.Sparsity:
        """Upper triangle: the band of control points that share a span, and full columns of T and the via times."""
        s, size = self.shape, self.shape.unknowns
        full = np.zeros((size, size), dtype=bool)
        for index in np.unique(self.index, axis=0):
            used = index[index >= 0]
            full[np.ix_(used, used)] = True
        full[:, self.time :] = True
        r, c = np.nonzero(np.triu(full))
        order = np.lexsort((r, c))
        self._lookup = np.full((size, size), -1)
        self._lookup[r[order], c[order]] = np.arange(len(order))
        assert s.unknowns == size
        return ca.Sparsity.triplet(size, size, r[order].tolist(), c[order].tolist())

    @cached_property
    def lookup(self) -> np.ndarray:
        """(unknowns, unknowns) -> index among the Hessian's nonzeros, -1 outside."""
        _ = self.hessian
        return self._lookup

    def scatter(self, touched: np.ndarray) -> csr_matrix:
        """Sparse matrix that sums the blocks (M, 6, n, n, 6) of places into the Hessian's nonzeros.

        A block's axes are control point and joint of the row, joint and control point of the column; `touched` is of
        the places.
        """
        index = touched.reshape(len(touched), LOCAL, -1)
        a = np.broadcast_to(index[:, :, :, None, None], (*index.shape, index.shape[2], LOCAL))
        b = np.broadcast_to(index.transpose(0, 2, 1)[:, None, None], a.shape)
        keep = ((a >= 0) & (b >= 0) & (a <= b)).ravel()
        target = self.lookup[a.ravel()[keep], b.ravel()[keep]]
        return csr_matrix((np.ones(len(target)), (target, np.flatnonzero(keep))), shape=(self.hessian.nnz(), keep.size))
