"""Errors of a recording that are no causes: a model's error that repeats share, and clocks that are some ms apart.

The arms are MuJoCo's with laws by other formulas (`benchmarks/misfit_world.py`); readings are written anew here.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.evidence.errors import bootstrap_interval
from energy_opt.files import write_toml
from energy_opt.measured import read_set

pytest.importorskip("mujoco")
from misfit_world import World, write_world


@pytest.fixture(scope="module")
def rubbed(tmp_path_factory):
    """An arm with dry friction: tables of its runs with the true power, and what its owner declares."""
    world = World("ur5", 300, (0.0, 0.0), cause="coulomb_friction", motions=4, poses=3)
    truth = write_world(world, tmp_path_factory.mktemp("rubbed"))
    tables = {}
    for name, noise in truth.noise.items():
        table = np.genfromtxt(truth.folder / name, delimiter=",", names=True)
        table["power"] -= noise
        tables[name] = table
    return truth, tables


def verdict_of(truth, tables, folder: Path) -> tuple[str, list[str], list[str]]:
    """Verdict, effects and remarks of the tables as a set."""
    d = document_of(truth, tables, folder)
    return d["verdict"], [x["name"] for x in d["effects"]], d["remarks"]


def document_of(truth, tables, folder: Path) -> dict:
    """The diagnosis of the tables as a set."""
    folder.mkdir()
    start, runs = 0.0, []
    for k, table in enumerate(tables, start=1):
        header = ",".join(["time", *(f"{j}.position" for j in truth.robot.joints), "power"])
        np.savetxt(folder / f"{k}.csv", np.array(table.tolist()), "%.6f", ",", header=header, comments="")
        still = np.ptp(np.array(table.tolist())[:, 1:-1], axis=0).max() < 1e-3
        runs.append({"file": f"{k}.csv", "kind": "static" if still else "motion", "start": start})
        start += float(table["time"][-1]) + 10.0
    write_toml(folder / "log.toml", {"format": "energy-opt/log/1", "robot": "ur5", "run": runs})
    return diagnose(read_set(folder, truth.robot), truth.declared).document()


def settling(table) -> np.ndarray:
    """1 W (N,) that falls by e every 0.15 s after each stop, as of a servo that settles: half of the meter's noise."""
    angles = np.column_stack([table[name] for name in table.dtype.names if name.endswith("position")])
    moves = np.abs(np.diff(angles, axis=0, prepend=angles[:1])).max(axis=1) > 1e-4
    last = np.maximum.accumulate(np.where(moves, table["time"], -np.inf))
    return np.where(moves, 0.0, np.exp(-(table["time"] - last) / 0.15))


@pytest.mark.slow
@pytest.mark.parametrize("repeats", [0, 12, 20])
def test_repeats_of_one_motion_do_not_hide_a_cause(rubbed, tmp_path, repeats):
    """Their mean shows errors of the model that single recordings do not; these are no further evidence."""
    truth, tables = rubbed
    rng, noisy = np.random.default_rng(7), []
    for table in [*tables.values(), *[tables["run05.csv"]] * repeats]:
        own = table.copy()
        own["power"] += settling(table) + 2.0 * rng.normal(size=len(table))
        noisy.append(own)
    assert verdict_of(truth, noisy, tmp_path / "set")[:2] == ("explained", ["coulomb_friction"])


def test_poses_alone_do_not_judge_a_model_of_motion(rubbed, tmp_path):
    """One motion that is recorded often is cut, so that a part of it is held out."""
    truth, tables = rubbed
    rng, noisy = np.random.default_rng(9), []
    for table in [*list(tables.values())[:3], *[tables["run05.csv"]] * 12]:
        own = table.copy()
        own["power"] += 0.5 * rng.normal(size=len(table))
        noisy.append(own)
    d = document_of(truth, noisy, tmp_path / "set")
    assert d["verdict"] != "nothing_missing" and d["error"]["before"]["holdout"]["power_rmse"] > 1.2 * d["noise_floor"]
    assert any("#" in file for file in d["split"]["holdout"])


def test_totals_of_two_motions_are_too_few_for_a_verdict(rubbed):
    """Runs of which only the total is known are not cut, so none of their two motions can be held out."""
    truth, _ = rubbed
    measured, rng = read_set(truth.folder, truth.robot), np.random.default_rng(6)
    moving = [run for run in measured.runs if run.kind == "motion"][:2]
    runs = [
        replace(run, file=f"{k}.csv", power_time=run.time[-1:], power=run.power.mean() + 2.0 * rng.normal(size=1),
                window=np.ptp(run.time, keepdims=True), meter="total", start=100.0 * k)
        for k, run in enumerate(moving * 12)
    ]  # fmt: skip
    d = diagnose(replace(measured, runs=tuple(runs)), truth.declared).document()
    assert d["verdict"] == "insufficient" and not d["split"]["holdout"] and not d["usable"]


@pytest.mark.slow
@pytest.mark.parametrize(("samples", "word"), [(-1, "early"), (1, "late")])
def test_clocks_that_are_a_sample_apart_hide_no_cause(rubbed, tmp_path, samples, word):
    truth, tables = rubbed
    rng, shifted = np.random.default_rng(8), []
    for table in tables.values():
        own = table.copy()
        own["power"] = np.roll(table["power"], samples) + 0.5 * rng.normal(size=len(table))
        shifted.append(own[1:-1])
    verdict, names, remarks = verdict_of(truth, shifted, tmp_path / "set")
    assert (verdict, names) == ("explained", ["coulomb_friction"])
    assert any(f"{word} against the positions" in remark for remark in remarks)


def test_a_level_that_may_be_the_meters_is_stated(tmp_path):
    """A loss of the supply, which links and the meter's drift explain as well, is no cause, but is not concealed."""
    world = World("xarm7", 11120050, (0.03, 0.05), "ar1", cause="psu_loss")
    truth = write_world(world, tmp_path / "set")
    d = diagnose(read_set(truth.folder, truth.robot), truth.declared).document()
    assert d["verdict"] == "nothing_missing"
    assert any("above the declared model throughout" in remark for remark in d["remarks"])


def test_a_single_motion_has_no_interval():
    assert bootstrap_interval([0.5]) is None
    low, high = bootstrap_interval([0.5, 0.7])
    assert low == 0.5 and high == 0.7
