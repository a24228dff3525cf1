"""An arm's electrical passport: values by hand, intervals, changes that are real, the verb."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from mimic_arms import PALLETIZER
from scipy.stats import norm

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.diagnosis.evidence.residual import mode_words, modes_of
from energy_opt.measured import read_set
from energy_opt.passports.changes import changes_since
from energy_opt.passports.sources import friction, loss, read_arm
from energy_opt.power.model import Uncertainty

DRY, OIL, HEAT = np.array([2.0, 3.0, 1.0, 0.5, 0.4, 0.3]), 0.7, 0.006


def model(dry=DRY, standby=70.0, spread=None):
    """A ur5's model; `spread` is the standard deviation of friction [N m] and standby [W]."""
    out = eo.PowerModel(
        "ur5",
        (
            eo.Standby(power=standby),
            eo.CopperLoss(r_over_kt2=[HEAT] * 6),
            eo.CoulombFriction(tau_c=list(dry)),
            eo.ViscousFriction(b=[OIL] * 6),
        ),
    )
    if spread is None:
        return out
    names = ("standby.power.0", *(f"coulomb_friction.tau_c.{k}" for k in range(6)))
    return replace(out, uncertainty=Uncertainty(names, np.eye(7) * spread**2))


def test_friction_and_loss_are_those_of_the_formulas():
    speed = np.tile([0.05, 0.4, 2.0], (6, 1))
    np.testing.assert_allclose(friction([model()], speed)[0], DRY[:, None] + OIL * speed, rtol=1e-4)
    torque, v = np.array([-40.0, 0.0, 25.0]), np.array([-1.5, 0.3, 2.0])
    for j in (0, 4):
        rubs = (DRY[j] + OIL * np.abs(v)) * np.sign(v)
        by_hand = HEAT * (torque[:, None] + rubs) ** 2 + rubs * v
        np.testing.assert_allclose(loss(model(), 6, j, torque, v), by_hand, rtol=1e-4)


def test_published_friction_is_that_of_the_paper():
    """Gaz et al. 2019: A / (1 + exp(-k (v + c))) - A / (1 + exp(-k c))."""
    arm = read_arm("panda")
    a, k, c = 1.2794, 5.5903, 0.036194  # of joint 4

    def published(v):
        return a / (1 + np.exp(-k * (v + c))) - a / (1 + np.exp(-k * c))

    expected = [(published(v) - published(-v)) / 2 for v in arm.speeds[3]]
    np.testing.assert_allclose(arm.friction[3], expected, rtol=1e-6)
    number = arm.friction_at(3, 2)
    assert number.status == "published" and "Gaz" in number.source and number.ci95 is None


def test_published_friction_of_the_ur5e_is_that_of_its_table():
    arm = read_arm("ur5e")
    torque = friction([arm.model], np.tile([0.5, 1.5, 3.2], (6, 1)))[0]
    np.testing.assert_allclose(torque[[0, 5]], [[9.5, 13.9, 17.9], [2.2, 3.0, 4.0]], rtol=1e-6)
    assert arm.number("standby", "power").status == "unknown"  # nobody published it


@pytest.mark.parametrize("name", ["ur3e", "ur10e"])
def test_friction_that_is_scaled_from_another_arms_is_assumed(name):
    """It was called published, without a source."""
    number = read_arm(name).friction_at(0, 2)
    assert number.status == "assumed" and number.source.startswith("ur5e's, scaled by the effort limit: factory")
    assert "  assumed: friction" in str(eo.robots([name])) and "published: friction" not in str(eo.robots([name]))


def test_intervals_come_from_the_covariance():
    (arm,) = eo.passport(model(spread=0.1)).arms
    number = arm.number("coulomb_friction", "tau_c", 1)
    assert number.status == "measured" and number.ci95 == pytest.approx((3.0 - 0.196, 3.0 + 0.196))
    low, high = arm.friction_at(1, 2).ci95
    assert (high - low) == pytest.approx(2 * 0.196, rel=0.15)  # the quantiles of 600 draws
    assert arm.number("copper_loss", "r_over_kt2", 2).status == "declared"


