"""What a law's effect depends on beside the motion: the set's other runs, the form of the law, numbers with steps."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.hypothesis import Term
from energy_opt.diagnosis.predict import predict
from energy_opt.diagnosis.recordings import take_samples
from energy_opt.diagnosis.search import without
from energy_opt.effects import IdleHold, WindingSelfHeating
from energy_opt.measured import read_set
from energy_opt.virtual_arm.simulate import Instruments

pytest.importorskip("mujoco")
from misfit_world import World, write_world
from virtual_sets import make_set


def test_a_declared_effect_that_is_not_refitted_stays_for_those_that_need_it():
    """Copper loss with its declared values is what a winding's temperature needs."""
    terms = [Term("copper_loss", declared=True), Term("winding_temperature")]
    f = SimpleNamespace(charts=[SimpleNamespace(term=t) for t in terms], numbers=[1, 2], free=(), nuisance=0, amounts=0)
    found = SimpleNamespace(fitted=lambda charts, *rest: [c.term.name for c in charts])
    assert without(found, f, 0) == ["winding_temperature"]
    f.charts[0].term = Term("copper_loss")
    assert without(found, f, 0) == []


def test_windings_are_as_warm_as_the_whole_set_made_them(tmp_path):
    """Some of the runs alone foresee the same power as within their set; so do temperatures relative to it."""
    truth = write_world(World("z1", 5, motions=3, poses=1), tmp_path)
    samples, _ = take_samples(read_set(truth.folder))
    warming = np.linspace(20, 30, len(samples.t))[:, None] + np.zeros(samples.n)
    samples = replace(samples, temperature=warming)
    model = truth.declared.replaced(WindingSelfHeating(rate=0.2, time_constant=60.0))
    whole = predict(model, samples)
    for runs in ([1, 3], [0, 2]):
        part, rows = samples.part(runs), np.concatenate([np.arange(samples.t.size)[samples.slices[r]] for r in runs])
        assert np.allclose(part.warmth, samples.warmth[rows])
        assert np.allclose(predict(model, part).power, whole.power[rows], rtol=1e-9)
    assert np.ptp(whole.power - predict(truth.declared, samples).power) > 0.01


def test_heat_that_grows_faster_than_the_square_of_torque_is_no_copper_loss(tmp_path):
    """A saturated motor's: a larger resistance explains nine tenths of it."""
    truth = write_world(World("xarm7", 300007, (0.0, 0.05), "ar1", unlisted="saturation"), tmp_path)
    assert not diagnose(read_set(truth.folder), truth.declared).effects


def test_of_durations_that_no_dwell_tells_apart_the_middle_one_is_taken(tmp_path):
    """A hold of 0.8 s where dwells last up to 0.61 s: 0.6 s leaves the last readings of a dwell unexplained."""
    made = make_set(
        tmp_path / "set", "ur5", [IdleHold(power=8.0, duration=0.8)], seed=3,
        instruments=Instruments(noise=0.6, power_resolution=0.05),
    )  # fmt: skip
    found = diagnose(read_set(made.folder), made.declared)
    assert (found.verdict, [x.name for x in found.effects]) == ("explained", ["idle_hold"])
