"""Rests of signals: their starts and ends by the readings."""

from __future__ import annotations

import numpy as np
import pytest

from energy_opt.numerics.rests import at_rest, encoder_step

STOP, START = 2.0, 3.0  # [s] the end of one motion and the start of the next


def trapezoid(time, a=1.0):
    """Positions of a joint that brakes with `a` until STOP, and accelerates with `a` from START on."""
    return -0.5 * a * np.clip(STOP - time, 0, None) ** 2 + 0.5 * a * np.clip(time - START, 0, None) ** 2


@pytest.mark.parametrize("rate", [25, 100, 500])
@pytest.mark.parametrize(("noise", "step"), [(5e-6, 1e-6), (0.0, 1e-4), (2e-5, 2e-5)])
def test_a_rest_begins_and_ends_where_the_readings_change(rate, noise, step):
    time = np.arange(0, 5, 1 / rate)
    rng = np.random.default_rng(1)
    q = np.round((trapezoid(time) + noise * rng.normal(size=len(time))) / step) * step
    rest = time[at_rest(time, q[:, None], 2e-3)[:, 0]]
    # the position has changed by 4e-4 rad after 28 ms
    assert abs(rest[0] - STOP) < 0.03 + 1 / rate and abs(rest[-1] - START) < 0.03 + 1 / rate


def test_slow_motion_and_turning_points_are_no_rest():
    time = np.arange(0, 5, 0.002)
    q = np.column_stack([2e-3 * time, 0.1 * np.sin(2 * time)])
    assert not at_rest(time, np.round(q / 1e-5) * 1e-5, 2e-3).any()


def test_a_coarse_signal_that_moves_is_no_rest():
    """At 10 readings/s the third difference of a motion is no noise."""
    time = np.arange(0, 30, 0.1)
    assert not at_rest(time, np.sin(3 * time)[:, None], 2e-3).any()


def test_the_step_of_an_encoder_is_found():
    time = np.arange(0, 5, 0.01)
    q = np.column_stack([np.sin(time), np.sin(time), np.zeros(len(time))])
    q[:, 0] = np.round(q[:, 0] / 3e-4) * 3e-4
    np.testing.assert_allclose(encoder_step(q), [3e-4, 0, 0], rtol=1e-6)
