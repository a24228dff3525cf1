"""Trajectories and logs of an arm with joints that follow others: planned, written, read back, imported, diagnosed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from independent import Arm
from mimic_arms import GOAL, PALLETIZER, PALLETIZER_ALL, START

from energy_opt import load_robot
from energy_opt.cli.main import main
from energy_opt.diagnosis.data import predict
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.effects import LinkInertia, Payload
from energy_opt.formats import read_trajectory
from energy_opt.measured import read_set
from energy_opt.measured.names import joint_columns
from energy_opt.power import PowerModel
from energy_opt.power.drive_law import rigid_torque


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "palletizer.urdf").write_text(PALLETIZER)
    return tmp_path


def test_a_move_of_the_palletizer_from_end_to_end(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Planned around its own body and a floor, proven, written, read back, retimed; the page plays all joints."""
    urdf, out = str(files / "palletizer.urdf"), tmp_path / "out"
    ends = ["--start", ",".join(map(str, START)), "--goal", ",".join(map(str, GOAL))]
    common, model = ["--robot", urdf, "--quiet", "--floor", "-0.05"], ["--model", "source-method-2"]
    assert main(["optimize", *common, *model, *ends, "--duration", "1.5", "--write", "yaml", "--out", str(out)]) == 0
    result = json.loads((out / "result.json").read_text())
    assert result["status"] == "solved" and result["certificate"]["clearance"]["verdict"] == "proven"
    assert result["joints"] == ["j1", "j2", "j3", "j4", "tip_a"] and result["saving"]["loss_percent"] > 5
    t = read_trajectory(out / "trajectory.csv", load_robot(urdf).joints)
    arm = Arm(PALLETIZER, PALLETIZER_ALL)
    picked = np.array([0, 1, 1, 2, 2, 3, 4, 4, 1]), np.array([1, 1, -1, 1, -1, 1, 1, -1, 1])
    full = arm.torque(*(x[:, picked[0]] * picked[1] for x in (t.position, t.velocity, t.acceleration)))
    both = full * picked[1]
    joined = np.stack([both[:, picked[0] == j].sum(axis=1) for j in range(5)], axis=1)
    table = np.genfromtxt(out / "trajectory.csv", delimiter=",", names=True, deletechars="")
    effort = np.stack([table[f"{joint}.effort"] for joint in result["joints"]], axis=1)
    assert np.allclose(effort, joined, atol=1e-6)
    assert main(["check", *common, str(out / "trajectory.yaml")]) == 0
    again = ["--path", str(out / "trajectory.yaml"), "--mode", "retime", "--out", str(tmp_path / "again")]
    assert main(["optimize", *common, *model, *again, "--duration", "1.5"]) == 0
    locked = tmp_path / "locked.yaml"  # as MoveIt's plan of the arm's group: without the gripper
    locked.write_text((out / "trajectory.yaml").read_text().replace("'tip_a'", "'another'"))
    assert main(["check", *common, "--lock", "tip_a=0.01", str(locked)]) == 0
    plant = tmp_path / "plant.toml"
    plant.write_text('format = "energy-opt/model/1"\n[[effect]]\nname = "standby"\npower = 50.0\n')
    played = ["--robot", urdf, "--plant", str(plant), "--out", str(tmp_path / "virtual")]
    assert main(["simulate", str(out / "trajectory.yaml"), *played]) == 2
    assert (
        "j2_plate follows j2 (mimic), which the virtual arm does not support; use --lock j2=VALUE"
        in capsys.readouterr().err
    )
    assert main(["robots", urdf, "--quiet"]) == 0
    assert "tip_b                    follows: -1 times tip_a\n" in capsys.readouterr().out


def test_columns_of_followers_and_locked_joints_are_no_others(files: Path) -> None:
    """`j2_plate`, which turns the other way, was read as j2 where j2 was missing; q2, the plate's, as j3."""
    arm = load_robot(files / "palletizer.urdf")
    named = [f"{joint}.position" for joint in PALLETIZER_ALL]
    assert set(joint_columns(named, arm)["position"]) == set(arm.joints)
    assert not joint_columns([name for name in named if name != "j2.position"], arm)
    own = {"j1": "q0", "j2": "q1", "j3": "q4", "j4": "q6", "tip_a": "q7"}  # in the order of the file
    assert joint_columns([f"q{k}" for k in range(9)], arm)["position"] == own
    held = load_robot(files / "palletizer.urdf", lock={"j3": 0.2})
    assert joint_columns([f"q{k}" for k in range(9)], held)["position"] == {k: v for k, v in own.items() if k != "j3"}
    assert list(joint_columns([f"q{k}" for k in range(5)], arm)["position"]) == list(arm.joints)


def test_a_log_without_the_gripper_is_a_set(files: Path, tmp_path: Path) -> None:
    """Imported and checked with the gripper held; with links off and a payload, diagnosis has Pinocchio's torque."""
    time, held = np.arange(0, 4, 0.01), load_robot(files / "palletizer.urdf", lock={"tip_a": 0.02})
    turn = 1 - np.cos(2 * np.pi * time / 4)
    q = np.outer(turn, [0.3, 0.2, 0.2, 0.4])
    rate = np.outer(np.sin(2 * np.pi * time / 4) * np.pi / 2, [0.3, 0.2, 0.2, 0.4])
    power = 60 + np.sum(held.body.torque(q, rate, np.gradient(rate, time, axis=0)) * rate, axis=1)
    names = ",".join(f"{joint}.position" for joint in held.joints)
    rows = np.column_stack([time, q, power])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=f"time,{names},power", comments="")
    urdf, lock = str(files / "palletizer.urdf"), ["--lock", "tip_a=0.02"]
    words = ["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "set"), "--quiet"]
    assert main([*words, "--robot", urdf]) == 2 and main([*words, *lock]) == 2
    assert main([*words, "--robot", urdf, *lock]) == 0
    assert main(["check", str(tmp_path / "set"), "--quiet"]) == 2
    assert main(["check", str(tmp_path / "set"), "--quiet", *lock]) == 0
    samples = take_samples(read_set(tmp_path / "set", held))
    links = LinkInertia(mass=[0.5, 0.4, 0.3, 0.2], com=np.full((4, 3), 0.01), inertia=np.full((4, 6), 1e-3))
    model = PowerModel("palletizer", (Payload(mass=2.0, com=[0.01, 0.0, -0.1]), links))
    found, _ = predict.rigid_torque(model, samples)
    assert np.allclose(found, rigid_torque(model, held.body, samples.q, samples.v, samples.a), atol=1e-8)
