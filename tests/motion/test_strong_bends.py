"""Retiming along a path of many strong bends, where a first program exceeds accelerations many times."""

from __future__ import annotations

import numpy as np

import energy_opt as eo

BASE = np.array([0, -1.2, 1.2, -1.5, -1.5, 0])


def wave(s: np.ndarray) -> np.ndarray:
    """A sine of three periods about a line (M, 6) [rad]."""
    s = np.atleast_1d(s)
    swing, way = np.outer(np.sin(6 * np.pi * s), [0.3, 0.1, 0, 0, 0, 0.3]), np.outer(s, [1, 0, 0, 0, 0, 0.3])
    return np.asarray(BASE + swing + way)


def test_bounds_that_are_tightened_stay_above_zero() -> None:
    """They became negative: the move took 6.9 s and 870 J."""
    found = eo.optimize("ur5e", "source-method-2", path=wave, mode="retime", self_collision=False)
    assert found.status == "solved" and found.certificate.valid
    assert found.duration < 6.7
