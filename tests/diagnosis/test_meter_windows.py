"""A meter that shows means is named as such, and not as a filter with a delay, which imitate it to second order."""

from __future__ import annotations

import numpy as np
import pytest
from hidden import COPPER, STANDBY, STEP, Hidden, record

from energy_opt.diagnosis import diagnose
from energy_opt.effects import CopperLoss, Standby
from energy_opt.measured import read_set
from energy_opt.power import PowerModel


def over(seconds):
    """A meter that shows the mean of the last `seconds`, of a power that is linear between samples."""
    count = round(seconds / STEP)
    weights = np.concatenate([[0.5], np.ones(count - 1), [0.5]]) / count
    return lambda power: np.convolve(np.concatenate([np.full(count, power[0]), power]), weights, "valid")


@pytest.mark.parametrize(("name", "seed"), [("ur5e", 1), ("panda", 2)])
def test_a_moving_mean_is_named(tmp_path, name, seed):
    """ "explained" was: meter_filter of 0.057 s with meter_delay of 0.04 s, both with narrow intervals."""
    measured = read_set(record(tmp_path / "set", Hidden(name), over(0.2), seed=seed))
    declared = PowerModel(name, (Standby(power=STANDBY), CopperLoss(r_over_kt2=COPPER)))
    found = diagnose(measured, declared).document()
    assert found["verdict"] == "explained"
    (row,) = found["effects"]
    low, high = np.ravel(row["ci95"]["duration"])
    assert row["name"] == "meter_window" and low <= 0.2 <= high


@pytest.mark.slow
def test_a_declared_window_is_applied_and_never_claimed(tmp_path):
    """Beside a declared window of half the size, another one was claimed."""
    folder = record(tmp_path / "set", Hidden("ur5e"), over(0.4), seed=1)
    with (folder / "log.toml").open("a") as log:
        log.write("\n[meter]\nwindow = 0.2\n")
    declared = PowerModel("ur5e", (Standby(power=STANDBY), CopperLoss(r_over_kt2=COPPER)))
    found = diagnose(read_set(folder), declared).document()
    named = {row["name"] for row in found["effects"]}.union(*map(set, found["alternatives"]))
    assert "meter_window" not in named
