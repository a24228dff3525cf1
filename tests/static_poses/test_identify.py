"""The source paper's two methods, on poses with known causes."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hidden import Hidden
from logs import Z1, arm, lines, log, put
from virtual_sets import make_set

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.measured import read_set
from energy_opt.power import load_model
from energy_opt.robot import load_robot
from energy_opt.robot.catalog import CATALOG, urdf_of
from energy_opt.static_poses.methods import Pose, identify, poses_of
from energy_opt.static_poses.suggest import suggest
from energy_opt.tables import write_table


def poses(loads, power):
    return [
        Pose(f"p{k}", np.full(7, 0.1 * k), float(p), float(x), 3.0)
        for k, (x, p) in enumerate(zip(loads, power, strict=True))
    ]


def test_the_line_and_its_interval():
    rng = np.random.default_rng(1)
    inside = []
    for _ in range(200):
        load = rng.uniform(0, 2500, 8)
        found = identify("panda", poses(load, 88.04 + 0.0036 * load + 0.8 * rng.normal(size=8)))
        assert found.line is not None
        low, high = found.line["ci95"]["r_over_kt2"]
        inside.append(low <= 0.0036 <= high)
        assert 0.5 < found.line["r_squared"] <= 1
    assert 0.9 <= np.mean(inside) <= 0.99


def test_repeats_of_a_pose_are_no_further_evidence():
    """Errors of the model that differ from pose to pose: intervals from 24 records of 6 poses were half as wide."""
    rng = np.random.default_rng(2)
    inside, overhead = [], []
    for _ in range(200):
        load = np.repeat(rng.uniform(0, 2500, 6), 4)
        power = 88.04 + 0.0036 * load + np.repeat(0.8 * rng.normal(size=6), 4) + 0.1 * rng.normal(size=24)
        records = [
            Pose(f"p{k}", np.full(7, 0.1 * (k // 4) + 0.001 * rng.normal()), float(p), float(x), 3.0)
            for k, (x, p) in enumerate(zip(load, power, strict=True))
        ]
        found = identify("panda", records)
        if found.line is None:
            continue
        (low, high), (least, most) = (found.line["ci95"][name] for name in ("r_over_kt2", "standby"))
        inside.append(low <= 0.0036 <= high)
        overhead.append(least <= 88.04 <= most)
        assert "6 different poses" in found.word
    assert len(inside) > 100 and np.mean(inside) >= 0.9 and np.mean(overhead) >= 0.9


def test_poses_far_from_the_line_name_what_may_be_missing():
    """A tilted base without --base said that the poses vary little."""
    load, rng = np.linspace(100, 2000, 8), np.random.default_rng(0)
    for off, said in ((2.0, True), (0.04, False)):
        power = 88.04 + 0.0036 * load + off * rng.choice([-1, 1], 8)
        found = identify("panda", [replace(pose, noise=0.04) for pose in poses(load, power)])
        assert ("--payload" in found.word and "--base" in found.word) is said


def test_a_pose_counts_once_however_often_it_was_held():
    once = identify("panda", poses([100, 400, 900, 1600], [90.0, 91.0, 92.0, 95.0]))
    often = identify("panda", [*once.poses, *[once.poses[3]] * 5])
    assert often.standby == once.standby and often.standby_ci95 == once.standby_ci95 and often.line == once.line


def test_method_1_is_the_mean():
    found = identify("panda", poses([100, 400, 900, 1600], [90.0, 91.0, 92.0, 95.0]))
    assert found.standby == 92.0 and found.model_1().values(7).tolist() == [92.0]


def test_an_overhead_below_zero_is_reported():
    found = identify("panda", poses([1000, 1500, 2000, 2500], [3.2, 5.1, 6.8, 8.9]))
    assert found.line is not None and found.line["standby"] < 0 and "below zero" in found.word
    assert found.model_2().values(7)[0] == 0


@pytest.mark.parametrize(
    ("load", "power", "word"),
    [
        ([500, 500.0, 500, 500], [90, 91, 92, 91], "are alike"),
        ([100, 900], [90, 93], "2 different pose"),
        ([100, 400, 900], [95, 95, 95], "95 W in every pose"),
        ([500, 501, 502, 503], [90, 93, 89, 92], "do not vary enough"),
        ([100, 900, 1600, 2500], [95, 92, 90, 87], "falls with gravity torque"),
    ],
)
def test_refusals_say_why(load, power, word):
    found = identify("panda", poses(load, power))
    assert found.line is None and found.model_2() is None and word in found.word


def test_a_set_without_poses():
    with pytest.raises(BadInput, match="no static pose"):
        identify("panda", [])


def test_a_simulated_arm(tmp_path):
    pytest.importorskip("mujoco")
    made = make_set(tmp_path / "set", robot="ur5", seed=3, poses=8)
    assert main(["identify", str(tmp_path / "set"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    document = json.loads((tmp_path / "out/identify.json").read_text())
    assert abs(document["method2"]["standby"] - 92.6) < 4
    low, high = document["method2"]["ci95"]["r_over_kt2"]
    assert low <= 0.0046 and high > 0  # the heavily loaded joints have 0.004 to 0.0046
    assert load_model(tmp_path / "out/model_method2.toml").get("copper_loss") is not None
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "identify.json", "model_method1.toml", "model_method2.toml", "plot.png",
        "report.html",
    }  # fmt: skip
    assert len(poses_of(read_set(made.folder))) == 8


def test_suggested_poses_beat_random_ones(tmp_path):
    robot = load_robot("panda")
    found = suggest(robot, 8)
    assert (found.poses > robot.limits.lower).all() and (found.poses < robot.limits.upper).all()
    rng = np.random.default_rng(0)
    rest = np.zeros((8, 7))
    for _ in range(20):
        q = rng.uniform(robot.limits.lower, robot.limits.upper, (8, 7))
        load = np.sum(robot.body.torque(q, rest, rest) ** 2, axis=1)
        assert np.var(found.load) > np.var(load)
    assert main(["identify", "--suggest", "6", "--robot", "z1", "--out", str(tmp_path), "--quiet"]) == 0
    assert (tmp_path / "suggested_poses.csv").read_text().count("\n") == 7
    assert main(["identify", "--suggest", "2", "--robot", "z1", "--out", str(tmp_path), "--quiet"]) == 2


def test_suggested_poses_are_printed_as_a_table():
    found = eo.identify(robot="z1", suggest=4, self_collision=False)
    titles, *rows = str(found).splitlines()
    assert titles.split() == [*load_robot("z1").joints, "torque^2"]
    np.testing.assert_allclose([[float(x) for x in row.split()][:-1] for row in rows], found["poses"], atol=1e-4)


def test_poses_of_an_arm_on_a_wall(tmp_path):
    """--base turns gravity: loads of an upright arm gave another copper loss."""
    whole = pin.buildModelFromUrdf(str(urdf_of(CATALOG["z1"])))
    body = pin.buildReducedModel(whole, [whole.getJointId("jointGripper")], pin.neutral(whole))
    body.gravity.linear = np.array([0.0, -9.81 * np.sin(1.2), -9.81 * np.cos(1.2)])
    header = ["time", *(f"{joint}.position" for joint in body.names[1:]), "power"]
    time, records = np.arange(0, 2, 0.02), []
    for k, q in enumerate(np.random.default_rng(1).uniform(-0.5, 0.5, (8, 6)) + [0, 1.5, -1.5, 0, 0, 0]):
        load = np.sum(pin.computeGeneralizedGravity(body, body.createData(), q) ** 2)
        columns = [time, *(np.full_like(time, x) for x in q), np.full_like(time, 50 + 0.01 * load)]
        write_table(tmp_path / f"{k}.csv", header, columns)
        records.append(f'[[run]]\nfile = "{k}.csv"\nkind = "static"\n')
    (tmp_path / "log.toml").write_text('format = "energy-opt/log/1"\nrobot = "z1"\n' + "".join(records))
    found = eo.identify(tmp_path, base=[0, 0, 0, 1.2, 0, 0]).line
    assert found["standby"] == pytest.approx(50, abs=0.1) and found["r_over_kt2"] == pytest.approx(0.01, rel=1e-2)


def test_a_recording_gives_its_standstills_as_poses(tmp_path):
    """Without a run that is called static: rests of 4 s between moves, at a power that follows the load."""
    robot = load_robot("z1")
    rng = np.random.default_rng(3)
    q = rng.uniform(-1, 1, (6, 6)) * 0.5 + robot.limits.near_zero + [0, 1, -1, 0, 0, 0]
    time = np.arange(0, 30, 0.01)
    share = np.clip((time % 5 - 4) / 1.0, 0, 1)
    at = np.minimum(time // 5, 5).astype(int)
    position = q[at] + (q[np.minimum(at + 1, 5)] - q[at]) * (share**2 * (3 - 2 * share))[:, None]
    none = np.zeros_like(q)
    load = (robot.body.torque(q, none, none) ** 2).sum(axis=1)
    still = np.concatenate([[True], np.abs(np.diff(position, axis=0)).max(axis=1) < 1e-12])
    power = np.where(still, 50 + 0.01 * load[at], 500.0) + rng.normal(0, 0.05, len(time))
    header = ["time", *(f"{joint}.position" for joint in robot.joints), "power"]
    write_table(tmp_path / "a.csv", header, [time, *position.T, power])
    (tmp_path / "log.toml").write_text('format = "energy-opt/log/1"\nrobot = "z1"\n[[run]]\nfile = "a.csv"\n')
    found = poses_of(read_set(tmp_path))
    assert len(found) == 6
    np.testing.assert_allclose([pose.load for pose in found], load, rtol=1e-6)
    line = identify("z1", found).line
    assert line["standby"] == pytest.approx(50, rel=1e-3) and line["r_over_kt2"] == pytest.approx(0.01, rel=1e-2)


def test_a_run_that_is_called_static_and_moves_is_refused(tmp_path):
    t, q, _, p = arm(Z1)
    put(tmp_path / "a.csv", lines(",".join(["time", *(f"{j}.position" for j in Z1.joints), "power"]), [t, q, p]))
    measured = read_set(log(tmp_path, "z1", '[[run]]\nfile = "a.csv"\nkind = "static"\n'))
    with pytest.raises(BadInput, match=r"a.csv: column joint\d.position: moves by .* rad in a run called static"):
        poses_of(measured)


@pytest.mark.parametrize("masses", [(2.5, 2.5), (0.0, 2.5)])
def test_the_payload_that_the_recorder_states_hangs_on_the_arm(tmp_path, capsys, masses):
    """RTDE writes the payload that is set on a UR; of several none is used, and that is said."""
    ur, rng, rest = Hidden("ur5e"), np.random.default_rng(2), '[columns]\npreset = "ur_rtde"\n'
    none, bare = np.zeros(6), ur.model.inertias[6].copy()
    header = ["timestamp", *(f"actual_q_{k}" for k in range(6)), "actual_robot_voltage", "actual_robot_current",
              "payload", *(f"payload_cog_{k}" for k in range(3))]  # fmt: skip
    for k in range(10):
        mass, q = masses[k % 2], rng.uniform(*ur.limits)
        ur.model.inertias[6] = bare + pin.Inertia(mass, np.array([0, 0, 0.1]), np.zeros((3, 3)))
        torque = pin.rnea(ur.model, ur.model.createData(), q, none, none)
        current = (60 + 0.004 * torque @ torque + 0.05 * rng.normal(size=100)) / 48
        columns = [0.02 * np.arange(100), *np.tile(q, (100, 1)).T, np.full(100, 48.0), current, np.full(100, mass)]
        write_table(tmp_path / f"{k}.csv", header, [*columns, *np.tile([0, 0, 0.1], (100, 1)).T])
        rest += f'[[run]]\nfile = "{k}.csv"\nkind = "static"\n'
    log(tmp_path, "ur5e", rest)
    assert main(["identify", str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    said, line = capsys.readouterr().err, json.loads((tmp_path / "out/identify.json").read_text())["method2"]
    if masses[0] > 0:
        assert "carries 2.5 kg, as its recorder states" in said
        assert line["r_over_kt2"] == pytest.approx(0.004, rel=0.01) and line["standby"] == pytest.approx(60, abs=0.1)
    else:
        assert "the recorder states several payloads (0 to 2.5 kg): none is used" in said
