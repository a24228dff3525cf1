"""Accelerations that jump: the error that smoothing makes beside a jump is estimated."""

from __future__ import annotations

import numpy as np
import pytest

from energy_opt.measured import Run, choose_smoothing, kinematics

NOISE = 5e-6  # [rad]


def record(acceleration, rate, seed=0):
    """A run of a joint with this acceleration on a grid of 0.1 ms, its true v and a at times, and the times."""
    fine = np.arange(len(acceleration)) * 1e-4
    v = np.cumsum(acceleration) * 1e-4
    time = np.arange(0, fine[-1], 1 / rate)
    q = np.interp(time, fine, np.cumsum(v) * 1e-4) + NOISE * np.random.default_rng(seed).normal(size=len(time))
    at = np.arange(0.1, fine[-1] - 0.1, 0.003)
    run = Run("", "motion", 0.0, time, q[:, None], None, None, None, None, np.zeros(0), np.zeros(0))
    return run, np.interp(at, fine, v), np.interp(at, fine, acceleration), at


def trapezoids(seed=0):
    """Accelerations of eight moves there and back with stops between."""
    rng, parts = np.random.default_rng(seed), []
    for _ in range(8):
        a, ramp, cruise = rng.uniform(1, 4), int(1e4 * rng.uniform(0.2, 0.4)), int(1e4 * rng.uniform(0.2, 0.6))
        for way in (a, -a):
            parts += [np.zeros(4000), np.full(ramp, way), np.zeros(cruise), np.full(ramp, -way)]
    return np.concatenate(parts)


@pytest.mark.parametrize("rate", [50, 125, 500])
def test_the_error_beside_a_jump_is_estimated(rate):
    run, v, a, at = record(trapezoids(), rate)
    k = kinematics(run, at, choose_smoothing([run]), details=True)
    moves = ~k.rest[:, 0]
    for wrong, estimate in ((k.a[:, 0] - a, k.jumps[:, 1]), (k.v[:, 0] - v, k.jumps[:, 0])):
        true, stated = (float(np.sqrt(np.mean(x[moves] ** 2))) for x in (wrong, estimate))
        assert 0.6 < stated / true < 1.7
    # elsewhere it is noise
    beside = k.jumps[:, 1] != 0
    assert np.sqrt(np.mean((k.a[:, 0] - a)[moves & ~beside] ** 2)) < 0.2 * np.sqrt(
        np.mean((k.a[:, 0] - a)[beside] ** 2)
    )


@pytest.mark.parametrize("rate", [50, 500])
def test_smooth_motion_has_hardly_any(rate):
    t = np.arange(0, 8, 1e-4)
    run, _, a, at = record(2 * np.sin(2 * np.pi * 0.4 * t) + np.cos(2 * np.pi * 0.7 * t), rate)
    k = kinematics(run, at, choose_smoothing([run]), details=True)
    assert np.sqrt(np.mean(k.jumps[:, 1] ** 2)) < 0.03 * np.std(a)


def test_logged_accelerations_have_none():
    run, _, _, at = record(trapezoids(), 125)
    logged = Run(
        "",
        "motion",
        0.0,
        run.time,
        run.position,
        None,
        np.zeros_like(run.position),
        None,
        None,
        np.zeros(0),
        np.zeros(0),
    )
    smoothing = choose_smoothing([run])
    assert not kinematics(logged, at, smoothing, details=True).jumps.any()
    assert not kinematics(run, at, smoothing).jumps.any()
