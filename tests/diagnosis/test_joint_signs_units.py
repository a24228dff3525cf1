"""Currents and torques with another sign or unit: the diagnosis says so, and takes no such torque for a contact."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from logs import lines, log, put
from mimic_arms import PALLETIZER

from energy_opt.diagnosis import diagnose
from energy_opt.errors import BadInput
from energy_opt.front.given import source_model
from energy_opt.measured import read_set
from energy_opt.robot import load_robot

pytest.importorskip("mujoco")
from misfit_world import Motors, World, write_world

SECOND = np.array([1.0, -1, 1, 1, 1, 1])  # the second joint alone


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A Z1 without a hidden cause, its drive constants [N m/A], and its declared model."""
    kept, before = [], Motors.__init__

    def remember(self, *rest):
        before(self, *rest)
        kept.append(self.kt)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Motors, "__init__", remember)
        folder = tmp_path_factory.mktemp("signs") / "set"
        truth = write_world(World("z1", 45, currents=True, motions=5, poses=2), folder)
    return read_set(folder, truth.robot), kept[0], truth.declared


def changed(measured, kt, factor):
    """The set with torques times a factor in place of its currents."""
    runs = (dataclasses.replace(run, effort=run.current * kt * factor, current=None) for run in measured.runs)
    return dataclasses.replace(measured, runs=tuple(runs))


def remarks(measured, declared):
    """What the diagnosis says of the joints' readings; it never takes them for a contact."""
    document = diagnose(measured, declared).document()
    assert document["verdict"] == "nothing_missing"
    said = [remark for remark in document["remarks"] if "logged" in remark or "pushed" in remark]
    assert not any("pushed" in remark for remark in said)
    return said


@pytest.mark.parametrize(("factor", "word"), [(1000.0, "mN m"), (-1.0, "opposite sign")])
def test_torques_with_another_unit_or_sign_are_named_and_not_used(recorded, factor, word):
    measured, kt, declared = recorded
    (said,) = remarks(changed(measured, kt, factor), declared)
    assert word in said and "not used" in said and all(joint in said for joint in measured.robot.joints[:5])


def test_torques_in_per_cent_of_the_effort_limit_are_named(recorded):
    measured, kt, declared = recorded
    (said,) = remarks(changed(measured, kt, 100 / measured.robot.limits.effort), declared)
    assert "% of the effort limit" in said and "not used" in said


def test_one_torque_with_the_opposite_sign_is_named_alone(recorded):
    measured, kt, declared = recorded
    (said,) = remarks(changed(measured, kt, SECOND), declared)
    assert "joint2 look like N m with the opposite sign" in said and "joint3" not in said


def test_torques_in_newton_metres_need_no_remark(recorded):
    measured, kt, declared = recorded
    assert remarks(changed(measured, kt, 1.0), declared) == []


def test_currents_with_the_opposite_sign_are_named(recorded):
    measured, _, declared = recorded
    runs = tuple(dataclasses.replace(run, current=run.current * SECOND) for run in measured.runs)
    (said,) = remarks(dataclasses.replace(measured, runs=runs), declared)
    assert "currents of joint2 have the opposite sign" in said


def test_torques_alone_in_another_unit_are_refused(recorded):
    measured, kt, declared = recorded
    mute = changed(measured, kt, 1000.0)
    nothing = np.zeros(0)
    runs = (dataclasses.replace(run, power=nothing, power_time=nothing, window=nothing) for run in mute.runs)
    with pytest.raises(BadInput, match="look like mN m"):
        diagnose(dataclasses.replace(mute, runs=tuple(runs)), declared)


def test_currents_in_milliamperes_are_named_and_not_used(recorded):
    measured, _, declared = recorded
    runs = tuple(dataclasses.replace(run, current=1000.0 * run.current) for run in measured.runs)
    document = diagnose(dataclasses.replace(measured, runs=runs), declared).document()
    assert any("currents are not used" in said and "look like mA" in said for said in document["remarks"])
    assert document["verdict"] == "nothing_missing" and not document["joint_side"]


def test_a_joint_that_slides_has_newtons_in_words_and_in_the_document(tmp_path):
    (tmp_path / "arm.urdf").write_text(PALLETIZER)
    robot, rows = load_robot(tmp_path / "arm.urdf"), []
    t = np.arange(1200) * 0.01
    rate, size = np.array([1.1, 1.7, 1.3, 2.1, 2.3]), np.array([0.8, 0.4, 0.3, 1.0, 0.02])
    middle, friction = np.array([0, 0.2, 0.4, 0, 0.025]), np.array([8.0, 9.0, 6.0, 2.0, 3.0])
    header = ["time", *(f"{j}.position" for j in robot.joints), *(f"{j}.effort" for j in robot.joints)]
    for k in range(2):
        q = middle + size * np.sin(np.outer(t, rate) + k)
        v, a = size * rate * np.cos(np.outer(t, rate) + k), -(rate**2) * (q - middle)
        tau = robot.body.torque(q, v, a) + friction * np.sign(v)
        put(tmp_path / f"{k}.csv", lines(",".join(header), [t, q, tau]))
        rows.append(f'[[run]]\nfile = "{k}.csv"\n')
    found = diagnose(read_set(log(tmp_path, "arm.urdf", "".join(rows)), meter=False), source_model(robot))
    (row,) = (x.document() for x in found.effects if x.name == "coulomb_friction")
    assert row["units"]["tau_c"] == ["N m"] * 4 + ["N"]
    assert np.allclose(row["parameters"]["tau_c"], friction, rtol=0.1)
    assert re.search(r"tau_c: j1 \S+ \[.*\] N m, .* tip_a \S+ \[.*\] N\n", str(found))
    assert re.search(r"tip_a: .* friction at \S+ m/s \S+ ± \S+ N by its own", str(found))
