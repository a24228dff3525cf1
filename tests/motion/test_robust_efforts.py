"""Torque limits under several models."""

from __future__ import annotations

import numpy as np

from energy_opt.motion.plan.efforts import smaller


def test_a_joint_without_a_torque_limit_gets_none() -> None:
    """Its shares are 0: 0 / 0 gave a warning of NumPy's."""
    shares = smaller(np.ones(2), np.array([0.0, 1.25]), np.array([0.0, 1.0]))
    assert shares[0] == 1 and 0.75 < shares[1] < 0.8
