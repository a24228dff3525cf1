"""Slow meters in files of their own: whether they show means or the power at their stamps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden import COPPER, STANDBY, Hidden
from logs import Z1, arm, lines, log, put

from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.measured import read_set
from energy_opt.tables import write_table


@pytest.mark.parametrize("interval", [0.1, 0.15, 0.2])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("means", [True, False])
def test_means_are_told_from_the_power_at_the_stamps(tmp_path, interval, seed, means):
    """Means over 0.1 s were "the power at its stamps, which fits the motion better"."""
    arm, rng, rows = Hidden("ur5e"), np.random.default_rng(seed), []
    for k in range(3):
        t, q, v, a = arm.motion(rng, 3, 1.0)
        torque = arm.torque(q, v, a) + 0.5 * np.sign(v)
        power = STANDBY + (torque * v).sum(axis=1) + COPPER * (torque**2).sum(axis=1) + 0.5 * rng.normal(size=len(t))
        total = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(t))])
        stamps = np.arange(interval, t[-1], interval)
        shown = np.interp(stamps, t, power)
        if means:
            shown = (np.interp(stamps, t, total) - np.interp(stamps - interval, t, total)) / interval
        write_table(tmp_path / f"{k}.csv", ["time", *(f"{j}.position" for j in arm.joints)], [t, *q.T])
        write_table(tmp_path / f"{k}_power.csv", ["time", "power"], [stamps, shown])
        rows.append(f'[[run]]\nfile = "{k}.csv"\npower_file = "{k}_power.csv"\n')
    (tmp_path / "log.toml").write_text('format = "energy-opt/log/1"\nrobot = "ur5e"\n' + "".join(rows))
    found = read_set(tmp_path)
    assert all(np.allclose(run.window, interval if means else 0.0) for run in found.runs)
    assert any("which fits the motion better" in remark for remark in found.remarks)


def test_a_clock_found_by_correlation_is_known_to_a_tenth_of_the_time_between_readings(tmp_path):
    """A meter of 1 Hz whose clock was found 20 ms wrong had a "filter" of 17 ms, as a cause."""
    t, q, _, p = arm(Z1, 30.0)
    at = np.arange(1.0, 30.0)
    put(tmp_path / "a.csv", lines("time," + ",".join(f"{j}.position" for j in Z1.joints), [t, q]))
    put(tmp_path / "p.csv", lines("time,power", [at, np.interp(at, t, p)]))
    measured = read_set(log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\npower_file = "p.csv"\n[meter]\nwindow = 0\n'))
    found = replace(measured, runs=tuple(replace(run, clock="estimated") for run in measured.runs))
    assert take_samples(measured).lag < 0.05 and take_samples(found).lag == pytest.approx(0.1)


@pytest.mark.parametrize("lost", ["", "some", "most"])
def test_a_fast_meter_may_lose_readings(tmp_path, lost):
    """Bins of 100 readings, of which three were lost, counted as gaps: no reading was left, or a division by zero."""
    t, q, _, p = arm(Z1, 4.0)
    own = np.arange(1, 40000) * 1e-4
    part = {"": own >= 0, "some": np.random.default_rng(0).random(len(own)) > 0.05, "most": own * 10 % 1 < 0.1}[lost]
    own = own[part & ((own < 1) | (own > 1.5))]  # and a gap
    put(tmp_path / "a.csv", lines("time," + ",".join(f"{j}.position" for j in Z1.joints), [t, q]))
    put(tmp_path / "p.csv", lines("time,power", [own, np.interp(own, t, p)]))
    rest = '[[run]]\nfile = "a.csv"\npower_file = "p.csv"\npower_start = 0.0001\n[meter]\nwindow = 0\n'
    at = take_samples(read_set(log(tmp_path, "z1", rest))).at
    assert len(at) > 0.85 * len(own) / 300 and not np.any((at > 1.05) & (at < 1.45))
