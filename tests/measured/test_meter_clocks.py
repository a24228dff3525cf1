"""Clocks of meters in files of their own, of sets with many short runs: the runs decide together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hidden import COPPER, STANDBY, Hidden

from energy_opt.measured import inspect_set, read_set
from energy_opt.numerics.stamps import stamp_factor
from energy_opt.tables import write_table

DAY = 1.7e9  # [s] since 1970


def short_runs(count: int, seed: int) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Times, positions and powers of single moves of a UR5e with friction."""
    arm, rng, out = Hidden("ur5e"), np.random.default_rng(seed), []
    for _ in range(count):
        t, q, v, a = arm.motion(rng, 2, 1.0)
        torque = arm.torque(q, v, a) + 3 * np.sign(v) + 2 * v
        out.append((t, q, STANDBY + np.maximum((torque * v).sum(axis=1), 0) + COPPER * (torque**2).sum(axis=1)))
    return out


def written(folder: Path, number: int, time: np.ndarray, q: np.ndarray, meter: str) -> str:
    """Write a run's joints, and return its lines of the log."""
    names = [f"{joint}.position" for joint in Hidden("ur5e").joints]
    write_table(folder / f"{number}.csv", ["time", *names], [time, *q.T])
    return f'[[run]]\nfile = "{number}.csv"\npower_file = "{meter}"\n'


@pytest.mark.parametrize("ahead", [0.0, 0.8])
def test_a_dated_meter_of_a_whole_session_has_one_offset(tmp_path: Path, ahead: float) -> None:
    """Runs were moved onto other motions of the session, one by one, by up to a minute."""
    begin, log, stamps, drawn = 5.0, "", [np.zeros(0)], [np.zeros(0)]
    for k, (t, q, power) in enumerate(short_runs(10, 3)):
        log += written(tmp_path, k, DAY + begin + t, q, "meter.csv")
        stamps.append(begin + t)
        drawn.append(power)
        begin += float(t[-1]) + 4.0
    at = np.arange(1.0, begin, 0.05)
    shown = np.interp(at, np.concatenate(stamps), np.concatenate(drawn))
    shown += np.random.default_rng(1).normal(0, 0.5, len(at))
    write_table(tmp_path / "meter.csv", ["time", "power"], [DAY + at + ahead, shown])
    (tmp_path / "log.toml").write_text('format = "energy-opt/log/1"\nrobot = "ur5e"\n' + log + "[meter]\nwindow = 0\n")
    runs = read_set(tmp_path).runs
    assert {run.clock for run in runs} == {"estimated" if ahead else "shared"}
    for (t, _, power), run in zip(short_runs(10, 3), runs, strict=True):
        np.testing.assert_allclose(run.power, np.interp(run.power_time, t, power), atol=10)


@pytest.mark.parametrize("lead", [(0.0, 0.0), (2.0, 9.0)])
def test_short_runs_whose_meters_have_clocks_of_their_own_decide_together(
    tmp_path: Path, lead: tuple[float, float]
) -> None:
    """The clocks of most runs were taken for those of the joints, without a word."""
    rng, log, truth = np.random.default_rng(5), "", []
    runs = short_runs(10, 4)
    for k, (t, q, power) in enumerate(runs):
        before = rng.uniform(*lead)
        at = np.arange(0.0, t[-1] + before + 2, 0.02)
        shown = np.interp(at - before, t, power) + rng.normal(0, 0.5, len(at))
        write_table(tmp_path / f"p{k}.csv", ["time", "power"], [at, shown])
        log += written(tmp_path, k, t, q, f"p{k}.csv")
        truth.append(before)
    (tmp_path / "log.toml").write_text('format = "energy-opt/log/1"\nrobot = "ur5e"\n' + log + "[meter]\nwindow = 0\n")
    found = read_set(tmp_path).runs
    used = [(run, before, one) for run, before, one in zip(found, truth, runs, strict=True) if len(run.power)]
    left_out = [remark for remark in inspect_set(tmp_path)[1] if "readings are left out" in remark]
    assert len(used) >= 6 and bool(left_out) == (len(used) < len(runs))
    for run, before, (t, _, power) in used:
        assert run.clock == ("estimated" if before else "shared")
        np.testing.assert_allclose(run.power, np.interp(run.power_time, t, power), atol=40)
        assert np.abs(run.power - np.interp(run.power_time, t, power)).mean() < 0.1 * np.ptp(power)


def test_a_meters_clock_is_found_though_the_joints_recording_was_paused(tmp_path: Path) -> None:
    """The arm moved on in the pauses, under the meter alone."""
    recorded, begin, stamps, drawn, ahead = [], 0.0, [np.zeros(0)], [np.zeros(0)], 2.5
    for k, (t, q, power) in enumerate(short_runs(12, 4)):
        stamps.append(begin + t)
        drawn.append(power)
        recorded += [(begin + t, q)] if k % 5 == 0 else []
        begin += float(t[-1]) + 1.0
    at = np.arange(0.0, begin, 0.05)
    true = np.interp(at, np.concatenate(stamps), np.concatenate(drawn))
    write_table(tmp_path / "meter.csv", ["time", "power"], [at + ahead, true])
    log = written(tmp_path, 0, *(np.concatenate(x) for x in zip(*recorded, strict=True)), "meter.csv")
    (tmp_path / "log.toml").write_text('format = "energy-opt/log/1"\nrobot = "ur5e"\n' + log + "[meter]\nwindow = 0\n")
    runs = read_set(tmp_path).runs
    assert len(runs) == 3 and {run.clock for run in runs} == {"estimated"}
    for run in runs:
        np.testing.assert_allclose(run.power, np.interp(run.start + run.power_time, at, true), atol=10)


def test_a_meter_that_runs_much_longer_than_the_motion_counts_seconds() -> None:
    """400 s beside a motion of 3.9 s were milliseconds, with 10,000 readings a second."""
    assert stamp_factor(np.arange(0, 400, 0.1), "power.time", span=3.9) == 1.0
    assert stamp_factor(np.arange(0.0, 4000, 20), "power.time", span=3.9) == 1e-3
