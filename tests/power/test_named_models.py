"""Models by name: friction as it is published, evaluated from the publication's own formula; no regeneration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.batches.suite import load_suite
from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.front.bench import overrides_of
from energy_opt.front.given import model_from
from energy_opt.front.models import rivals_from
from energy_opt.power import drive_function
from energy_opt.power.known import careful, load_model, named_model
from energy_opt.requests.verbs import BenchRequest
from energy_opt.robot import load_robot

# Gaz et al. 2019: delta_1 [N m], delta_2 [s/rad], delta_3 [rad/s]
A = np.array([5.4615e-1, 8.7224e-1, 6.4068e-1, 1.2794, 8.3904e-1, 3.0301e-1, 5.6489e-1])
K = np.array([5.1181, 9.0657, 1.0136e1, 5.5903, 8.3469, 1.7133e1, 1.0336e1])
C = np.array([3.9533e-2, 2.5882e-2, -4.6070e-2, 3.6194e-2, 2.6226e-2, -2.1047e-2, 3.5526e-3])


def test_careful_is_published_friction_and_no_regeneration():
    model = careful("panda")
    function, names = drive_function(model, 7)
    rng = np.random.default_rng(0)
    for v in rng.uniform(-2, 2, (5, 7)):
        tau = rng.uniform(-30, 30, 7)
        tau_m, power, _ = (np.array(x).ravel() for x in function(0 * v, v, 0 * v, tau, 0.0, model.values(7)))
        friction = A / (1 + np.exp(-K * (v + C))) - A / (1 + np.exp(-K * C))
        np.testing.assert_allclose(tau_m, tau + friction, rtol=1e-10)
        drive = tau_m @ v + 0.0036 * tau_m @ tau_m
        assert power[0] == pytest.approx(88.04 + max(drive, 0.0), rel=1e-12)
    still = function(0 * v, 0 * v, 0 * v, tau, 0.0, model.values(7))[0]
    np.testing.assert_allclose(np.array(still).ravel(), tau, atol=1e-15)
    assert "sigmoid_friction" in names and careful("ur5").get("sigmoid_friction") is None


@pytest.mark.parametrize("effort, speed, mass", [(4e6, 0.3, 2e4), (1e-6, 50.0, 1e-5)])
def test_assumed_values_of_very_strong_and_weak_arms_are_within_the_bounds(
    tmp_path: Path, effort: float, speed: float, mass: float
) -> None:
    """A crane was refused for 1.07e6 N m s/rad, an arm of 1e-6 N m for 5e6 W/(N m)^2."""
    path = tmp_path / "arm.urdf"
    path.write_text(f"""<robot name="arm"><link name="base"/><link name="boom"><inertial><mass value="{mass}"/>
        <inertia ixx="{mass}" iyy="{mass}" izz="{mass}" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="boom"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" velocity="{speed}" effort="{effort}"/></joint></robot>""")
    robot = load_robot(path)
    for name in ("careful", "source-method-2"):
        named_model(name, robot).check(robot.n)


def test_names_are_taken_everywhere(tmp_path, capsys):
    assert load_model("careful", "ur5") == careful("ur5")
    assert load_model("source_method_1", "panda") == eo.source_model("panda", 1)
    (tmp_path / "s.toml").write_text(
        'format = "energy-opt/suite/1"\nname = "s"\nrobots = ["panda", "ur5"]\nrandom = { count = 1 }\n'
        'models = ["careful", "source-method-2"]\n'
    )
    assert main(["bench", str(tmp_path / "s.toml"), "--model", "carefool", "--out", str(tmp_path / "out")]) == 2
    assert "carefool' is neither a model file" in capsys.readouterr().err
    overrides = overrides_of(BenchRequest("s.toml", model="careful"))
    models = {task.model for task in load_suite(tmp_path / "s.toml", overrides=overrides).tasks}
    assert models == {"careful"}
    effects = [[e.name for e in task.power().effects] for task in load_suite(tmp_path / "s.toml").tasks]
    assert [("sigmoid_friction" in names) for names in effects] == [True, False, False, False]


def test_a_move_under_published_friction_is_planned(panda):
    ends = {"start": [0, -0.785, 0, -2.356, 0, 1.571, 0.785], "goal": [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]}
    result = eo.optimize(panda, "careful", **ends, duration=2.5, starts=1, controls=16, compile="never")
    assert result.status == "solved" and result.certificate.valid
    assert result.energy.by_effect["sigmoid_friction"] > 0 and result.saving["loss_percent"] > 5


def test_a_model_file_may_say_where_its_values_come_from(tmp_path):
    text = 'format = "energy-opt/model/1"\nrobot = "panda"\n[[effect]]\nname = "standby"\npower = 88.0\nsource = {}\n'
    (tmp_path / "m.toml").write_text(text.format('"the data sheet"'))
    assert load_model(tmp_path / "m.toml", "panda").get("standby").full(7) == 88.0
    (tmp_path / "m.toml").write_text(text.format("3"))
    with pytest.raises(eo.BadInput, match=r"effect 1 \(standby\): source = 3; expected text"):
        load_model(tmp_path / "m.toml", "panda")


@pytest.mark.parametrize(
    ("name", "effects"),
    [("panda", ["standby", "copper_loss", "sigmoid_friction"]), ("ur5e", ["copper_loss", "friction_curve"])],
)
def test_published_values_of_an_arm_are_a_model_file(name, effects):
    file = Path(eo.__file__).parent / "power" / "published" / f"{name}.toml"
    model = load_model(file, name)
    model.check(eo.load_robot(name).n)
    assert [e.name for e in model.effects] == effects


def test_a_locked_joint_leaves_the_lists_of_every_model(tmp_path: Path) -> None:
    """Of the careful model, of a file for the whole arm with its covariance, and of one for the arm as it is locked."""
    robot = load_robot("panda", lock={"panda_joint3": 0.1})
    whole = named_model("careful", "panda")
    rivals, _ = rivals_from([], None, robot)
    values = rivals[1].model.get("sigmoid_friction").values
    assert values["a"].tolist() == np.delete(whole.get("sigmoid_friction").values["a"], 2).tolist()
    text = (
        'format = "energy-opt/model/1"\nrobot = "panda"\n[[effect]]\nname = "viscous_friction"\n'
        "b = [1, 2, 3, 4, 5, 6, 7]\n"
        '[covariance]\nnames = ["viscous_friction.b.2", "viscous_friction.b.3"]\nmatrix = [[1.0, 0.5], [0.5, 4.0]]\n'
    )
    (tmp_path / "m.toml").write_text(text)
    model = model_from(str(tmp_path / "m.toml"), robot)
    assert model.get("viscous_friction").values["b"].tolist() == [1, 2, 4, 5, 6, 7]
    assert model.uncertainty.names == ("viscous_friction.b.2",) and model.uncertainty.matrix.tolist() == [[4.0]]
    assert model_from(model, robot) == model  # one entry for each joint that moves is taken as it is


def test_a_named_model_as_an_object() -> None:
    ur5 = load_robot("ur5")
    assert eo.load_model("careful", ur5) == careful("ur5")
    with pytest.raises(BadInput, match=r"depends on the robot; expected load_model\('careful', robot\)"):
        eo.load_model("careful")
    with pytest.raises(BadInput, match="neither a model file nor a name"):
        eo.load_model("carefull", ur5)
