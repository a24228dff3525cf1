"""Diagnosis of sets from the forward simulation: verdicts, values, invariances, files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from virtual_sets import base_model, make_set

from energy_opt.cli.main import main
from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.data.predict import friction_torque
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.diagnosis.evidence.odds import without_steps
from energy_opt.diagnosis.report.words import UNRECORDED, next_step
from energy_opt.effects import CoulombFriction, Payload, Regeneration, Standby, StandbyDrift
from energy_opt.files import read_toml, write_toml
from energy_opt.measured import read_set
from energy_opt.power import PowerModel, load_model
from energy_opt.tables import read_table
from energy_opt.virtual_arm.simulate import Instruments

pytest.importorskip("mujoco")
from misfit_world import World, write_world

SHARED = Path(__file__).resolve().parents[3] / "shared/data"
CALM = Instruments(noise=0.6, power_resolution=0.05)
FRICTION = CoulombFriction(tau_c=[0.6, 0.5, 0.45, 0.5, 0.3, 0.25, 0.2])


def names(result):
    return [row["name"] for row in result.document()["effects"]]


@pytest.fixture(scope="module")
def coulomb(tmp_path_factory):
    return make_set(tmp_path_factory.mktemp("c") / "set", "panda", [FRICTION], seed=1, instruments=CALM)


@pytest.fixture(scope="module")
def found(coulomb):
    return diagnose(read_set(coulomb.folder), coulomb.declared)


def test_friction_is_named_with_its_values(found):
    d = found.document()
    assert d["verdict"] == "explained" and names(found) == ["coulomb_friction"]
    row = d["effects"][0]
    low, high = np.array(row["ci95"]["tau_c"]).T if np.ndim(row["ci95"]["tau_c"]) > 1 else row["ci95"]["tau_c"]
    true = FRICTION.values["tau_c"]
    width = high - low
    assert ((low - width / 4 <= true) & (true <= high + width / 4)).all()
    assert row["p_value"] is None and row["log_odds"] > 7 and row["share_of_residual"] > 0.95


def test_runs_of_which_only_the_total_is_known_have_a_step(coulomb):
    measured = read_set(coulomb.folder)
    runs = [
        replace(r, power_time=r.time[-1:], power=r.power[:1], window=r.time[-1:] - r.time[:1], meter="total")
        for r in measured.runs
    ]
    samples = take_samples(replace(measured, runs=tuple(runs)))
    lengths = [float(np.ptp(r.time)) for r in runs]
    assert min(lengths) < samples.step < max(lengths)


def test_a_motion_that_was_not_proposed_is_not_the_next_step():
    document = {"verdict": "insufficient", "usable": False, "remainder": [], "next_motion": None}
    assert "more motions" in next_step(document)
    assert "the proposed motion" in next_step({**document, "next_motion": "next_motion.csv"})


def test_what_goes_with_no_recorded_signal_is_not_looked_for_among_them():
    left = [{"signal": UNRECORDED, "joint": None}]
    error = {"after": {"holdout": None, "train": {"energy_percent": 9.0}}}
    said = next_step({"verdict": "unexplained", "usable": False, "remainder": left, "error": error, "tolerance": 3.0})
    assert "power's unit" in said and "depends on" not in said


def test_errors_fall_to_the_noise_on_runs_never_fitted(found):
    e = found.document()["error"]
    assert e["before"]["holdout"]["power_rmse"] > 1.2 * e["noise_floor"]
    assert e["after"]["holdout"]["power_rmse"] < 1.1 * e["noise_floor"]
    assert e["after"]["holdout"]["energy_percent"] < e["before"]["holdout"]["energy_percent"]
    assert abs(e["noise_floor"] - 0.6) < 0.06


def test_the_split_is_by_run(found, coulomb):
    s = found.document()["split"]
    assert set(s["train"]) | set(s["holdout"]) == {r.file for r in coulomb.runs}
    assert not set(s["train"]) & set(s["holdout"]) and len(s["holdout"]) >= 2


def test_a_clean_set_has_nothing_missing(tmp_path):
    made = make_set(tmp_path / "set", "z1", seed=5)
    result = diagnose(read_set(made.folder), made.declared)
    assert result.document()["verdict"] == "nothing_missing" and names(result) == []
    assert result.model == made.declared or result.model.effects == made.declared.effects


@pytest.mark.slow
def test_payload_is_found_with_its_centre(tmp_path):
    load = Payload(mass=1.8, com=[0.02, -0.03, 0.09])
    made = make_set(tmp_path / "set", "ur5", [load], seed=2, instruments=CALM)
    row = diagnose(read_set(made.folder), made.declared).document()["effects"][0]
    assert row["name"] == "payload" and abs(row["parameters"]["mass"] - 1.8) < 0.05
    np.testing.assert_allclose(row["parameters"]["com"], load.values["com"], atol=0.02)


@pytest.mark.slow
def test_two_effects_at_once(tmp_path):
    effects = [FRICTION, Regeneration(efficiency=0.2, level="joint")]
    made = make_set(tmp_path / "set", "panda", effects, seed=3, instruments=CALM)
    result = diagnose(read_set(made.folder), made.declared)
    assert set(names(result)) == {"coulomb_friction", "regeneration"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "special", [*(pytest.param(s, marks=pytest.mark.slow) for s in ("cogging", "fan")), "standby_step"]
)
def test_what_no_effect_accounts_for_stays_unexplained(special, tmp_path):
    made = make_set(tmp_path / "set", "panda", specials=[special], seed=4)
    result = diagnose(read_set(made.folder), made.declared)
    assert result.document()["verdict"] == "unexplained" and names(result) == []
    signal = result.document()["residual_goes_with"][0]["signal"]
    assert signal.startswith("position" if special == "cogging" else "time")


def test_a_switched_load_is_no_drift_of_the_meter():
    time, rng = 14.0 * np.arange(12), np.random.default_rng(3)
    drift = 0.2 * np.sin(time / 40) + 0.05 * rng.normal(size=12)
    for on, off in ((5, 12), (4, 9), (0, 7)):  # for good, for a while, until some time
        load = np.where((np.arange(12) >= on) & (np.arange(12) < off), 4.0, 0.0)
        left = without_steps(time, drift + load)
        assert np.ptp(left) < 0.8 and np.abs(left).max() < (0.5 if off - on < 7 else 4.6)
    np.testing.assert_array_equal(without_steps(time, 10 * drift), 10 * drift)
    pause = np.where(np.arange(12) >= 6, 3600.0, 0.0)  # in which a meter may drift
    wander = drift + 0.01 * pause**0.5
    np.testing.assert_array_equal(without_steps(time + pause, wander), wander)


@pytest.mark.slow
def test_supply_and_gain_are_one_at_the_meter(tmp_path):
    made = make_set(tmp_path / "set", "z1", ["supply_efficiency"], seed=6)
    result = diagnose(read_set(made.folder), made.declared)
    assert result.document()["verdict"] == "ambiguous"
    assert sorted(map(tuple, result.document()["alternatives"])) == [("meter_gain",), ("supply_efficiency",)]


@pytest.mark.slow
@pytest.mark.parametrize("weak", ["static_only", "still_joint"])
def test_too_little_excitation(weak, tmp_path):
    made = make_set(tmp_path / "set", "panda", ["armature"], seed=7, weak=weak)
    out = tmp_path / "out"
    words = ["diagnose", str(made.folder), "--model", str(made.folder / "declared.toml"), "--out", str(out), "--quiet"]
    assert main(words) == 0
    document = json.loads((out / "diagnosis.json").read_text())
    assert document["verdict"] in ("insufficient", "ambiguous")
    poses_alone = "The poses agree with the model; no motion was recorded, so losses in motion are not tested"
    assert document["headline"].startswith(poses_alone) == (weak == "static_only")
    assert not any("slow motions" in said for said in document["remarks"])
    for row in document["effects"]:  # what the data leave open is taken to be like the other joints'
        values = np.atleast_1d(row["parameters"].get("inertia", [0.0]))
        assert values.max() <= 10 * max(np.median(values), 1e-9)
    motion = read_table(out / document["next_motion"])
    limits = made.robot.limits
    for j, joint in enumerate(made.robot.joints):
        assert np.abs(motion[f"{joint}.velocity"]).max() <= limits.velocity[j]
        assert (
            limits.lower[j] <= motion[f"{joint}.position"].min() <= motion[f"{joint}.position"].max() <= limits.upper[j]
        )
        assert np.abs(motion[f"{joint}.velocity"]).max() > 0.01


@pytest.mark.slow
def test_a_model_of_a_joint_that_never_moved_is_not_good_enough_to_plan_with(tmp_path):
    made = make_set(tmp_path / "set", "panda", [], seed=7, weak="still_joint")
    found = diagnose(read_set(made.folder, made.robot), made.declared)
    document = found.document()
    assert document["verdict"] == "insufficient" and document["foreseen"]["difference_percent"] < 20
    assert not document["usable"] and "hardly moves" in document["foreseen"]["reason"]
    idle = document["foreseen"]["reason"].removesuffix(" hardly moves in the set")
    assert f"These joints hardly moved, so their losses are not tested: {idle}." in document["headline"]
    assert f"not shown to be good enough to plan with, as {document['foreseen']['reason']}" in str(found)


def test_wrong_declared_values_are_fitted_anew(tmp_path):
    made = make_set(tmp_path / "set", "ur5", seed=8, instruments=CALM)
    wrong = made.declared.replaced(Standby(power=89.0))
    result = diagnose(read_set(made.folder), wrong)
    assert names(result) == ["standby"] and result.document()["effects"][0]["refit"]
    assert abs(result.document()["effects"][0]["parameters"]["power"] - 92.6) < 0.1


@pytest.mark.slow
def test_one_joint_whose_friction_has_changed_is_found_at_its_new_value(tmp_path):
    """Declared is last year's friction; that of the third joint has risen by 90 %."""
    now = FRICTION.values["tau_c"] * np.array([1, 1, 1.9, 1, 1, 1, 1])
    made = make_set(tmp_path / "set", "panda", [CoulombFriction(tau_c=now)], seed=32, instruments=CALM)
    result = diagnose(read_set(made.folder), made.declared.replaced(FRICTION))
    assert names(result) == ["coulomb_friction"]
    low, high = result.document()["effects"][0]["ci95"]["tau_c"][2]
    assert low < now[2] < high


