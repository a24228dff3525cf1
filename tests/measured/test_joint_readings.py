"""Currents beside the power, on arms whose links and laws are not the library's (`benchmarks/misfit_world.py`)."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from energy_opt.cli.main import main
from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.joint_side import free_runs, joint_side, pushes
from energy_opt.measured import read_set
from energy_opt.power import load_model

pytest.importorskip("mujoco")
from misfit_world import Motors, World, write_world


def made(folder: Path, world: World):
    truth = write_world(world, folder)
    return read_set(folder, truth.robot, meter=False), truth


@pytest.fixture
def drags():
    """The worlds' true drives, by their seed."""
    kept: dict[int, Motors] = {}
    before = Motors.__init__

    def remember(self, world, *rest):
        before(self, world, *rest)
        kept[world.seed] = self

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Motors, "__init__", remember)
        yield kept


def test_friction_and_constants_from_currents_alone(tmp_path, drags, capsys):
    measured, _ = made(
        tmp_path / "set", World("xarm7", 44, cause="coulomb_friction", currents=True, metered=False, motions=5, poses=2)
    )
    law = drags[44]
    assert not any(len(run.power) for run in measured.runs)
    out = tmp_path / "out"
    assert main(["diagnose", str(tmp_path / "set"), "--out", str(out), "--json", "--quiet"]) == 0
    document = json.loads(capsys.readouterr().out)
    rows = document["joint_side"]
    np.testing.assert_allclose([row["scale"] for row in rows], law.kt, rtol=0.1)  # links are off by up to 10 %
    found = next(row for row in document["effects"] if row["name"] == "coulomb_friction")
    size = float((tmp_path / "set/size.txt").read_text())
    low, high = np.array(found["ci95"]["tau_c"]).T
    assert ((low <= size * law.drag) & (size * law.drag <= high)).all()
    assert [row["name"] for row in document["effects"]] == ["coulomb_friction"]
    assert document["verdict"] == "insufficient" and "meter" in document["headline"]
    assert load_model(out / "model.toml").get("coulomb_friction") is not None
    assert "by its own readings" in (out / "report.html").read_text()


def test_no_friction_is_seen_where_there_is_none(tmp_path):
    measured, truth = made(tmp_path / "set", World("z1", 45, currents=True, noise="ar1", motions=4, poses=2))
    side = joint_side(measured, truth.declared)
    assert side is not None and not pushes(side, measured)
    for j, effort in enumerate(measured.robot.limits.effort):
        assert abs(side.friction(j, 0.3)[0]) < 1e-3 * effort


def _led(run, robot):
    """The run as if a hand had led the arm through it: motors carry its weight, and the hand more than the friction."""
    v = np.gradient(run.position, run.time, axis=0)
    gravity = robot.body.torque(run.position, 0 * v, 0 * v)
    return dataclasses.replace(run, current=(gravity - 0.03 * robot.limits.effort * np.tanh(v / 0.01)) / 10.0)


def test_a_hand_on_the_arm_is_seen_and_its_runs_are_left_out(tmp_path):
    measured, truth = made(
        tmp_path / "set", World("panda", 42, cause="viscous_friction", currents=True, pushed=(4, 6), motions=5, poses=2)
    )
    side = joint_side(measured, truth.declared)
    found = pushes(side, measured)
    assert [p.file for p in found] == ["run05.csv", "run07.csv"]
    led = dataclasses.replace(measured, runs=tuple(_led(run, measured.robot) for run in measured.runs))
    assert not free_runs(led, pushes(joint_side(led, truth.declared), led))[1]
    kept, enough = free_runs(measured, found)
    assert enough and len(kept.runs) == len(measured.runs) - 2
    alone = dataclasses.replace(measured, runs=tuple(r for r in measured.runs if r.kind == "static" or r.file in (
        "run05.csv", "run07.csv")))  # fmt: skip
    document = diagnose(alone, truth.declared).document()
    assert document["effects"] == [] and document["verdict"] == "insufficient"
    assert any("pushed" in remark for remark in document["remarks"])


def test_currents_settle_what_the_power_leaves_open(tmp_path, drags):
    """Both sides are shown, agree with the truth, and together are narrower than the power alone."""
    measured, truth = made(
        tmp_path / "set", World("ur5", 41, cause="coulomb_friction", currents=True, motions=6, poses=2)
    )
    result = diagnose(measured, truth.declared)
    assert [row["name"] for row in result.document()["effects"]] == ["coulomb_friction"]
    true = float((tmp_path / "set/size.txt").read_text()) * drags[41].drag
    for row, c in zip(result.document()["joint_side"], true, strict=True):
        for key in ("own", "together"):
            low, high = row[key]["ci95"]
            assert low <= c <= high, (row["joint"], key)
        assert np.ptp(row["together"]["ci95"]) < np.ptp(row["power"]["ci95"])
        assert row["disagreement"] < 3
