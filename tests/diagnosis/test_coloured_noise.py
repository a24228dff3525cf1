"""A meter whose noise is a wave alone, without a white part, as of one that averages: no structure is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden import COPPER, STANDBY, Hidden, record

from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.diagnosis.data.standing import standing_noise
from energy_opt.effects import CopperLoss, Standby
from energy_opt.measured import read_set
from energy_opt.power import PowerModel


@pytest.mark.parametrize(("memory", "eta", "verdict"), [(0.3, 1.0, "nothing_missing"), (1.0, 1.0, "nothing_missing"),
                                                       (1.0, 0.88, "ambiguous")])  # fmt: skip
def test_a_wave_alone_is_noise(tmp_path, memory, eta, verdict):
    """Clean sets were "unexplained"; a loss of the supply is still found."""
    folder = record(tmp_path / "set", Hidden("panda"), lambda p: p / eta, memory=memory, seed=4)
    declared = PowerModel("panda", (Standby(power=STANDBY), CopperLoss(r_over_kt2=COPPER)))
    found = diagnose(read_set(folder), declared).document
    assert found["verdict"] == verdict
    named = {row["name"]: row for row in found["effects"]}
    if eta < 1:
        low, high = np.ravel(next(iter(next(iter(named.values()))["ci95"].values())))
        assert low <= (eta if "supply_efficiency" in named else 1 / eta) <= high
    else:
        assert not named


def test_short_standstills_show_the_noise(tmp_path):
    """Rests of 0.25 s have too few means of readings: noise with memory was guessed from neighbours, three times too
    small, and every long recording was "unexplained".
    """
    folder = record(tmp_path / "set", Hidden("panda"), rest=0.25, noise=0.6, memory=0.3, seed=5)
    measured = read_set(folder)
    brief = measured.runs[0]  # and one run has fewer readings than a mean
    brief = replace(brief, power_time=brief.power_time[:2], power=brief.power[:2], window=brief.window[:2])
    plausible, largest = standing_noise(take_samples(replace(measured, runs=(brief, *measured.runs[1:]))))
    sizes = [np.hypot(noise.white, noise.wave) for _, noise in plausible]
    assert min(sizes) < 0.6 < np.hypot(largest.white, largest.wave) < 1.2