def test_a_change_is_real_where_it_is_outside_of_the_joint_intervals():
    worn = DRY + np.array([0.0, 0.0, 0.6, 0.0, 0.0, 0.0])
    made = eo.passport([model(spread=0.05), model(worn, spread=0.05)])
    real = [c for c in made.changes if c.real]
    assert {c.joint for c in real} == {"elbow_joint"} and len(real) == 3
    assert all(c.difference == pytest.approx(0.6, rel=1e-6) for c in real)
    assert "elbow_joint" in made.headline
    # seven independent numbers: the joint interval is Sidak's
    standby = next(c for c in made.changes if c.quantity == "standby")
    width = (standby.ci95[1] - standby.ci95[0]) / 2 / (0.05 * 2**0.5)
    assert width == pytest.approx(norm.ppf((1 + 0.95 ** (1 / 7)) / 2), rel=0.08)


def test_without_intervals_nobody_says_that_a_change_is_real():
    bare, careful = (eo.load_model(name, "z1") for name in ("source-method-2", "careful"))
    said = eo.passport([bare, careful]).headline  # `0 of 8 quantities differ`, although only one has friction
    assert said.endswith(" model 1: no friction is stated, so it is not compared.")
    made = eo.passport([model(), model(DRY * 1.5)])
    assert made.changes and all(c.real is None for c in made.changes)
    assert "it is unknown" in made.headline


