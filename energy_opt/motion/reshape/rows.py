"""Linearised rows of a reshaping problem: what a step does to them, and their weighted squares, as banded matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from energy_opt.numerics.quadratic import Banded


class Part:
    """Some rows that are alike: `times`, `back` and `square` are as of `Rows`, of the free control points alone."""

    def __init__(self, matrix: csr_matrix, squares: csr_matrix, which: np.ndarray | None, scale: np.ndarray) -> None:
        self._matrix, self._back, self._squares = matrix, matrix.T.tocsr(), squares
        self._which, self._scale = which, scale

    def times(self, d: np.ndarray) -> np.ndarray:
        return np.asarray(self._matrix @ d)

    def back(self, y: np.ndarray) -> np.ndarray:
        return np.asarray(self._back @ y)

    def square(self, weights: np.ndarray) -> np.ndarray:
        if self._which is None:
            return np.asarray(self._squares @ weights)
        out = np.zeros(self._squares.shape[1])
        out[self._which] = weights * self._scale
        return np.asarray(self._squares @ out)


class PlacePart:
    """Rows that depend on the position at places: gradients (R, n), the place of each, in order, and the basis there.

    Args:
        basis: (K, free control points); to_band: see `Frame.of_places`.
    """

    def __init__(self, basis: np.ndarray, to_band: csr_matrix, place: np.ndarray, gradient: np.ndarray) -> None:
        self._basis, self._down, self._to_band = basis, basis.T.copy(), to_band
        self._place, self._gradient = place, gradient
        self._starts = np.flatnonzero(np.diff(place, prepend=-1))
        self._used = place[self._starts]
        self._outer = (gradient[:, :, None] * gradient[:, None]).reshape(len(place), gradient.shape[1] ** 2)

    def times(self, d: np.ndarray) -> np.ndarray:
        moved = self._basis @ d.reshape(self._basis.shape[1], -1)
        return np.asarray(np.einsum("rn,rn->r", self._gradient, moved[self._place]))

    def back(self, y: np.ndarray) -> np.ndarray:
        return np.asarray(self._down @ self._summed(y, self._gradient)).ravel()

    def square(self, weights: np.ndarray) -> np.ndarray:
        return np.asarray(self._to_band @ self._summed(weights, self._outer).ravel())

    def _summed(self, weights: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Weighted sums at each place."""
        out = np.zeros((len(self._basis), values.shape[1]))
        if len(self._starts):
            out[self._used] = np.add.reduceat(weights[:, None] * values, self._starts, axis=0)
        return out


@dataclass
class Rows:
    """Linearised rows: A (R, N + k) in parts and border, with the bounds of A d, and what names them.

    `keys` (R,) are the same for the same row at another curve.
    """

    parts: list[tuple[int, Part | PlacePart]]  # with the number of rows
    border: np.ndarray
    floor: np.ndarray
    ceiling: np.ndarray
    keys: np.ndarray

    @property
    def count(self) -> int:
        return len(self.floor)

    def times(self, d: np.ndarray) -> np.ndarray:
        n = len(d) - self.border.shape[1]
        out = np.concatenate([part.times(d[:n]) for _, part in self.parts])
        return np.asarray(out + self.border @ d[n:] if len(d) > n else out)

    def back(self, y: np.ndarray) -> np.ndarray:
        ends = np.cumsum([count for count, _ in self.parts])
        pieces = (part.back(y[end - count : end]) for end, (count, part) in zip(ends, self.parts, strict=True))
        inner = np.asarray(sum(pieces))
        return np.concatenate([inner, self.border.T @ y]) if self.border.shape[1] else np.asarray(inner)

    def add_square(self, weights: np.ndarray, to: Banded) -> None:
        flat, used = to.band.reshape(-1), 0
        for count, part in self.parts:
            flat += part.square(weights[used : used + count])
            for column in range(self.border.shape[1]):
                to.border[:, column] += part.back((weights * self.border[:, column])[used : used + count])
            used += count
        if self.border.shape[1]:
            to.corner += self.border.T @ (weights[:, None] * self.border)

    def joined(self, other: Rows) -> Rows:
        """These rows and others."""
        return Rows(
            [*self.parts, *other.parts],
            np.concatenate([self.border, other.border]),
            np.concatenate([self.floor, other.floor]),
            np.concatenate([self.ceiling, other.ceiling]),
            np.concatenate([self.keys, other.keys]),
        )

    def moved(self, d: np.ndarray) -> Rows:
        """The rows as seen from a point from which these are d away."""
        gone = self.times(d)
        return Rows(self.parts, self.border, self.floor + gone, self.ceiling + gone, self.keys)
