"""What is written is what was judged: files read back, judged again, and said to hold or not."""

from __future__ import annotations

import numpy as np
import pytest

from energy_opt.motion.trajectory import Trajectory, whole


def test_rows_lie_on_whole_nanoseconds_of_the_same_curve() -> None:
    """What moves rows by half a nanosecond leaves position, velocity and acceleration on the curve."""
    time = np.sort(np.random.default_rng(1).uniform(0, 2, 60))
    x = (time - time[0])[:, None]
    curve = Trajectory(("a", "b"), time, np.hstack([x**3, x**4]), np.hstack([3 * x**2, 4 * x**3]),
                       np.hstack([6 * x, 12 * x**2]))  # fmt: skip
    out = curve.on_nanoseconds()
    np.testing.assert_array_equal(out.time, whole(out.time))
    assert out.on_nanoseconds() is out and out.time != pytest.approx(time, abs=1e-13)
    moved = (out.time - time[0])[1:-1]
    np.testing.assert_allclose(out.position[1:-1, 0], moved**3, atol=1e-13)
    np.testing.assert_allclose(out.acceleration[1:-1, 1], 12 * moved**2, atol=1e-9)
