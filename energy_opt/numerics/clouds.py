"""Sets of points in space: finds the lowest points along directions, for many sets and directions at once.

Compiled (`clouds.c`) where there is a C compiler, else in NumPy.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Sequence

import numpy as np

from energy_opt.numerics import native
from energy_opt.numerics.native import pointer


class Clouds:
    """Sets of points.

    Args:
        sets: of each its points (V, 3), at least one.
    """

    def __init__(self, sets: Sequence[np.ndarray]) -> None:
        self.sets = tuple(np.asarray(points, dtype=float) for points in sets)
        self._columns = np.vstack([np.zeros((0, 3)), *self.sets]).T.copy()
        self._first = np.cumsum([0, *(len(points) for points in self.sets)], dtype=np.int64)
        self.room = np.empty((2, max((len(points) for points in self.sets), default=1)))

    def native(self) -> native.Clouds:
        """The sets in the layout of the C functions."""
        return native.Clouds(*map(pointer, self._columns), pointer(self._first))

    def points(self, which: np.ndarray, vertex: np.ndarray) -> np.ndarray:
        """Points (M, 3) of sets (M,) by their numbers within the set (M,)."""
        return np.asarray(self._columns.T[self._first[which] + vertex])

    def lowest(self, which: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For sets (M,), the index (M,) of the lowest point along directions (M, 3), and its coordinate (M,) there."""
        vertex, height, c = np.zeros(len(which), dtype=np.int64), np.zeros(len(which)), native.library()
        if c is None:
            for one, some in _groups(which):
                all_ = direction[some] @ self.sets[one].T
                vertex[some] = np.argmin(all_, axis=1)
                height[some] = all_[np.arange(len(some)), vertex[some]]
            return vertex, height
        which, direction = np.ascontiguousarray(which, dtype=np.int64), np.ascontiguousarray(direction)
        c.clouds_lowest(
            ctypes.byref(self.native()), pointer(which), pointer(direction), ctypes.c_int64(len(which)),
            pointer(self.room), pointer(vertex), pointer(height),
        )  # fmt: skip
        return vertex, height

    def spread(
        self, which: np.ndarray, direction: np.ndarray, many: np.ndarray, most: int, above: float, beside: float
    ) -> np.ndarray:
        """Low points of sets (M,) along directions (M, 3), that are not close to each other, by number (M, most).

        The first is the lowest. Where `many` (M,), others that are at most `above` higher follow, each the one that is
        farthest from those before, as long as it is more than `beside` from them; -1 where there is none.
        """
        out, c = np.full((len(which), most), -1, dtype=np.int64), native.library()
        if c is None:
            for one, some in _groups(which):
                points = self.sets[one]
                height = direction[some] @ points.T
                last = out[some, 0] = np.argmin(height, axis=1)
                usable = height <= height[np.arange(len(some)), last][:, None] + above
                gap = np.where(usable & many[some, None], np.inf, 0.0)
                for k in range(1, most):
                    gap = np.minimum(gap, np.sum((points[None] - points[last][:, None]) ** 2, axis=2))
                    last = np.argmax(gap, axis=1)
                    good = gap[np.arange(len(some)), last] > beside**2
                    out[some[good], k] = last[good]
            return out
        which, many = (np.ascontiguousarray(x, dtype=np.int64) for x in (which, many))
        direction = np.ascontiguousarray(direction)
        c.clouds_spread(
            ctypes.byref(self.native()), pointer(which), pointer(direction), pointer(many),
            ctypes.c_int64(len(which)), ctypes.c_int64(most), ctypes.c_double(above), ctypes.c_double(beside),
            *map(pointer, self.room), pointer(out),
        )  # fmt: skip
        return out


def _groups(which: np.ndarray) -> Iterable[tuple[int, np.ndarray]]:
    """Each of the sets (M,) with the indices where it is."""
    if not len(which):
        return
    order = np.argsort(which, kind="stable")
    for some in np.split(order, np.flatnonzero(np.diff(which[order])) + 1):
        yield int(which[some[0]]), some
