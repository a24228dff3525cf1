"""What is left of a residual: the signals that it follows, a step of its level, the words for links and steps."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hidden import COPPER, STANDBY, Hidden, record

from energy_opt.diagnosis.data.noise import Noise
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.diagnosis.evidence import residual as module
from energy_opt.diagnosis.fit.posterior import Free
from energy_opt.diagnosis.report.words import UNRECORDED, headline, next_step
from energy_opt.diagnosis.verdict.inference import infer
from energy_opt.effects import CopperLoss, Standby
from energy_opt.measured import read_set
from energy_opt.power import PowerModel

MODEL = PowerModel("", (Standby(power=20.0),))
RUNS = 8


def attributions(monkeypatch, power, functions, free=(), levels=(0.0,), shown=0.0, moving=False):
    """Signals of readings `power`, in motion where `moving`, of a model of 0 W, whose fit with links shows `shown`."""
    at = np.arange(float(len(power)))
    parts = [slice(*ends) for ends in np.array_split(at.astype(int), len(levels)) for ends in [(ends[0], ends[-1] + 1)]]
    moving = np.full(len(at), moving)
    samples = SimpleNamespace(n=2, weight=np.ones(len(at)), parts=parts, at=at, power=power, moving=moving)
    world = SimpleNamespace(
        samples=samples, whiten=SimpleNamespace(noise=Noise(0.1)), scale=SimpleNamespace(level=100.0)
    )
    own = np.concatenate([np.full(p.stop - p.start, x) for p, x in zip(parts, levels, strict=True)])
    f = SimpleNamespace(
        world=world, residual=power - shown - own, model=MODEL, prediction=SimpleNamespace(reading=shown),
        levels=np.array(levels), level_deviations=np.full(len(levels), 0.1),
    )  # fmt: skip
    monkeypatch.setattr(module, "functions", lambda f: functions)
    monkeypatch.setattr(module, "predict", lambda model, s: SimpleNamespace(reading=np.zeros(len(at))))
    return module.goes_with(f, free, "ab", MODEL, samples)


@pytest.mark.parametrize("size", [0.2, 3.0])
def test_a_signal_that_the_search_accepted_is_named_of_no_joint_if_it_has_none(monkeypatch, size):
    """A function of the whole power, however little of the residual follows it: `foreseen` names it, too."""
    rng = np.random.default_rng(0)
    power = Free("power", np.abs(rng.normal(size=(400, 4))), 1.5)  # as many columns as two joints can share
    rows = attributions(monkeypatch, size * power.columns[:, 0] + rng.normal(size=400), [power], [power])
    assert [(row.signal, row.joint) for row in rows] == [("power", None)]


def test_what_links_imitate_is_left_where_the_model_lacks_them(monkeypatch):
    """A spring at one joint: links of the fit followed it, so that no recorded signal was said to explain it."""
    rng = np.random.default_rng(0)
    position = Free("position", rng.normal(size=(400, 4)), 1.5)
    spring = position.columns[:, 2:] @ [3.0, 4.0]
    (row,) = attributions(monkeypatch, spring + rng.normal(size=400), [position], shown=0.9 * spring)
    assert (row.signal, row.joint) == ("position", "b") and row.watts == pytest.approx(5.0, rel=0.1)


@pytest.mark.parametrize(
    ("level", "change"), [(lambda t: 20.0 * (t >= 340), 20.0), (lambda t: t / 20, None), (lambda t: 20 * (t < 60), -20)]
)
def test_a_level_that_changes_once_leads_with_its_time_and_size(monkeypatch, level, change):
    """A torque imitated the middle of a run; steady growth is no step."""
    rng = np.random.default_rng(0)
    power = level(np.arange(800.0)) + 0.5 * rng.normal(size=800)
    torque = Free("torque", rng.normal(size=(800, 3)), 1.5)
    levels = [float(part.mean()) for part in np.array_split(power, RUNS)]
    first, *others = attributions(monkeypatch, power, [torque], [torque], levels)
    if change is None:
        assert first.change is None and any(row.signal.startswith("time") for row in others)
        return
    assert first.change == pytest.approx(change, rel=0.02) and abs(first.at - (340 if change > 0 else 60)) <= 1
    row = first.document()
    said = next_step({"verdict": "unexplained", "usable": False, "remainder": [row]})
    assert f"{first.change:+.3g} W at {first.at:.0f} s" in said and "depends on" not in said


@pytest.mark.parametrize(("rests", "named"), [(0.0, False), (20.0, True)])
def test_where_static_recordings_follow_motions_the_level_is_compared_at_rest(monkeypatch, rests, named):
    """Power of brakes, which lasts while joints move, was called a fan that was switched off before these recordings.

    Rests take a tenth of each motion; there the power has changed, too, if it was a fan.
    """
    rng, at = np.random.default_rng(0), np.arange(800)
    moving = (at < 500) & (at % 50 > 5)
    power = np.where(at < 500, np.where(moving, 20.0, rests), 0.0) + 0.5 * rng.normal(size=800)
    levels = [float(part.mean()) for part in np.array_split(power, RUNS)]
    rows = attributions(monkeypatch, power, [], levels=levels, moving=moving)
    assert any(row.change is not None for row in rows) == named


@pytest.mark.parametrize(("signal", "spring"), [("position", True), ("power", False)])
def test_a_rest_that_goes_with_a_position_asks_for_the_data_of_that_joint(signal, spring):
    """A wrong zero, sign, order or scale of positions acts like a torque by position."""
    left = [{"signal": signal, "joint": "elbow"}, {"signal": "position", "joint": "elbow"}]
    said = next_step({"verdict": "unexplained", "usable": False, "remainder": left})
    assert "zero, sign, order and scale of the data of elbow" in said and ("spring" in said) == spring


def test_the_headline_says_where_more_is_left_than_on_held_out_motions():
    """3.4 W were left above noise of 1.2 W, of an error of 1.0 W on held-out motions."""
    error = {"train": None, "holdout": {"power_rmse": 1.0, "energy_percent": 0.1}}
    document = {
        "verdict": "unexplained", "effects": [], "error": {"before": error, "after": error}, "explained_share": 0.0,
        "links_share": 0.0, "noise_floor": 1.2, "remainder": [{"signal": "power", "joint": None, "watts": 3.4}],
    }  # fmt: skip
    assert "3.4 W are left above the noise in the runs fitted, of which 3.4 W go with power" in headline(document)


def test_the_headline_gives_effects_no_share_that_links_explain():
    error = {"train": None, "holdout": {"power_rmse": 2.0, "energy_percent": 1.0}}
    document = {
        "effects": [{"name": "regeneration"}], "error": {"before": error, "after": error}, "verdict": "explained",
        "explained_share": 1.0, "links_share": 0.4, "fitted": [], "alternatives": [], "remainder": [], "usable": True,
    }  # fmt: skip
    assert "explains 60.0 %" in headline(document) and "links another 40.0 %" in headline(document)
    assert "check payload and links" in next_step(document)


@pytest.mark.slow
@pytest.mark.parametrize(("moves", "verdict"), [(False, "insufficient"), (True, "unexplained")])
def test_held_out_motions_do_not_judge_a_cause_that_they_do_not_show(tmp_path, moves, verdict):
    """The friction of a joint that no held-out motion moves was called noise: `nothing_missing`."""
    arm, declared = Hidden("z1"), PowerModel("z1", (Standby(power=STANDBY), CopperLoss(r_over_kt2=COPPER)))
    first = np.arange(len(arm.joints)) == 0
    runs = read_set(record(tmp_path / "a", arm, friction=lambda v: 4 * first * np.sign(v), runs=3, legs=1, seed=2))
    arm.limits[:, first] *= moves
    held = read_set(record(tmp_path / "b", arm, runs=2, legs=1, seed=3))
    found = infer(take_samples(runs), declared, runs.robot.limits, first | True, take_samples(held))
    assert (found.verdict, found.unseen) == (verdict, () if moves else (0,))
    assert found.beside_noise["fitted"]["ratio"] > 2 > 1.2 > found.after.ratio


@pytest.mark.parametrize("level", [True, False])
def test_an_error_above_the_noise_in_motion_alone_is_stated_there(level):
    """A headline said that 0.0 W were left, and to check the power's unit."""
    row = {"power_rmse": 1.02, "energy_percent": 0.1 if level else 80.0}
    ratios = {"motion": 1.27, "rest": 0.64}
    beside = {part: {"power_rmse": 1.13, "noise": 0.89, "ratio": ratio} for part, ratio in ratios.items()}
    document = {
        "verdict": "unexplained", "effects": [], "alternatives": [], "explained_share": 0.0, "links_share": 0.0,
        "error": {part: {"train": row, "holdout": row} for part in ("before", "after")} | {"beside_noise": beside},
        "noise_floor": 1.14, "remainder": [{"signal": UNRECORDED, "joint": None, "watts": 0.7}], "usable": False,
        "tolerance": 3.0,
    }  # fmt: skip
    said = headline(document)
    assert "In motion, the error of a reading is 1.1 W, 1.3 times the noise" in said and "0.0 W" not in said
    assert ("the power's unit" in next_step(document)) != level


