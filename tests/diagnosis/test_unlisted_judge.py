"""The examination of diagnose: a document that contradicts itself is found, and an honest one is not."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from energy_opt.effects import CopperLoss, CoulombFriction, Standby
from energy_opt.files import write_json
from energy_opt.power import PowerModel

pytest.importorskip("mujoco")
from misfit_drives import ARMS
from misfit_world import World, write_world
from unlisted import lines, lower, upper
from unlisted_judge import contradictions, difference_error, energy_error, foreseen, held_out
from unlisted_law import Limits, Part
from unlisted_laws import KINDS


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    world = World("z1", 31, (0.0, 0.0), cause="coulomb_friction", motions=3, poses=2)
    return write_world(world, tmp_path_factory.mktemp("world") / "set")


def model_of(truth, share=1.0):
    friction = CoulombFriction(tau_c=list(share * np.array(truth.values["tau_c"])))
    return truth.declared.replaced(friction)


def written(truth, out, **changes):
    """The files of a diagnosis that names the true friction; `changes` are put into its document."""
    held = [sorted(truth.measured)[-1]]
    model = model_of(truth)
    model.save(out / "model.toml")
    before, (after, floor) = held_out(truth, truth.declared, held)[0], held_out(truth, model, held)
    tau = truth.values["tau_c"]
    document = {
        "verdict": "explained",
        "headline": f"Dry friction explains 99.0 % of the residual above noise; held out {before:.1f} → {after:.1f} W.",
        "effects": [
            {
                "name": "coulomb_friction",
                "parameters": {"tau_c": tau},
                "ci95": {"tau_c": [[x - 0.1, x + 0.1] for x in tau]},
                "share_of_residual": 0.99,
                "p_value": 0.001,
            }
        ],
        "alternatives": [],
        "nuisance": [],
        "remainder": [],
        "noise_floor": floor,
        "error": {"before": {"holdout": {"power_rmse": before}}, "after": {"holdout": {"power_rmse": after}}},
        "split": {"train": sorted(truth.measured)[:-1], "holdout": held},
    }  # fmt: skip
    write_json(out / "diagnosis.json", {**document, **changes})
    (out / "report.html").write_text("coulomb friction")
    return json.loads((out / "diagnosis.json").read_text())


def test_an_honest_document_passes(truth, tmp_path):
    written(truth, tmp_path)
    assert contradictions(tmp_path, truth) == []


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"verdict": "nothing_missing"}, "nothing_missing with"),
        ({"verdict": "partly"}, "nothing is said of the remainder"),
        ({"verdict": "ambiguous"}, "without alternatives"),
        ({"headline": "Nothing is missing."}, "headline: Nothing is missing"),
        ({"headline": "It explains -100.0 % of the residual above noise."}, "the headline explains -100 %"),
        ({"headline": "It explains all; held out 50.0 → 0.1 W."}, "error says"),
        ({"nuisance": ["coulomb_friction"]}, "a cause and a nuisance"),
        ({"noise_floor": 0.01}, "times the noise floor"),
        ({"effects": []}, "explained without an effect"),
    ],
)
def test_contradictions_are_found(changes, said, truth, tmp_path):
    written(truth, tmp_path, **changes)
    assert any(said in fault for fault in contradictions(tmp_path, truth))


def test_a_model_that_is_not_the_claimed_one_is_found(truth, tmp_path):
    written(truth, tmp_path)
    truth.declared.save(tmp_path / "model.toml")
    found = contradictions(tmp_path, truth)
    assert any("not in model.toml" in fault for fault in found) and any(
        "model.toml reaches" in fault for fault in found
    )
    model_of(truth, 0.9).save(tmp_path / "model.toml")
    assert any("claimed otherwise" in fault for fault in contradictions(tmp_path, truth))


def test_the_true_model_is_as_good_as_the_noise_and_foresees_differences(truth):
    reached, best = held_out(truth, model_of(truth), sorted(truth.measured))
    assert reached == pytest.approx(best, rel=1e-6)  # the judge turns friction's sign as smoothly as the world
    assert difference_error(truth, model_of(truth), 31) < 1e-6
    assert difference_error(truth, truth.declared, 31) > 0.1
    of_truth, of_declared = (energy_error(truth, m, sorted(truth.measured)) for m in (model_of(truth), truth.declared))
    assert of_truth < 0.005 < of_declared


def test_what_a_pump_takes_is_no_difference_between_two_plans(tmp_path):
    """The declared model is right but for the pump, which runs at its own times."""
    truth = write_world(World("z1", 31, (0.0, 0.0), unlisted="pump", motions=3, poses=2), tmp_path / "set")
    assert difference_error(truth, truth.declared, 31) < 0.01


@pytest.mark.parametrize("seed", range(3))
def test_motions_that_are_compared_keep_the_arms_limits(seed, truth):
    seen = []

    def plant(motions):
        seen.extend(motions)
        return truth.plant(motions)

    difference_error(replace(truth, plant=plant), truth.declared, seed)
    limits = truth.robot.limits
    assert len(seen) == 16
    for _, v, a in seen:
        assert (np.abs(v) <= 1.02 * limits.velocity).all() and (np.abs(a) <= 1.05 * limits.acceleration).all()


@pytest.mark.parametrize("kind", list(KINDS))
def test_each_unlisted_law_adds_power_that_no_listed_part_has(kind):
    """Its size is finite, it changes something, and at size 0 it is gone."""
    rng, drives = np.random.default_rng(5), ARMS["ur5"]
    n, t = 6, np.arange(0, 8, 0.01)
    v = np.where((t % 4 > 1)[:, None], np.sin(np.outer(t, rng.uniform(0.5, 1.5, n))), 0.0)
    part = Part(t, np.cumsum(v, axis=0) * 0.01, v, np.gradient(v, 0.01, axis=0), 20 * np.cos(t)[:, None] * np.ones(n),
                rng.uniform(1, 5, (len(t), n)))  # fmt: skip
    law = KINDS[kind](drives, Limits(np.full(n, 3.0), np.full(n, 100.0)), rng)

    def power(size):
        motor = [part.tau + law.torque([part], size)[0]]
        bus = [(np.array(drives.heat) * motor[0] ** 2 + motor[0] * part.v).sum(axis=1)]
        return law.mains([part], motor, bus, size)[0]

    bare = (np.array(drives.heat) * part.tau**2 + part.tau * part.v).sum(axis=1)
    assert np.isfinite(power(1.0)).all() and np.abs(power(1.0) - bare).max() > 0.1
    if law.scales:
        np.testing.assert_allclose(power(0.0), bare)


def test_bounds_are_those_of_the_binomial_law():
    from scipy.stats import binom

    assert binom.cdf(2, 60, upper(2, 60)) == pytest.approx(0.05)
    assert binom.sf(57, 60, lower(58, 60)) == pytest.approx(0.05)
    rows = [{"category": "clean", "false": [], "contradictions": [], "verdict": "nothing_missing", "found": False,
             "right": False}] * 99  # fmt: skip
    named = {line[0]: line for line in lines([*rows, {**rows[0], "false": ["payload"]}])}
    assert named["clean arms: sets with a false cause"][3]
    assert not {line[0]: line for line in lines([{**rows[0], "false": ["x"]}] * 3)}[
        "clean arms: sets with a false cause"
    ][3]


def test_judge_and_world_agree_on_the_declared_law(truth):
    """So that what the judge recomputes is the model's and not another's."""
    name = next(f for f in truth.measured if truth.at_rows[f][1].any())
    q, v, a, t = truth.at_rows[name]
    model = PowerModel("z1", (Standby(power=24.0), CopperLoss(r_over_kt2=list(ARMS["z1"].heat))))
    ours = foreseen(model, truth.robot, q, v, a, t)
    friction = np.array(truth.values["tau_c"])
    assert np.corrcoef(truth.measured[name] - ours, np.abs(v) @ friction)[0, 1] > 0.7
