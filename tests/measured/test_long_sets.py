"""Diagnosis of more readings than a fit asks for: what is averaged, what is left out, and what it takes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bounds import measured as recorded
from bounds import taken
from machine import allowed
from virtual_sets import make_set

from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.data import recordings
from energy_opt.diagnosis.data.noise import weighted
from energy_opt.diagnosis.data.predict import predict
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.effects import CoulombFriction, Payload, Standby
from energy_opt.measured import read_set
from energy_opt.power import PowerModel
from energy_opt.virtual_arm.simulate import Instruments

FRICTION = CoulombFriction(tau_c=[0.6, 0.5, 0.45, 0.5, 0.3, 0.25, 0.2])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    pytest.importorskip("mujoco")
    instruments = Instruments(noise=0.6, power_resolution=0.05)
    return make_set(tmp_path_factory.mktemp("c") / "set", "panda", [FRICTION], seed=1, instruments=instruments)


@pytest.fixture(scope="module")
def whole(made):
    return read_set(made.folder)


def test_averaged_readings_name_the_same_cause(made, whole, monkeypatch):
    """Three neighbours a reading: friction is found at the values with which the arm was moved, and said to be so."""
    monkeypatch.setattr(recordings, "MOST_READINGS", 700)
    d = diagnose(whole, made.declared).document()
    assert d["verdict"] == "explained" and [row["name"] for row in d["effects"]] == ["coulomb_friction"]
    low, high = np.array(d["effects"][0]["ci95"]["tau_c"]).T
    true, slack = FRICTION.values["tau_c"], (high - low) / 4
    assert ((low - slack <= true) & (true <= high + slack)).all()
    assert d["error"]["after"]["holdout"]["power_rmse"] < 1.1 * d["error"]["noise_floor"]
    assert any("neighbouring readings are averaged to one" in remark for remark in d["remarks"])


def test_what_averaged_readings_show_is_the_mean_of_what_the_readings_show(made, whole, monkeypatch):
    fine = take_samples(whole)
    monkeypatch.setattr(recordings, "MOST_READINGS", -(-len(fine.power) // 3))
    coarse = take_samples(whole)
    assert coarse.group == 3 and coarse.noise == pytest.approx(fine.noise / 3**0.5)
    shown = [predict(made.declared, s).reading for s in (fine, coarse)]
    steady = PowerModel("panda", (Standby(power=90.0),))
    known = [weighted(s, predict(steady, s), [1] * len(s.parts)) for s in (fine, coarse)]
    weights, surely = [s.weight for s in known], ~known[1].doubted
    for a, b in zip(fine.parts, coarse.parts, strict=True):
        count = (a.stop - a.start) // 3

        def mean(x, a=a, count=count):
            return x[a][: 3 * count].reshape(count, 3).mean(axis=1)

        assert coarse.power[b] == pytest.approx(mean(fine.power)) and coarse.at[b] == pytest.approx(mean(fine.at))
        assert shown[1][b] == pytest.approx(mean(shown[0]))
        sure = surely[b]  # elsewhere single readings show a jump of the power, which counts
        assert sure.mean() > 0.8
        assert weights[1][b][sure] ** -2 == pytest.approx(
            mean(weights[0] ** -2)[sure]
        )  # variances of independent readings


def test_pieces_of_the_nodes_give_what_all_at_once_do(made, whole, monkeypatch):
    model = made.declared.replaced(Payload(mass=1.2, com=[0.02, 0.0, 0.05]))
    once = take_samples(whole)
    one = predict(model, once)
    monkeypatch.setattr("energy_opt.diagnosis.data.samples.PIECE", 100)
    monkeypatch.setattr("energy_opt.diagnosis.data.predict.AT_ONCE", 64)
    pieces = predict(model, replace(once))
    assert np.allclose(pieces.reading, one.reading, rtol=1e-12)
    assert np.allclose(pieces.jacobian, one.jacobian, rtol=1e-9, atol=1e-12)


def test_of_too_many_runs_some_are_left_out_evenly_and_long_ones_are_cut(whole, monkeypatch):
    nodes = sum(len(run.power) // recordings.per_bin(run) for run in whole.runs)
    assert recordings.shortened(whole) is whole
    many = replace(whole, runs=whole.runs * 6)
    monkeypatch.setattr(recordings, "MOST_NODES", 2 * nodes)
    less = recordings.shortened(many)
    assert len(less.runs) == len(many.runs) // 3 and "runs, spread evenly, are used" in less.remarks[-1]
    few = whole.runs[:6]
    monkeypatch.setattr(recordings, "MOST_NODES", sum(len(run.power) // recordings.per_bin(run) for run in few) // 2)
    cut = recordings.shortened(replace(whole, runs=few))
    for run, of in zip(cut.runs, whole.runs, strict=False):
        assert 0 < len(run.power) < len(of.power) and len(run.time) == len(run.position) < len(of.time)
        assert (run.power == of.power[: len(run.power)]).all()


@pytest.mark.nightly
def test_memory_of_a_diagnosis_is_bounded(tmp_path):
    """As many readings as are fitted without averaging, five minutes at 1 kHz, where it takes most (0.9 GB here)."""
    folder = recorded(tmp_path, 299_000)
    seconds, memory, code = taken(["diagnose", str(folder), "--quiet"], tmp_path)
    assert code == 0 and memory < 1600 and seconds < allowed(240)