def test_a_headline_names_all_causes_that_cannot_be_told_apart():
    """It began with links that differ from the URDF, as if they were the cause."""
    error = {"train": None, "holdout": {"power_rmse": 0.9, "energy_percent": 0.1}}
    document = {
        "verdict": "ambiguous", "effects": [{"name": "link_inertia"}], "error": {"before": error, "after": error},
        "explained_share": 0.966, "links_share": 0.0, "fitted": [], "remainder": [],
        "alternatives": [["link_inertia"], ["meter_gain"], ["standby", "psu_loss"]],
    }  # fmt: skip
    causes = "links that differ from the URDF; meter gain; standby and psu loss"
    assert headline(document).startswith(
        f"The data cannot tell these causes apart: {causes}. The first explains 96.6 %"
    )


def test_a_model_that_imitates_the_cause_is_stated_beside_what_is_left():
    """The rest is that of the declared model; `model.toml` predicts better, and none of its effects is a cause."""
    error = {
        when: {"train": None, "holdout": {"power_rmse": watts, "energy_percent": percent}}
        for when, watts, percent in (("before", 3.0, 3.1), ("after", 1.1, 0.2))
    }
    document = {
        "verdict": "unexplained", "effects": [], "error": error, "explained_share": 0.95, "alternatives": [],
        "links_share": 0.0, "noise_floor": 1.0, "remainder": [{"signal": "power", "joint": None, "watts": 0.5}],
    }  # fmt: skip
    said = headline(document)
    assert "No cause can be named; held out 3.0 W, energy 3.1 %. 2.8 W are left above the noise, of which 0.5 W" in said
    assert "model.toml predicts better (1.1 W, energy 0.2 %)" in said
