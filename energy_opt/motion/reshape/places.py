"""Numeric constraints of a reshaping problem (see limits.base.PlaceRows), brought to the control points.

A place u_k has its position q_k = B_k P + ..., with the six B-splines B_k that are not zero there; so a row's gradient
g gives B_k kron g, and a place's Hessian H gives the block B_k B_k^T kron H. Both are one product for all constraints.
"""

from __future__ import annotations

import numpy as np

from energy_opt.motion.limits.base import PlaceRows
from energy_opt.motion.reshape.layout import LOCAL, Pattern


class Placed:
    """One limit's numeric constraints.

    Args:
        slope: (controls, n) derivative of all control points with respect to T, that of the pinned ones.
    """

    def __init__(self, rows: PlaceRows, pattern: Pattern, slope: np.ndarray) -> None:
        shape = pattern.shape
        self.rows = rows
        self._matrix = shape.basis.matrix(rows.u)
        columns = shape.first(rows.u)[:, None] + np.arange(LOCAL)
        self._local = np.take_along_axis(self._matrix, columns, axis=1)  # (K, 6)
        self._pairs = self._local[:, :, None] * self._local[:, None, :]  # (K, 6, 6)
        self._by_time = self._matrix @ slope  # dq/dT (K, n)
        self._touched = pattern.touched(rows.u)
        self._inside = self._touched >= 0
        self._scatter = pattern.scatter(self._touched)
        self._unknowns, self._time = shape.unknowns, pattern.time

    @property
    def unknowns(self) -> np.ndarray:
        """The unknowns that each row depends on besides T, (R, 6 n); -1 where a control point is pinned."""
        return self._touched[self.rows.place]

    def move(self, points: np.ndarray) -> None:
        """Go to a curve."""
        self._q = self._matrix @ points
        self.value = self.rows.value(self._q)

    def slopes(self) -> np.ndarray:
        """Derivatives with respect to `unknowns` and T, (R, 6 n + 1)."""
        gradient, place = self.rows.gradient(self._q), self.rows.place
        by_point = (self._local[place][:, :, None] * gradient[:, None, :]).reshape(len(place), -1)
        by_time = np.sum(gradient * self._by_time[place], axis=1)
        return np.concatenate([by_point, by_time[:, None]], axis=1)

    def hessian(self, multipliers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The constraints' share of the Hessian's nonzeros, and of its column of T (time + 1,)."""
        h = self.rows.hessian(self._q, multipliers)
        block = self._pairs[:, :, None, None, :] * h[:, None, :, :, None]  # (K, 6, n, n, 6)
        moved = np.einsum("kij,kj->ki", h, self._by_time)
        cross = (self._local[:, :, None] * moved[:, None, :]).reshape(len(h), -1)
        column = np.bincount(self._touched[self._inside], cross[self._inside], self._unknowns)[: self._time + 1]
        column[self._time] = np.sum(moved * self._by_time)
        return self._scatter @ block.ravel(), column