def test_a_change_without_intervals_is_in_the_text_that_the_terminal_shows(tmp_path, capsys):
    for name, power in (("march", 88.0), ("november", 91.0)):
        (tmp_path / f"{name}.toml").write_text(MODEL.format(power=power))
    words = [str(tmp_path / f"{name}.toml") for name in ("march", "november")]
    assert main(["passport", *words, "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().err
    assert (
        "1 of the 8 quantities that both models state differ" in said
        and "7 other quantities are in report.html" in said
    )
    assert "changed: standby: 88 → 91 W (+3 %): no interval is stated" in said


MODEL = """format = "energy-opt/model/1"
robot = "panda"
[[effect]]
name = "standby"
power = {power}
[[effect]]
name = "copper_loss"
r_over_kt2 = 0.0036
"""


def test_what_has_changed_since_names_only_what_differs():
    robot = eo.load_robot("ur5")
    found = changes_since(model(spread=0.05), model(DRY * [1, 1.3, 1, 1, 1, 1], spread=0.05), robot)
    assert {c.joint for c in found} == {"shoulder_lift_joint"} and found[0].real
    assert not changes_since(model(spread=0.05), model(spread=0.05), robot)


def test_the_verb_writes_a_sheet(tmp_path, capsys):
    model(spread=0.05).save(tmp_path / "march.toml")
    model(DRY * 2, spread=0.05).save(tmp_path / "november.toml")
    words = [str(tmp_path / "march.toml"), str(tmp_path / "november.toml")]
    out = tmp_path / "out"
    assert main(["passport", *words, "--out", str(out), "--json", "--quiet"]) == 0
    document = json.loads(capsys.readouterr().out)
    written = json.loads((out / "passport.json").read_text())
    assert [row["name"] for row in written.pop("files")] == ["report.html"] and document == written
    assert [arm["label"] for arm in document["arms"]] == ["march", "november"]
    assert document["arms"][0]["standby"]["value"] == 70.0
    friction_row = document["arms"][0]["joints"][0]["friction"][-1]
    assert friction_row["torque"] == pytest.approx(2.0 + OIL * friction_row["speed"], rel=1e-4)
    assert any(row["real"] for row in document["changes"])
    assert "November" not in (out / "report.html").read_text() and "november" in (out / "report.html").read_text()
    assert main(["passport", words[0], "--out", str(out), "--quiet"]) == 2  # holds the answer to another request


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nobody"], "neither a model file nor a robot's name"),
        (["missing.toml"], "neither a model file"),
        (["careful"], "give --robot"),
        (["FILE", "--robot", "panda"], "the robot has 7 joints"),
    ],
)
def test_bad_input_is_one_line(words, said, tmp_path, capsys):
    model().save(tmp_path / "model.toml")
    words = [str(tmp_path / "model.toml") if w == "FILE" else w for w in words]
    assert main(["passport", *words, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_diagnose_says_what_has_changed_since_the_last_calibration(tmp_path, capsys):
    pytest.importorskip("mujoco")
    from misfit_world import World, write_world

    truth = write_world(World("ur5", 72, (0.0, 0.0), cause="coulomb_friction", motions=5, poses=3), tmp_path / "set")
    held = truth.declared + eo.CoulombFriction(tau_c=[0.5] * 3 + [0.1] * 3)  # a fraction of today's
    names = tuple(f"coulomb_friction.tau_c.{k}" for k in range(6))
    replace(held, uncertainty=Uncertainty(names, np.eye(6) * 0.05**2)).save(tmp_path / "last.toml")
    words = [str(truth.folder), "--model", str(tmp_path / "last.toml"), "--out", str(tmp_path / "out"), "--json"]
    assert main(["diagnose", *words, "--payload", "0.001"]) == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    real = [row for row in document["changes"] if row["real"]]
    assert real and all(row["quantity"] == "friction" and row["difference"] > 0 for row in real)
    assert f"changed since {tmp_path / 'last.toml'}: " in said.err


def test_levels_of_power_at_rest_are_found_in_a_log_and_shown(tmp_path, capsys):
    """Motors on, brakes on, drives off and back, in two poses whose holding takes different power."""
    robot, rng, step, entries = eo.load_robot("ur5"), np.random.default_rng(4), 0.02, []
    declared = eo.PowerModel("ur5", (eo.Standby(power=70.0), eo.CopperLoss(r_over_kt2=[HEAT] * 6)))
    header = ",".join(["time", *(f"{j}.position" for j in robot.joints), "power"])
    for k, pose in enumerate(([0, -0.4, 0.3, 0, 0, 0], [0, -1.5, 0, 0, 0, 0])):
        held = HEAT * float(np.sum(robot.body.torque(np.array([pose]), np.zeros((1, 6)), np.zeros((1, 6))) ** 2))
        level = np.repeat([70.0 + held, 31.0 + held, 12.0 + held, 70.0 + held], [300, 200, 150, 250])
        power = level + 0.5 * rng.normal(size=len(level))
        rows = np.column_stack([np.arange(len(level)) * step, np.tile(pose, (len(level), 1)), power])
        np.savetxt(tmp_path / f"run{k}.csv", rows, "%.6f", ",", header=header, comments="")
        entries.append(f'[[run]]\nfile = "run{k}.csv"\nkind = "static"\nstart = {60.0 * k}\n')
    (tmp_path / "log.toml").write_text('format = "energy-opt/log/1"\nrobot = "ur5"\n' + "".join(entries))
    samples = take_samples(read_set(tmp_path, robot))
    found = modes_of(declared, samples)
    np.testing.assert_allclose([m.power for m in found], [70, 31, 12], atol=0.3)
    np.testing.assert_allclose([m.seconds for m in found], [22, 8, 6], atol=0.2)
    assert [m.standstills for m in found] == [2, 2, 2] and "3 levels" in mode_words(found)[0]
    declared.save(tmp_path / "model.toml")
    document = {"robot": "ur5", "modes": [vars(m) for m in found]}
    (tmp_path / "diagnosis.json").write_text(json.dumps(document))
    assert main(["passport", str(tmp_path / "model.toml"), "--out", str(tmp_path / "sheet")]) == 0
    said = capsys.readouterr()
    assert "power at rest: 70" in said.out + said.err
    sheet = json.loads((tmp_path / "sheet" / "passport.json").read_text())
    assert [round(m["power"]) for m in sheet["arms"][0]["modes"]] == [70, 31, 12]


@pytest.mark.parametrize(("robot", "warned"), [("ur10", True), ("ur5", False)])
def test_a_model_of_another_arm_is_named(tmp_path, capsys, robot, warned):
    model().save(tmp_path / "mine.toml")
    assert main(["passport", str(tmp_path / "mine.toml"), "--robot", robot, "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr()
    assert ("warning: mine: a model of ur5, used for ur10" in shown.out + shown.err) == warned


def test_a_joint_that_slides_has_newtons(tmp_path):
    (tmp_path / "arm.urdf").write_text(PALLETIZER)
    robot = eo.load_robot(tmp_path / "arm.urdf")
    effects = (eo.Standby(power=50.0), eo.CopperLoss(r_over_kt2=0.01), eo.CoulombFriction(tau_c=[8, 9, 6, 2, 3]))
    made = eo.passport([eo.PowerModel("arm", effects)] * 2, robot)
    turning, sliding = made.document()["arms"][0]["joints"][3:]
    assert [turning["r_over_kt2"]["unit"], turning["friction"][0]["unit"]] == ["W/(N m)^2", "N m"]
    assert [sliding["r_over_kt2"]["unit"], sliding["friction"][0]["unit"]] == ["W/N^2", "N"]
    assert {c.unit for c in made.changes if c.joint == "tip_a"} == {"W/N^2", "N"}
    assert "friction 2 to 9 N m and 3 N at half" in eo.passport(eo.PowerModel("arm", effects), robot).headline
    assert any("tip_a at 0.1 m/s" in str(change) for change in made.changes)


def test_joints_that_are_held_are_not_in_a_passport(tmp_path, capsys):
    (tmp_path / "arm.urdf").write_text(PALLETIZER)
    effects = (eo.Standby(power=50.0), eo.CoulombFriction(tau_c=[8, 9, 6, 2]))
    eo.PowerModel("arm.urdf", effects).save(tmp_path / "model.toml")
    words = ["passport", str(tmp_path / "model.toml"), "--robot", str(tmp_path / "arm.urdf"), "--lock", "tip_a=0.02"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    document = json.loads((tmp_path / "out" / "passport.json").read_text())
    assert [row["joint"] for row in document["arms"][0]["joints"]] == ["j1", "j2", "j3", "j4"]
    again = eo.repeat(tmp_path / "out" / "passport.json")
    assert again.headline == document["headline"]
    with pytest.raises(eo.BadInput, match="lock belongs to a robot that is loaded"):
        eo.passport(str(tmp_path / "model.toml"), eo.load_robot("ur5"), lock={"tip_a": 0.02})


def test_a_value_that_equals_a_published_one_is_not_called_published(tmp_path):
    """A file without a source only declares its values, whatever they equal."""
    held = read_arm("ur5e")
    friction = next(name for name in held.friction_effects if held.status(name) == "published")
    held.model.save(tmp_path / "own.toml")
    text = (tmp_path / "own.toml").read_text()
    assert "source" not in text
    assert read_arm(str(tmp_path / "own.toml")).status(friction) == "declared"


def test_a_urdf_is_taken_as_the_name_of_a_robot_is(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(PALLETIZER)
    assert read_arm(str(path)).model == eo.load_model("careful", eo.load_robot(path))
    path.rename(tmp_path / "arm.urdf.xacro")
    with pytest.raises(eo.BadInput, match="xacro, not TOML"):
        read_arm(f"{path}.xacro")


def test_a_loaded_robot_is_taken_as_its_name() -> None:
    found = eo.passport(eo.load_robot("panda"))
    assert str(found) == str(eo.passport("panda"))
    assert str(eo.repeat(found.request)) == str(found)
