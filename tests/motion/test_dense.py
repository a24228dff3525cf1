"""Trajectories on dense grids."""

from __future__ import annotations

import numpy as np

from energy_opt.motion.dense import grid_of
from energy_opt.motion.trajectory import Trajectory


def test_a_long_motion_of_one_joint_is_computed_once_for_all_models() -> None:
    """A minute of one joint counted as too long to keep: each model computed its torques again."""
    time = np.linspace(0, 60, 15_000)
    still = np.zeros((len(time), 1))
    motion = Trajectory(("j",), time, still, still, still)
    assert grid_of(motion, 10) is grid_of(motion, 10)
