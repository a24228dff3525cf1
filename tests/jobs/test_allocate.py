"""Shares of a cycle's time among legs whose energies are known formulas."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from energy_opt.jobs.allocate import Front, Solved, allocate


def front(held: float, save: float, power: int, shortest: float) -> Front:
    """A leg of energy `held` T + `save` / T^`power` [J] from `shortest` to 8 s, by the minimum of a scalar function."""

    def at_price(price: float) -> Solved:
        found = minimize_scalar(
            lambda t: (held - price) * t + save / t**power, bounds=(shortest, 8.0), method="bounded",
            options={"xatol": 1e-10},
        )  # fmt: skip
        return Solved(float(found.x), held * found.x + save / found.x**power, None)

    return Front(shortest, 8.0, held + 1.5, at_price)  # the mean power of holding is above that at the cheapest place


@pytest.mark.parametrize("power", [1, 3])
def test_legs_that_hardly_save_by_slowing_get_the_best_shares(power: int) -> None:
    """The search had ended after nine prices with shares that cost 0.1 and 0.5 J more than the best."""
    legs = [(89.0, 0.3, 1, 1.4), (90.0, 2.0, power, 0.7), (89.2, 0.05, 1, 1.2)]
    shares = allocate([front(*leg) for leg in legs], 8.0, 91.3, 90.56)
    assert shares.durations.sum() == pytest.approx(8.0) and shares.left == 0

    def energy(durations: np.ndarray) -> np.ndarray:
        return sum(h * t + k / t**e for (h, k, e, _), t in zip(legs, durations, strict=True))

    first, second = np.meshgrid(np.linspace(1.4, 6.1, 600), np.linspace(0.7, 5.4, 600))
    third = 8.0 - first - second
    grid = np.where(third >= 1.2, energy(np.array([first, second, np.maximum(third, 1.2)])), np.inf)
    assert energy(shares.durations) <= grid.min() * (1 + 3e-5)