@pytest.mark.parametrize(("arm", "seed"), [("z1", 3300010), ("xarm7", 3200075)])
def test_a_meter_that_wanders_is_no_cause(arm, seed, tmp_path):
    truth = write_world(World(arm, seed, (0.0, 0.0), "drift"), tmp_path)  # once a warm-up; once a wrong standby
    result = diagnose(read_set(truth.folder, truth.robot), truth.declared)
    assert names(result) == [] and result.document()["verdict"] == "nothing_missing"


def test_a_warm_up_beyond_a_meters_wander_is_found(tmp_path):
    made = make_set(tmp_path / "set", "z1", [StandbyDrift(power=5.0, time_constant=46.0)], seed=10)
    result = diagnose(read_set(made.folder), made.declared)
    assert names(result) == ["standby_drift"]
    assert abs(result.document()["effects"][0]["parameters"]["power"] - 5.0) < 0.4
    warm = load_model(result.save(tmp_path / "out") / "model_warm.toml")
    assert "standby_drift" not in [e.name for e in warm.effects]
    assert warm.constant_power(6) - result.model.constant_power(6) == pytest.approx(5.0, abs=0.4)


def test_a_missing_overhead_counts_too(tmp_path):
    made = make_set(tmp_path / "set", "z1", seed=9, instruments=CALM)
    only_copper = base_model("z1").without("standby")
    assert "standby" in names(diagnose(read_set(made.folder), PowerModel("z1", only_copper.effects)))


