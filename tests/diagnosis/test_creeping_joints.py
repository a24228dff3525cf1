"""A joint that creeps while another moves has friction, too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.measured import MeasuredSet, Run
from energy_opt.robot import load_robot

STEP = 2e-5  # [rad] of the encoders


def quintic(s):
    return 10 * s**3 - 15 * s**4 + 6 * s**5


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_joint_that_creeps_while_another_moves_is_not_at_rest(way):
    """Its speed is below 1 mrad/s throughout, and dry friction bears or adds to its load all the same."""
    time = np.arange(0, 4, 0.008)
    share = quintic(np.clip(time - 1, 0, 2) / 2)
    travel = np.array([0.8, 0.9e-3 * way, 0, 0, 0, 0])
    q = np.array([0.1, -1.2, 0.7, -0.9, 0.4, 0.2]) + share[:, None] * travel
    q = np.round(q / STEP) * STEP
    noise = np.random.default_rng(1).normal(size=len(time))
    run = Run("a.csv", "motion", 0.0, time, q, None, None, None, None, time, 100 + noise)
    s = take_samples(MeasuredSet(Path(), load_robot("ur5e"), (run,), True))
    middle, rest = abs(s.t - 2) < 0.4, abs(s.t - 2) > 1.2
    assert (np.sign(s.v[middle, 1]) == way).all() and abs(s.v[:, 1]).max() < 1e-3
    assert not s.v[rest].any() and not s.v[:, 2:].any()
