"""Quadratic functions in a box, judged by another solver and by the conditions of an optimum."""

import numpy as np
from scipy.optimize import lsq_linear

from energy_opt.numerics.box import bounded_step


def test_the_least_in_a_box_is_that_of_another_solver():
    """Few and many bounds at work, numbers without bounds, and such as are held by equal bounds."""
    rng = np.random.default_rng(5)
    for count in (1, 2, 7, 25, 60):
        a = rng.normal(size=(count + 8, count)) @ np.diag(10 ** rng.uniform(-1, 1, count))
        b = rng.normal(size=len(a))
        low, high = -rng.exponential(0.3, count), rng.exponential(0.3, count)
        low[rng.random(count) < 0.3], high[rng.random(count) < 0.3] = -np.inf, np.inf
        held = rng.random(count) < 0.1
        low[held] = high[held] = 0.0
        x = bounded_step(a.T @ a, a.T @ b, low, high)
        room = np.where(held, 1e-12, 0.0)
        other = lsq_linear(a, b, (low - room, high + room), method="bvls", tol=1e-14).x
        assert (x >= low).all() and (x <= high).all()
        assert np.sum((a @ x - b) ** 2) <= np.sum((a @ other - b) ** 2) * (1 + 1e-9) + 1e-12
