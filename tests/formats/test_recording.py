"""Noise of a recording and rounding of close waypoints are no part of a path."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from energy_opt.formats.recording import past
from energy_opt.formats.waypoints import Samples
from energy_opt.front.moves import path_from
from energy_opt.motion.path import through
from energy_opt.motion.timing.toppra import fastest
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot


@pytest.fixture(scope="module")
def ur() -> Robot:
    return load_robot("ur5e")


def spiral(count: int) -> np.ndarray:
    """Waypoints (count, 6) [rad] of a smooth curve, as a scan of a tool's path gives them."""
    t = np.linspace(0.0, 1.0, count)[:, None]
    waves = np.hstack([0.5 * np.sin(6 * np.pi * t), 0.2 * np.cos(4 * t), 0.2 * t, 0.1 * np.sin(9 * t), 0 * t, t])
    return np.array([0, -1.2, 1.4, -1.2, -1.5, 0]) + waves


def test_close_waypoints_are_passed_within_their_rounding(ur: Robot) -> None:
    """A path through 2,000 waypoints of three digits took 25 times as long as the one of all digits."""
    exact, heard = spiral(2000), list[str]()
    rounded = np.round(exact, 3)
    path = path_from(rounded, ur, say=heard.append)
    assert len(heard) == 1 and "rounded to 0.001" in heard[0]
    assert np.array_equal(path.start, rounded[0]) and path.goal == pytest.approx(rounded[-1], abs=1e-12)
    places = path(np.linspace(0, 1, 20001))
    assert max(np.abs(places - q).max(axis=1).min() for q in rounded[::7]) < 1e-3
    shortest = [fastest(ur, source_method_2(ur), each).duration for each in (path, through(exact))]
    assert shortest[0] == pytest.approx(shortest[1], rel=0.1)


@pytest.mark.parametrize("waypoints", [spiral(2000), np.round(spiral(30), 3), np.round(spiral(200), 1)[::10]])
def test_other_waypoints_are_passed_exactly(waypoints: np.ndarray) -> None:
    path, notes = past(waypoints, "--path")
    assert not notes and np.array_equal(path.coefficients, through(waypoints).coefficients)


def test_a_recording_from_rest_to_rest_is_a_path_from_rest_to_rest(ur: Robot, tmp_path: Path) -> None:
    """Noise at rest looked like a speed at the ends, which no timing could reach within the limits."""
    time = np.arange(0, 2.0, 0.008)
    u = np.clip((time - 0.4) / 1.2, 0, 1)[:, None]
    goal = np.array([0.6, -1.0, 1.1, -1.0, -1.5, 0.4])
    q = spiral(2)[0] + (goal - spiral(2)[0]) * u**3 * (10 - 15 * u + 6 * u**2)
    q += np.random.default_rng(5).normal(0, 3e-5, q.shape)
    header = ",".join(["time", *(f"{joint}.position" for joint in ur.joints)])
    np.savetxt(tmp_path / "run.csv", np.column_stack([time, q]), delimiter=",", header=header, comments="")
    heard = list[str]()
    path = path_from(tmp_path / "run.csv", ur, say=heard.append)
    assert path.start_speed == path.end_speed == 0 and any("is at rest" in note for note in heard)
    assert np.abs(path.start - spiral(2)[0]).max() < 5e-5
    straight = fastest(ur, source_method_2(ur), through(np.stack([path.start, path.goal]))).duration
    assert fastest(ur, source_method_2(ur), path).duration == pytest.approx(straight, rel=0.1)


def test_a_plan_without_accelerations_is_taken_as_it_is(ur: Robot) -> None:
    from energy_opt.formats.recording import motion_of

    time = np.linspace(0, 20, 501)
    u = (time / 20)[:, None]
    q = spiral(2)[0] + 0.5 * u**3 * (10 - 15 * u + 6 * u**2)
    for digits in (6, 16):
        samples = Samples("plan.csv", ur.joints, np.round(q, digits), time)
        t, notes = motion_of(samples)
        assert not notes and np.array_equal(t.position, np.round(q, digits))
