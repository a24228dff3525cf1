"""A meter that stops at a limit is no cause: its readings there are left out, and the user is told."""

from __future__ import annotations

import numpy as np
import pytest
from hidden import COPPER, STANDBY, Hidden, record

from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.data.clipped import unclipped
from energy_opt.diagnosis.data.jumps import known_by
from energy_opt.diagnosis.data.noise import Noise
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.diagnosis.evidence.errors import quality
from energy_opt.effects import CopperLoss, Standby
from energy_opt.measured import read_set
from energy_opt.power import PowerModel

DECLARED = PowerModel("ur5e", (Standby(power=STANDBY), CopperLoss(r_over_kt2=COPPER)))


def clipped(folder, limit):
    """A set whose meter stops at `limit` [W] before its noise is added."""
    return read_set(record(folder, Hidden("ur5e"), lambda power: np.minimum(power, limit)))


@pytest.mark.parametrize("limit", [140.0, np.inf])
def test_readings_at_a_limit_are_left_out(tmp_path, limit):
    measured = clipped(tmp_path / "set", limit)
    kept = unclipped(measured, take_samples(measured), DECLARED)
    assert any("Readings stop at 140" in said for said in kept.remarks) == np.isfinite(limit)
    assert (kept is measured) == np.isinf(limit) and max(run.power.max() for run in kept.runs) < limit


@pytest.mark.slow
def test_a_limit_of_the_meter_is_no_law(tmp_path):
    """The rest was said to depend on power, by no known law."""
    found = diagnose(clipped(tmp_path / "set", 140.0), DECLARED)
    assert found.verdict == "nothing_missing" and found.document()["usable"]


def test_the_error_at_rest_is_that_of_the_readings(tmp_path):
    """A remark subtracted a drift of the meter, which a function that the model lacks had left to the fit."""
    samples, _ = known_by(DECLARED, take_samples(read_set(record(tmp_path / "set", Hidden("ur5e"), runs=2))), [1, 1])
    found = quality(DECLARED, samples, Noise(0.5), np.full(2, 3.0))
    assert found.rest > 2.5 and found.whole == pytest.approx((0.5, 0.5), abs=0.15)
