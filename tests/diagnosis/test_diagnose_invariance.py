"""What must not change a diagnosis, and what must not be called one: other files, clocks and orders; noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hidden import COPPER, STANDBY, Hidden, record
from virtual_sets import make_set

from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.data.predict import predict
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.diagnosis.evidence.residual import follows
from energy_opt.diagnosis.verdict.inference import infer
from energy_opt.effects import CopperLoss, CoulombFriction, GravitySpring, Standby
from energy_opt.files import read_toml, write_toml
from energy_opt.measured import read_set
from energy_opt.power import PowerModel
from energy_opt.tables import read_table, write_table
from energy_opt.virtual_arm.simulate import Instruments

pytest.importorskip("mujoco")
FRICTION = CoulombFriction(tau_c=[0.6, 0.5, 0.45, 0.5, 0.3, 0.25, 0.2])


def names(result):
    return [row["name"] for row in result.document()["effects"]]


@pytest.fixture(scope="module")
def coulomb(tmp_path_factory):
    calm = Instruments(noise=0.6, power_resolution=0.05)
    return make_set(tmp_path_factory.mktemp("c") / "set", "panda", [FRICTION], seed=1, instruments=calm)


@pytest.fixture(scope="module")
def found(coulomb):
    return diagnose(read_set(coulomb.folder), coulomb.declared)


def copied(folder: Path, other: Path) -> Path:
    other.mkdir()
    for path in folder.iterdir():
        (other / path.name).write_bytes(path.read_bytes())
    return other


@pytest.mark.slow
def test_order_of_runs_and_units_change_nothing(coulomb, found, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    log = read_toml(coulomb.folder / "log.toml")
    joints = coulomb.robot.joints
    for row in log["run"]:
        table = read_table(coulomb.folder / row["file"])
        columns = {"ms": 1000 * table["time"], **{f"{j} deg": np.degrees(table[f"{j}.position"]) for j in joints}}
        write_table(other / row["file"], [*columns, "kW"], [*columns.values(), table["power"] / 1000])
    log["run"] = log["run"][::-1]
    log["columns"] = {
        "time": {"column": "ms", "unit": "ms"},
        "power": {"column": "kW", "unit": "kW"},
        **{f"{j}.position": {"column": f"{j} deg", "unit": "deg"} for j in joints},
    }
    write_toml(other / "log.toml", log)
    again = diagnose(read_set(other), coulomb.declared)
    assert again.document()["verdict"] == "explained" and names(again) == names(found)
    assert set(again.document()["split"]["holdout"]) == set(found.document()["split"]["holdout"])


def test_a_slower_meter_with_its_own_clock_gives_the_same(coulomb, found, tmp_path):
    other = copied(coulomb.folder, tmp_path / "other")
    log = read_toml(other / "log.toml")
    for row in log["run"]:
        table = read_table(other / row["file"])
        time, power = table["time"], table.pop("power")
        own = np.arange(time[0] + 0.021, time[-1] - 0.03, 0.025)  # each the mean of what the first meter showed
        total = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(time))])
        mean = (np.interp(own + 0.0125, time, total) - np.interp(own - 0.0125, time, total)) / 0.025
        row["power_file"] = f"power_{row['file']}"
        write_table(other / row["power_file"], ["time", "power"], [own, mean])
        write_table(other / row["file"], list(table), list(table.values()))
    write_toml(other / "log.toml", log)
    again = diagnose(read_set(other), coulomb.declared)
    assert again.document()["verdict"] == "explained" and names(again) == names(found)


@pytest.mark.parametrize("kind", ["noise", "shuffled"])
def test_noise_in_place_of_power_gives_no_effect(coulomb, tmp_path, kind):
    rng = np.random.default_rng(0)
    other = copied(coulomb.folder, tmp_path / "noise")
    for row in read_toml(other / "log.toml")["run"]:
        table = read_table(other / row["file"])
        noise = 90 + 5 * rng.normal(size=len(table["time"]))
        table["power"] = noise if kind == "noise" else rng.permutation(table["power"])
        write_table(other / row["file"], list(table), list(table.values()))
    result = diagnose(read_set(other), coulomb.declared)
    assert result.document()["verdict"] == "unexplained" and names(result) == []
    assert any("does not depend on the motion" in remark for remark in result.document()["remarks"])
    assert "same recording" in result.document()["next_step"]


def test_power_that_an_unlisted_cause_rules_still_follows_the_motion(tmp_path):
    """A strong spring takes over most of the gravity torque, so that the declared power fits badly everywhere."""
    spring = GravitySpring(stiffness=[0, 25.0, 20.0, 0, 0, 0], rest=[0, 1.2, -1.0, 0, 0, 0])
    made = make_set(tmp_path / "set", "z1", [spring], seed=4)
    samples = take_samples(read_set(made.folder))
    assert follows(samples, predict(made.declared, samples))


@pytest.mark.slow
def test_the_best_of_many_candidates_is_no_evidence_on_noise(tmp_path):
    """White noise and noise with memory around the declared model: nothing is claimed; friction is, beside either."""
    made = make_set(tmp_path / "set", "z1", seed=5)
    samples = take_samples(read_set(made.folder))
    samples = samples.part(range(5))
    limits, moving = made.robot.limits, np.ones(6, dtype=bool)
    level = predict(made.declared, samples).reading
    friction = 0.3 * samples.shown(np.abs(samples.v).sum(axis=1))
    rng = np.random.default_rng(3)
    claimed = 0
    for k in range(8):
        noise = samples.noise * rng.normal(size=len(level))
        if k % 2:
            noise += samples.noise * remembered(samples, rng)
        claimed += len(infer(reading(samples, level + noise), made.declared, limits, moving).claims)
    assert claimed == 0
    noisy = level + friction + samples.noise * (rng.normal(size=len(level)) + remembered(samples, rng))
    found = infer(reading(samples, noisy), made.declared, limits, moving)
    assert found.claims and min(c.odds for c in found.claims) > 10


def reading(samples, power):
    """The samples with another power (N,) [W], of which each value is a single reading."""
    runs = tuple((samples.at[part], power[part]) for part in samples.parts)
    return replace(samples, power=power, single=runs, floor=samples.noise)


def remembered(samples, rng, memory=0.7):
    """A first-order wave of unit variance over each run."""
    out = np.empty(len(samples.power))
    for part in samples.parts:
        keep = np.exp(-np.median(np.diff(samples.at[part])) / memory)
        drawn = rng.normal(size=part.stop - part.start) * np.sqrt(1 - keep**2)
        drawn[0] /= np.sqrt(1 - keep**2)
        for k in range(1, len(drawn)):
            drawn[k] += keep * drawn[k - 1]
        out[part] = drawn
    return out


def test_a_run_with_damaged_power_is_left_out_and_named(coulomb, found, tmp_path):
    other = copied(coulomb.folder, tmp_path / "other")
    path = next(other / row["file"] for row in read_toml(other / "log.toml")["run"] if row["kind"] == "motion")
    table = read_table(path)
    table["power"] = np.random.default_rng(1).uniform(0, 3000, len(table["power"]))
    write_table(path, list(table), list(table.values()))
    result = diagnose(read_set(other), coulomb.declared)
    split = result.document()["split"]
    assert names(result) == names(found) == ["coulomb_friction"]
    assert path.name not in split["train"] + split["holdout"]
    assert any(path.name in remark and "damaged" in remark for remark in result.document()["remarks"])


def test_power_in_kilowatts_without_a_unit_is_remarked(coulomb, tmp_path):
    other = copied(coulomb.folder, tmp_path / "other")
    for row in read_toml(other / "log.toml")["run"]:
        table = read_table(other / row["file"])
        table["power"] = table["power"] / 1000
        write_table(other / row["file"], list(table), list(table.values()))
    result = diagnose(read_set(other), coulomb.declared)
    assert any("kW" in remark for remark in result.document()["remarks"])
    assert result.document()["verdict"] == "unexplained" and names(result) == []


@pytest.mark.parametrize(("factor", "stop", "said"), [(1000, False, "may be in mW"), (1, True, "was stopped")])
def test_a_power_in_doubt_and_a_stopped_search_leave_no_usable_model(tmp_path, factor, stop, said):
    """A fit of milliwatts was good enough to plan with, at an error of 862 W, before the search had a verdict."""
    made = record(tmp_path / "set", Hidden("z1"), lambda power: factor * power, runs=4, legs=1)
    declared = PowerModel("z1", (Standby(power=STANDBY), CopperLoss(r_over_kt2=COPPER)))
    document = diagnose(read_set(made), declared, stopped=lambda: stop).document()
    assert document["verdict"] == (None if stop else "unexplained")
    assert not document["usable"] and said in document["foreseen"]["reason"]
    assert ("the power's unit in log.toml" in document["next_step"]) != stop


def test_results_are_computed_after_a_stop_without_being_stopped_again(tmp_path):
    """A fit for the result, after a stop in the second search, ended with "this is a fault of the program"."""
    made = record(tmp_path / "set", Hidden("z1"), runs=4, legs=1)
    declared = PowerModel("z1", (Standby(power=STANDBY), CopperLoss(r_over_kt2=COPPER)))
    found = diagnose(read_set(made), declared, stopped=lambda: True).inference
    assert found.verdict == "" and found.search.fitted([], [], [], found.root.nuisance, found.root.amounts).names == ()
