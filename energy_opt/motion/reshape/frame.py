"""Index arithmetic of a shape's banded matrices: which unknowns nodes, places and constraints touch.

A node or place touches six control points, a window of 6 n neighbouring unknowns; so the Hessian over control points is
a band of width 6 n, kept as its lower diagonals (see `numerics.quadratic`).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix

from energy_opt.motion.reshape.layout import LOCAL, Shape
from energy_opt.numerics.quadratic import add_places


class Frame:
    """Index arithmetic of one shape."""

    def __init__(self, shape: Shape) -> None:
        self.shape = shape
        n = shape.joints
        self.size, self.width = n * shape.free, LOCAL * n
        self._linear: dict[tuple[int, ...], tuple[csr_matrix, np.ndarray, np.ndarray, np.ndarray]] = {}

    def window(self, u: np.ndarray) -> np.ndarray:
        """First control points of windows at u (M,), counted from the first free one; negative where pinned."""
        return self.shape.first(u) - self.shape.pinned

    def linear(self, orders: tuple[int, ...]) -> tuple[csr_matrix, np.ndarray, np.ndarray, np.ndarray]:
        """Control points of derivatives of those orders, site by site and joint by joint.

        Returns a matrix over all control points, and for each of them window, joint and coefficients (L, 6).
        """
        if orders not in self._linear:
            s, n = self.shape, self.shape.joints
            first, local, joint = [np.zeros(0, dtype=np.int64)], [np.zeros((0, LOCAL))], [np.zeros(0, dtype=np.int64)]
            for k in orders:
                begin, values = s.site_local[k - 1]
                first.append(np.repeat(begin, n))
                local.append(np.repeat(values, n, axis=0))
                joint.append(np.tile(np.arange(n), len(begin)))
            f, c, j = (np.concatenate(x) for x in (first, local, joint))
            index = (f[:, None] + np.arange(LOCAL)) * n + j[:, None]
            pointer = np.arange(len(f) + 1) * LOCAL
            every = csr_matrix((c.ravel(), index.ravel(), pointer), shape=(len(f), s.basis.controls * n))
            self._linear[orders] = every, f - s.pinned, j, c
        return self._linear[orders]

    @cached_property
    def mass(self) -> np.ndarray:
        """The band of the integral of |q|^2 over u."""
        s, n = self.shape, self.shape.joints
        u, w = s.grid
        quad = np.flatnonzero(w)
        out = np.zeros((self.size, self.width))
        eye = np.eye(n) * w[quad, None, None]
        add_places(out, eye, s.local[quad, 0], self.window(u[quad]), n)
        return out

    def columns(self, first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unknowns (R, 6 n) of windows, 0 where a control point is pinned; and whether they are free."""
        index = first[:, None] * self.shape.joints + np.arange(self.width)
        free = (index >= 0) & (index < self.size)
        return np.where(free, index, 0), free