def test_the_files_of_the_contract(coulomb, tmp_path, capsys):
    words = ["diagnose", str(coulomb.folder), "--model", str(coulomb.folder / "declared.toml"), "--json"]
    assert main([*words, "--out", str(tmp_path), "--quiet"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((tmp_path / "diagnosis.json").read_text())
    keys = {"verdict", "effects", "alternatives", "residual_goes_with", "error", "split", "next_motion"}
    assert keys <= set(document)
    model = load_model(tmp_path / "model.toml")
    assert [e.name for e in model.effects] == ["standby", "copper_loss", "coulomb_friction"]
    page = (tmp_path / "report.html").read_text()
    for part in ("noise floor", "Error before and after", "Power over time", "Evidence for each hypothesis"):
        assert part in page
    worth = document["worth"]  # the model that knows the friction plans no worse than the one that lacks it
    assert worth["diagnosed_plan"] <= min(worth["declared_plan"], worth["evenly_slowed"])
    assert "What the diagnosis is worth" in page


@pytest.mark.slow
@pytest.mark.parametrize("name", ["clean_panda", "coulomb_panda", "payload_ur5", "cogging_panda"])
@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared sets are not here")
def test_shared_sets(name):
    folder = SHARED / "virtual_sets" / name
    truth = read_toml(folder / "truth.toml")
    result = diagnose(read_set(folder), load_model(folder / "declared.toml"))
    expected = {"clean": "nothing_missing", "single": "explained", "unlisted": "unexplained"}[truth["category"]]
    assert result.document()["verdict"] == expected and names(result) == truth["names"]


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared recording is not here")
@pytest.mark.parametrize("meter", ["25 Hz", "1 Hz"])
def test_a_real_ur3e(tmp_path, meter):
    """Its own current says 3.3 + 4.7 v N m of the first joint; slower readings still say so."""
    raw = (SHARED / "rad_ur3e_power/fig9.csv").read_text().splitlines()
    run = {"file": "fig9.csv", "kind": "motion"}
    if meter == "1 Hz":
        table = np.genfromtxt(raw, delimiter=",", names=True)
        power = (table["actual_robot_voltage"] * table["actual_robot_current"])[: len(table) // 25 * 25]
        rows = np.column_stack([table["timestamp"][24 : len(power) : 25], power.reshape(-1, 25).mean(axis=1)])
        np.savetxt(tmp_path / "power.csv", rows, "%.4f", ",", header="time,power", comments="")
        run["power_file"] = "power.csv"
        raw = [line.replace("actual_robot_current", "unused") for line in raw]
    (tmp_path / "fig9.csv").write_text("\n".join(raw) + "\n")
    write_toml(
        tmp_path / "log.toml",
        {
            "format": "energy-opt/log/1",
            "robot": "ur3e",
            "run": [run],
            "columns": {"preset": "ur_rtde"},
            "segment": {"at": "standstill"},
        },
    )
    assert main(["diagnose", str(tmp_path), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    document = json.loads((tmp_path / "out/diagnosis.json").read_text())
    assert document["effects"][0]["name"].endswith("_friction")
    assert document["error"]["before"]["holdout"]["power_rmse"] > (5 if meter == "25 Hz" else 3)
    assert document["error"]["after"]["holdout"]["power_rmse"] <= 2.0
    friction = friction_torque(load_model(tmp_path / "out/model.toml"), 6)(np.array([0.3]), 0)[0]
    assert friction == pytest.approx(3.3 + 4.7 * 0.3, rel=0.25)
    assert not any("pushed" in remark for remark in document["remarks"])


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared recording is not here")
@pytest.mark.parametrize("less", [60, 100, 140])
def test_noise_that_no_standstill_shows_hides_no_cause(tmp_path, less):
    """Without its first samples the recording never stands still for long: at 25 Hz too few readings are at rest."""
    first, *rest = (SHARED / "rad_ur3e_power/fig9.csv").read_text().splitlines()
    (tmp_path / "fig9.csv").write_text("\n".join([first, *rest[less:]]) + "\n")
    log = {"format": "energy-opt/log/1", "robot": "ur3e", "run": [{"file": "fig9.csv", "kind": "motion"}]}
    write_toml(tmp_path / "log.toml", {**log, "columns": {"preset": "ur_rtde"}, "segment": {"at": "standstill"}})
    assert main(["diagnose", str(tmp_path), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    document = json.loads((tmp_path / "out/diagnosis.json").read_text())
    assert document["verdict"] in ("explained", "partly")
    assert {x["name"] for x in document["effects"]} == {"coulomb_friction", "viscous_friction"}
