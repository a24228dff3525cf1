"""Banded quadratic programs, judged by the conditions of an optimum on dense matrices."""

from dataclasses import dataclass

import numpy as np
import pytest

from energy_opt.numerics.quadratic import Banded, minimise

PRICE = 20.0


@dataclass
class Dense:
    """Rows of a dense matrix over the unknowns of the band and, behind them, those of the border."""

    matrix: np.ndarray
    width: int

    @property
    def count(self) -> int:
        return len(self.matrix)

    def times(self, d: np.ndarray) -> np.ndarray:
        return self.matrix @ d

    def back(self, y: np.ndarray) -> np.ndarray:
        return self.matrix.T @ y

    def add_square(self, weights: np.ndarray, to: Banded) -> None:
        square = self.matrix.T @ (weights[:, None] * self.matrix)
        n = len(to.band)
        assert np.allclose(np.tril(square[:n, :n], -self.width), 0)
        to.band += banded(square[:n, :n], self.width)
        to.border += square[:n, n:]
        to.corner += square[n:, n:]


def banded(matrix: np.ndarray, width: int) -> np.ndarray:
    out = np.zeros((len(matrix), width))
    for offset in range(width):
        out[: len(matrix) - offset, offset] = np.diagonal(matrix, -offset)
    return out


def problem(seed: int, border: int, convex: bool = True) -> tuple[np.ndarray, np.ndarray, Dense, np.ndarray]:
    """A dense Hessian with a band and a border, a gradient, rows over windows, and their bounds."""
    rng = np.random.default_rng(seed)
    n, width, count = 30, 6, 25
    full = np.zeros((n + border, n + border))
    for k in range(n - width + 1):
        block = rng.normal(size=(width, width))
        full[k : k + width, k : k + width] += block @ block.T
    full[n:, :n] = 0.1 * rng.normal(size=(border, n))
    full[:n, n:] = full[n:, :n].T
    full[n:, n:] = 5 * np.eye(border)
    if not convex:
        full[:n, :n] -= 6 * np.eye(n)
    rows = np.zeros((count, n + border))
    for r in range(count):
        first = rng.integers(n - width + 1)
        rows[r, first : first + width] = rng.normal(size=width)
        rows[r, n:] = rng.normal(size=border)
    return full, rng.normal(size=n + border) * 5, Dense(rows, width), rng.uniform(0.05, 0.5, size=count)


@pytest.mark.parametrize(("seed", "border"), [(0, 0), (1, 0), (2, 1), (3, 3)])
def test_the_conditions_of_an_optimum_hold(seed: int, border: int) -> None:
    full, g, rows, room = problem(seed, border)
    n = len(full) - border
    h = Banded(banded(full[:n, :n], 6), full[:n, n:], full[n:, n:])
    mass = Banded(banded(np.eye(n), 6), np.zeros((n, border)), np.eye(border))
    low, high = np.full(len(g), -1.0), np.full(len(g), 0.7)
    floor = np.where(np.arange(rows.count) % 3 == 0, -np.inf, -room)
    found = minimise(h, g, (low, high), rows, (floor, room), PRICE, mass)
    assert found.damping == 0
    d, lam = found.d, found.multipliers
    value, slope = rows.matrix @ d, full @ d + g + rows.matrix.T @ lam
    assert np.all(d >= low) and np.all(d <= high)
    inside = (d > low + 1e-3) & (d < high - 1e-3)
    assert np.abs(slope[inside]).max() < 2e-3
    assert slope[d < low + 1e-6].min(initial=0) > -2e-3 and slope[d > high - 1e-6].max(initial=0) < 2e-3
    assert np.abs(lam).max() <= PRICE
    over = np.maximum(np.maximum(value - room, floor - value), 0)
    assert found.broken == pytest.approx(over.sum(), abs=1e-4)
    idle = (value < room - 1e-2) & (value > floor + 1e-2)
    assert np.abs(lam[idle]).max(initial=0) < 1e-3
    assert np.all(np.abs(lam[over > 1e-3]) > PRICE - 1e-2)


def test_rows_that_cannot_be_kept_are_broken_by_as_little_as_pays() -> None:
    h = Banded(np.ones((2, 1)), np.zeros((2, 0)), np.zeros((0, 0)))
    rows = Dense(np.array([[1.0, 0.0], [1.0, 0.0]]), 1)
    bounds = np.array([2.0, -np.inf]), np.array([np.inf, 1.0])  # x >= 2 and x <= 1
    found = minimise(h, np.zeros(2), (np.full(2, -5.0), np.full(2, 5.0)), rows, bounds, PRICE, h)
    assert found.broken == pytest.approx(1.0, abs=1e-3) and found.d[0] == pytest.approx(1.0, abs=1e-3)


def test_where_the_hessian_is_not_convex_enough_mass_is_added() -> None:
    full, g, rows, room = problem(4, 0, convex=False)
    assert np.linalg.eigvalsh(full).min() < 0
    h, mass = (Banded(banded(m, 6), np.zeros((30, 0)), np.zeros((0, 0))) for m in (full, np.eye(30)))
    found = minimise(h, g, (np.full(30, -0.1), np.full(30, 0.1)), rows, (-room, room), PRICE, mass)
    assert found.damping > 0
    assert g @ found.d + found.d @ full @ found.d / 2 < 0
