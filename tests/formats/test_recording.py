"""Noise of a recording and rounding of close waypoints are no part of a path."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from energy_opt.formats import read
from energy_opt.formats.close_waypoints import past
from energy_opt.formats.recording import motion_of
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
    time = np.linspace(0, 20, 501)
    u = (time / 20)[:, None]
    q = spiral(2)[0] + 0.5 * u**3 * (10 - 15 * u + 6 * u**2)
    for digits in (6, 16):
        samples = Samples("plan.csv", ur.joints, np.round(q, digits), time)
        t, notes = motion_of(samples)
        assert not notes and np.array_equal(t.position, np.round(q, digits))


TURNED = np.array([0.9, -0.5, 0.6, -0.4, 0.3, -0.8])


def moved(time: np.ndarray, rest: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities and accelerations (N, 6) of a move of 1.5 s that begins after `rest` s."""
    u = np.clip((time - rest) / 1.5, 0, 1)[:, None]
    q = u**3 * (10 - 15 * u + 6 * u**2)
    v, a = 30 * u**2 * (1 - u) ** 2 / 1.5, 60 * u * (1 - u) * (1 - 2 * u) / 1.5**2
    return spiral(2)[0] + q * TURNED, v * TURNED, a * TURNED


def recorded(kind: str, rate: int, noise: np.random.Generator) -> tuple[Samples, float]:
    """A move as recorders write it, and the time at which it begins."""
    rest = 1.0 if kind == "rests" else 0.0
    time = np.arange(0, 1.5 + 2 * rest + 1e-9, 1 / rate)
    q, v, a = moved(time, rest)
    joints = load_robot("ur5e").joints
    if kind == "held":  # by a recorder that is faster than its source of 25 Hz
        return Samples("", joints, moved(np.floor(time * 25 + 1e-6) / 25)[0], time), rest
    if kind == "wrapped":
        q += np.pi - moved(np.array([0.8]))[0]  # every joint passes pi
        return Samples("", joints, (q + np.pi) % (2 * np.pi) - np.pi, time, v), rest
    if kind == "coarse":  # an encoder of 12 bits
        return Samples("", joints, np.round(q / (np.pi / 2048)) * (np.pi / 2048), time), rest
    if kind.startswith("rounded"):
        accelerations = np.round(a, 4) if kind == "rounded, all" else None
        return Samples("", joints, np.round(q, 4), time, np.round(v, 4), accelerations), rest
    if kind == "late":  # velocities pass a filter
        return Samples("", joints, q, time, moved(time - 0.02)[1]), rest
    if kind == "zeros":  # a planner that does not know its accelerations
        return Samples("", joints, q, time, v, 0 * a), rest
    if kind == "lost":
        q[len(q) // 3] = 0
        q[len(q) // 2, 2] += 0.7
        return Samples("", joints, q, time), rest
    rates = v + 5e-3 * noise.normal(size=v.shape) if kind == "noisy rates" else None
    return Samples("", joints, q + 1e-4 * noise.normal(size=q.shape), time, rates), rest


@pytest.mark.parametrize("rate", [125, 500, 1000])
@pytest.mark.parametrize(
    "kind", ["held", "rounded", "rounded, all", "rests", "wrapped", "noise", "noisy rates", "late", "zeros", "lost"]
)
def test_artefacts_of_recorders_are_no_accelerations(kind: str, rate: int) -> None:
    """They had been read as accelerations of up to 1e9 rad/s^2, or as speeds at the ends, which no timing can keep."""
    for seed in range(3):
        samples, rest = recorded(kind, rate, np.random.default_rng(seed))
        t, _ = motion_of(samples)
        found, true = t.sample_denser(5)[2], moved(t.denser(5), rest)[2]
        assert np.sqrt(np.mean((found - true) ** 2)) < 0.3 * np.sqrt(np.mean(true**2))
        assert np.abs(t.velocity[[0, -1]]).max() < 1e-3


def test_a_recording_cut_out_of_a_motion_begins_and_ends_in_it() -> None:
    noise, time = np.random.default_rng(1), np.arange(0.3, 1.2, 0.002)
    q, v, _ = moved(time)
    noisy = q + 1e-4 * noise.normal(size=q.shape)
    for rates in (None, v + 5e-3 * noise.normal(size=v.shape)):
        t, notes = motion_of(Samples("", load_robot("ur5e").joints, noisy, time, rates))
        assert any("smoothed" in note for note in notes)
        np.testing.assert_allclose(t.velocity[[0, -1]], v[[0, -1]], atol=0.1)


@pytest.mark.parametrize("step", [0.02, 1.0])
def test_a_turn_that_takes_a_second_is_no_wrap(step: float) -> None:
    time = np.arange(10) * step
    q = np.where(np.arange(10) < 5, 0.0, 2 * np.pi)[:, None] * np.ones(6)
    t, notes = motion_of(Samples("log.csv", load_robot("ur5e").joints, q, time))
    assert np.ptp(t.position) == pytest.approx(0.0 if step < 0.1 else 2 * np.pi, abs=1e-9)
    assert any("jumps by a turn" in note for note in notes) == (step < 0.1)


@pytest.mark.parametrize("digits", [4, 5])
def test_a_plan_with_rounded_positions_takes_no_more_energy(digits: int) -> None:
    """At 1 kHz, four digits beside exact velocities meant accelerations of 100 rad/s^2 between the points."""
    time = np.arange(0, 1.5 + 1e-9, 0.001)
    q, v, a = moved(time)
    t, notes = motion_of(Samples("", load_robot("ur5e").joints, np.round(q, digits), time, v, a, planned=True))
    assert any("contradict" in note for note in notes) and np.abs(t.velocity[[0, -1]]).max() < 1e-12
    np.testing.assert_allclose(t.sample_denser(5)[2], moved(t.denser(5))[2], atol=0.8)


def test_an_exact_trajectory_with_a_resting_joint_is_taken_as_it_is() -> None:
    time = np.arange(0, 1.5 + 1e-9, 0.001)
    q, v, a = moved(time)
    v[:, 3], a[:, 3] = 0.0, 0.0
    q[:, 3] = 0.3 + 1e-12 * np.arange(len(time)) % 7
    t, notes = motion_of(Samples("", load_robot("ur5e").joints, q, time, v, a))
    assert not notes and np.array_equal(t.acceleration, a)


def test_a_point_that_is_given_twice_counts_once(ur: Robot, tmp_path: Path) -> None:
    """Planners that repeat the last point were refused: its time does not come after the one before."""
    point = {"positions": [0.0] * 6, "time_from_start": {"sec": 0, "nanosec": 0}}
    last = {"positions": [0.1] * 6, "time_from_start": {"sec": 2, "nanosec": 0}}
    document = {"joint_names": list(ur.joints), "points": [point, point, last, last]}
    (tmp_path / "plan.json").write_text(json.dumps(document))
    header = ",".join(["time", *ur.joints])
    rows = np.array([[0.0, *[0.0] * 6], [2.0, *[0.1] * 6], [2.0, *[0.1] * 6]])
    np.savetxt(tmp_path / "plan.csv", rows, delimiter=",", header=header, comments="")
    for name in ("plan.json", "plan.csv"):
        assert read(tmp_path / name).time == pytest.approx([0.0, 2.0])


@pytest.mark.parametrize("kind", ["late", "twice", "coarse"])
def test_a_recorder_may_repeat_a_stamp(kind: str, ur: Robot, tmp_path: Path) -> None:
    """Such recordings were refused, though `import` reads them."""
    time = np.arange(0, 2.0, 0.002)
    q = moved(time, 0.2)[0]
    stamps, rows = time.copy(), np.arange(len(time))
    some = 5 + 10 * np.random.default_rng(2).choice(95, 40, replace=False)
    if kind == "late":
        stamps[some] = stamps[some - 1]
    elif kind == "twice":  # two rows in one tick of 2 ms
        rows = np.sort(np.concatenate([rows, some]))
        q = q[rows] + 1e-6 * np.concatenate([[0], np.diff(rows) == 0])[:, None]
    else:
        stamps = np.round(time, 2)
    header = ",".join(["time", *ur.joints])
    np.savetxt(tmp_path / "run.csv", np.c_[stamps[rows], q], delimiter=",", header=header, comments="", fmt="%.9f")
    samples = read(tmp_path / "run.csv")
    assert any("stamp" in note for note in samples.notes)
    t, _ = motion_of(samples)
    np.testing.assert_allclose(t(t.time, 1), moved(t.time, 0.2)[1], atol=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_encoder_steps_at_the_ends_of_a_recording_are_no_speed(seed: int) -> None:
    """A move played on the virtual arm, with 0.3 s at rest before and after it, was infeasible as --path."""
    time = np.arange(0, 1.8 + 1e-9, 0.008)
    u = np.clip((time - 0.3) / 1.2, 0, 1)[:, None]
    q = spiral(2)[0] + TURNED * np.where(u < 0.5, 2 * u**2, 1 - 2 * (1 - u) ** 2)
    q = np.round((q + 1e-5 * np.random.default_rng(seed).normal(size=q.shape)) / 2e-5) * 2e-5
    t, notes = motion_of(Samples("", load_robot("ur5e").joints, q, time))
    assert np.abs(t.velocity[[0, -1]]).max() < 1e-12
    assert any("at rest for 0.6" in note for note in notes)
