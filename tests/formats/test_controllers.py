"""What is written for controllers: samples at a rate, programs for UR arms (run here), positions for libfranka."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from poses import GOAL, START
from swings import UR_GOAL, UR_START, swing
from urscript_arm import Controller

from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.formats import controller_files, read_trajectory, urscript, write
from energy_opt.formats.judging import Judging
from energy_opt.formats.resample import RATES, fitted, on_steps, resampled, worst_steps
from energy_opt.motion.judge.certificate import certify
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.trajectory import Trajectory, whole
from energy_opt.power import PowerModel
from energy_opt.profiles import Chain
from energy_opt.profiles.movej import blend_radii, leading, tool_point
from energy_opt.robot import Robot, load_robot


@settings(max_examples=60, deadline=None)
@given(st.floats(0.2, 6.0), st.floats(3.0, 2000.0))
def test_samples_rise_from_zero_to_exactly_the_end(duration: float, rate: float) -> None:
    curve = swing(("a",), np.zeros(1), np.ones(1), duration, 60)
    out = resampled(replace(curve, time=curve.time + 3.0), rate)
    assert out.time[0] == 0 and out.time[-1] == pytest.approx(duration, abs=0.51e-9) and (np.diff(out.time) > 0).all()
    np.testing.assert_array_equal(out.position[-1], [1.0])
    np.testing.assert_array_equal(out.time, whole(out.time))
    inner = out.time[:-1]
    np.testing.assert_allclose(inner, np.arange(len(inner)) / rate, rtol=0, atol=0.51e-9)
    assert 0.09 / rate <= np.diff(out.time)[-1] <= 1.11 / rate  # a much shorter step magnifies rounding of the jerk
    assert out.position[:-1] == pytest.approx(curve.sample(inner)[0], abs=1e-12)


@pytest.fixture(scope="module")
def bend(panda: Robot, model: PowerModel) -> tuple[Trajectory, Scorer]:
    """A move at nine tenths of its velocity limit, with a wiggle that coarse samples miss."""
    curve = swing(panda.joints, START, GOAL, 2.5)
    t, w = curve.time[:, None], 2 * np.pi * 14 / 2.5
    window = np.sin(np.pi * t / 2.5) ** 4
    change = 2 * np.sin(np.pi * t / 2.5) ** 3 * np.cos(np.pi * t / 2.5) * 2 * np.pi / 2.5
    q = curve.position + 0.003 * window * np.sin(w * t)
    v = curve.velocity + 0.003 * (window * w * np.cos(w * t) + change * np.sin(w * t))
    a = np.gradient(v, curve.time, axis=0)
    return Trajectory(panda.joints, curve.time, q, v, a), Scorer(panda, model)


def test_a_rate_that_does_not_hold_is_slowed_or_replaced(bend: tuple[Trajectory, Scorer]) -> None:
    """By thousandths where these do, else by the lowest rate that holds; the answer is written in any case."""
    curve, scorer = bend
    limits = scorer.robot.limits
    dense = np.abs(curve.sample(curve.denser(10))[2]).max(axis=0)

    roomy = limits.replace(acceleration=dense * 1.002)

    def judge(trajectory: Trajectory, bounds: Any = roomy) -> Any:
        return certify(trajectory, scorer, joint_limits(bounds))

    assert judge(curve).valid
    moving = curve.part(slice(60, 341))  # it cannot be slowed: its speed at both ends is given
    asked = max((8, 9, 10, 11), key=lambda r: judge(resampled(moving, r)).violation)
    coarse = fitted(moving, asked, judge)
    assert coarse.rate in RATES and coarse.rate > asked and f"samples at {asked} Hz" in coarse.why
    assert judge(coarse.trajectory).valid and coarse.trajectory.duration == pytest.approx(moving.duration, abs=1e-9)
    assert all(not judge(resampled(moving, r)).valid for r in RATES if asked <= r < coarse.rate)
    tight = limits.replace(acceleration=dense * 1.0001)
    rate = max(r for r in RATES if 1e-6 < certify(resampled(curve, r), scorer, joint_limits(tight)).violation < 0.02)
    slow = fitted(curve, rate, lambda trajectory: judge(trajectory, tight))
    assert slow.rate == rate and 0 < slow.trajectory.duration / curve.duration - 1 < 0.02
    assert judge(slow.trajectory, tight).valid and slow.trajectory.time[1] == 1 / rate
    impossible = limits.replace(lower=np.full(7, -0.1), upper=np.full(7, 0.1))
    left = fitted(curve, 100, lambda trajectory: judge(trajectory, impossible))
    assert left.rate is None and left.trajectory is curve and "position" in left.why
    for rate in (0, -1, np.inf, 1e9):
        with pytest.raises(BadInput, match="expected samples per second"):
            resampled(curve, rate)


def test_all_formats_at_a_rate(tmp_path: Path, bend: tuple[Trajectory, Scorer], panda: Robot) -> None:
    """Each read back: the same rows; with effort of the model at these rows; under the prefix."""
    curve, scorer = bend

    judge = Judging(scorer, joint_limits(panda.limits))
    names = ["csv", "yaml", "json", "mcap", "follow-joint-trajectory", "csv"]
    rows = controller_files.write(curve, judge, controller_files.wanted(names), tmp_path, 200.0, "left_")
    assert len(rows) == 5 and all("200 Hz, quintic between points" in str(row) for row in rows)
    assert all(row.valid and row.rate == 200 and row.worst["joint"] in panda.joints for row in rows)
    expected = resampled(curve, 200.0)
    torque = scorer.filled(expected).effort
    files = ["trajectory_200hz.csv", "trajectory.yaml", "trajectory.json", "trajectory.mcap", "trajectory.goal.yaml"]
    for name in files:
        again = read_trajectory(tmp_path / name, panda.joints, "left_")
        np.testing.assert_array_equal(again.position, expected.position)
        np.testing.assert_array_equal(again.acceleration, expected.acceleration)
        np.testing.assert_array_equal(again.effort, torque)
        np.testing.assert_allclose(again.time, expected.time, rtol=0, atol=0 if "csv" in name else 0.51e-9)
    with pytest.raises(BadInput, match=r"'jsn'; known are csv, yaml, .*did you mean 'json'"):
        controller_files.wanted(["jsn"])
    write(expected, tmp_path / "x.goal.yaml")
    assert "goal_time_tolerance" in (tmp_path / "x.goal.yaml").read_text()
    with pytest.raises(BadInput, match="no format has this ending"):
        write(expected, tmp_path / "x.docx")


@pytest.mark.parametrize(("pace", "step"), [(1.0, 0.002), (0.3, 0.002), (1.0, 0.008)])
def test_the_ur_program_follows_the_trajectory(tmp_path: Path, ur5: Robot, pace: float, step: float) -> None:
    curve = swing(ur5.joints, UR_START, UR_GOAL, 1.2357)
    urscript.write(resampled(curve, 50), tmp_path / "m.script")
    arm = Controller(UR_START, step)
    text = (tmp_path / "m.script").read_text()
    inner = text[text.index("  def quintic") : text.index("    return t - h")]  # uses nothing that it is not handed
    assert not {"get_steptime", "goal", "here", "start"} & set(re.findall(r"[a-z_]+", inner))
    assert re.search(r"def quintic\(.*\bdt, speed\):", inner)
    arm.run(text, speed=repr(pace))
    sent = np.array([q for _, q in arm.sent])
    time = np.arange(1, len(sent)) * step * pace
    assert time[-1] <= curve.duration < time[-1] + step * pace
    np.testing.assert_allclose(sent[:-1], resampled(curve, 50).sample(time)[0], atol=5e-9)
    np.testing.assert_allclose(sent[-1], UR_GOAL, atol=1e-9)
    with pytest.raises(StopIteration):
        Controller(UR_START + [0, 0, 0, 0.02, 0, 0], step).run((tmp_path / "m.script").read_text())


def test_the_ur_program_streams_at_500_hz(tmp_path: Path, ur5: Robot) -> None:
    curve = resampled(swing(ur5.joints, UR_START, UR_GOAL, 0.9), 500)
    urscript.write(curve, tmp_path / "m.script")
    text = (tmp_path / "m.script").read_text()
    assert "quintic" not in text
    arm = Controller(UR_START)
    arm.run(text)
    np.testing.assert_allclose([q for _, q in arm.sent], curve.position[1:], atol=1e-9)
    assert all(t == pytest.approx(0.002) for t, _ in arm.sent)
    with pytest.raises(BadInput, match="arms of six joints; this one has 2"):
        urscript.write(swing(("a", "b"), UR_START[:2], UR_GOAL[:2], 0.9), tmp_path / "n.script")


def differences_hold(file: Path, limits: Any) -> None:
    """libfranka's look at a file: differences of its own numbers, from rest before it to rest after it."""
    q = np.loadtxt(file, delimiter=",", skiprows=1)[:, 1:]
    q = np.vstack([[q[0]] * 3, q, [q[-1]] * 3])
    for order, bound in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1):
        assert (np.abs(np.diff(q, order, axis=0)) * 1000**order <= bound * (1 + 1e-6)).all()


def test_positions_for_libfranka_hold_its_checks(tmp_path: Path, panda: Robot, model: PowerModel) -> None:
    """Slowed by thousandths where they would not; with an acceleration at the start, spread over some steps."""
    curve = swing(panda.joints, START, GOAL, 1.5004)
    judge = Judging(Scorer(panda, model), joint_limits(panda.limits))
    fast = curve.slowed(1.5004 * 0.99 * np.abs(curve.velocity / panda.limits.velocity).max())
    x = np.linspace(0, 1, 401)[:, None]  # cubic: it begins and ends with an acceleration
    d, T = 0.2 * (GOAL - START), 0.5
    cubic = Trajectory(panda.joints, x[:, 0] * T, START + d * x**2 * (3 - 2 * x), d * 6 * x * (1 - x) / T,
                       d * 6 * (1 - 2 * x) / T**2)  # fmt: skip
    steps = worst_steps(on_steps(cubic, 1000), 1000, panda.limits)
    assert max(steps, key=lambda violation: violation.excess or 0.0).limit == "jerk"
    for k, motion in enumerate((curve, fast, cubic)):
        (row,) = controller_files.write(motion, judge, controller_files.wanted(["franka"]), tmp_path)
        assert row.valid and row.file == "trajectory.franka.csv" and row.rate == 1000
        differences_hold(tmp_path / row.file, panda.limits)
        rows = np.loadtxt(tmp_path / row.file, delimiter=",", skiprows=1)
        np.testing.assert_allclose(rows[[0, -1], 1:], motion.position[[0, -1]], atol=1e-15)
        assert rows[-1, 0] - motion.duration == pytest.approx(0, abs=[0.001, 0.03, 0.03][k]), row
    steps = np.loadtxt(tmp_path / "trajectory.franka.csv", delimiter=",", skiprows=1)[:, 0]
    np.testing.assert_allclose(steps, np.arange(len(steps)) / 1000, atol=1e-12)
    for rate, said in ((None, []), (1000, []), (100, ["--rate 100 is not used"])):
        (row,) = controller_files.write(curve, judge, controller_files.wanted(["franka"]), tmp_path, rate)
        warnings = controller_files.warnings_on([row], rate)
        assert len(warnings) == len(said) and all(words in warnings[0] for words in said)


def test_a_file_that_does_not_hold_says_so(tmp_path: Path, panda: Robot, model: PowerModel) -> None:
    judge = Judging(Scorer(panda, model), joint_limits(panda.limits))
    curve = swing(panda.joints, START, GOAL, 0.5)
    for name in ("franka", "yaml"):
        (row,) = controller_files.write(curve, judge, controller_files.wanted([name]), tmp_path)
        assert not row.valid and "THIS FILE BREAKS A LIMIT: " in str(row) and row.worst["joint"] in panda.joints
    with pytest.raises(BadInput, match="write franka: for arms of seven joints; this one has 6"):
        controller_files.wanted(["franka"], 6)
    with pytest.raises(BadInput, match="write urscript: for arms of six joints; this one has 7"):
        controller_files.wanted(["urscript"], 7)


def test_a_file_that_is_valid_under_assumed_limits_says_so(tmp_path: Path, panda: Robot, model: PowerModel) -> None:
    """A file for an FR3 was called valid at accelerations above those that Franka publishes."""
    curve, unpublished = swing(panda.joints, START, GOAL, 4.0), load_robot(panda.urdf, lock=panda.locked)
    for robot, kinds in ((panda, []), (unpublished, ["acceleration", "jerk"])):
        judge = Judging(Scorer(robot, model), joint_limits(robot.limits))
        (row,) = controller_files.write(curve, judge, controller_files.wanted(["yaml"]), tmp_path)
        assert row.valid and row.document()["assumed"] == kinds
        assert ("; valid under assumed limits (acceleration, jerk): give --limits" in str(row)) == bool(kinds)


def test_moves_as_ur_takes_them(ur5: Robot) -> None:
    chain = Chain(
        np.array([UR_START, UR_START + [0.5, 0.6, -0.3, 0, 0, 0], UR_GOAL]),
        np.array([1.0, 0.9]), np.array([0.4, 0.5, 0.3]), np.full(3, 0.002),
    )  # fmt: skip
    speed, acceleration = leading(chain, np.full(6, np.inf))
    assert speed == pytest.approx([0.6, np.abs(chain.corners[2] - chain.corners[1]).max() / 0.9])
    assert acceleration == pytest.approx([0.6 / 0.398, speed[1] / 0.298])
    model = pin.buildModelFromUrdf(str(ur5.urdf))
    data = model.createData()
    for q in chain.corners:
        pin.forwardKinematics(model, data, q)
        assert tool_point(ur5.body, q) == pytest.approx(data.oMi[model.njoints - 1].translation, abs=1e-12)
    middle = chain.ramps[0] / 2 + 1.0
    curve = chain.trajectory(ur5.joints)
    at = tool_point(ur5.body, chain.corners[1])
    ends = [tool_point(ur5.body, curve.sample(np.array([middle + x]))[0][0]) for x in (-0.25, 0.25)]
    assert blend_radii(chain, ur5.body) == pytest.approx([min(np.linalg.norm(x - at) for x in ends)])


def test_optimize_as_moves(tmp_path: Path) -> None:
    """The files, the share kept, and the script's own numbers; a judged trajectory of the blended moves."""
    start, goal = (",".join(map(str, q)) for q in (UR_START, UR_GOAL))
    words = ["optimize", "--robot", "ur5", "--start", start, "--goal", goal,
             "--duration", "1.2", "--starts", "1", "--controls", "16", "--compile", "never", "--quiet"]  # fmt: skip
    assert main([*words, "--out", str(tmp_path), "--as", "moves", "--vias", "1", "--write", "urscript"]) == 0
    result = json.loads((tmp_path / "result.json").read_text())
    assert (
        result["chosen"] == "moves"
        and result["moves"]["kind"] in ("trapezoid", "s-curve")
        and result["moves"]["vias"] == 1
    )
    assert 30 < result["moves"]["kept_percent"] <= 100 and result["energy"]["loss"] == result["moves"]["loss"]
    assert max(result["certificate"]["max_violation"].values()) <= 1e-6
    moves = yaml.safe_load((tmp_path / "moves.yaml").read_text())
    arm = Controller(UR_START)
    arm.run((tmp_path / "moves.script").read_text())
    assert (tmp_path / "trajectory.script").read_text() == (tmp_path / "moves.script").read_text()
    assert len(arm.moves) == len(moves["moves"]) == 2 and arm.moves[-1]["r"] == 0
    for ours, theirs in zip(moves["moves"], arm.moves, strict=True):
        assert theirs["q"] == pytest.approx(ours["to"], abs=1e-9)
        assert theirs["v"] == pytest.approx(max(map(abs, ours["velocity"])), abs=1e-6)
        assert theirs["a"] == pytest.approx(ours["leading_acceleration"], abs=1e-6)
    # the ramps of moves.yaml, integrated, are the motion
    ramps = moves["ramps"]
    velocity = np.cumsum([np.array(r["acceleration"]) * (r["duration"] - r["rise"]) for r in ramps], axis=0)
    assert velocity[0] == pytest.approx(moves["moves"][0]["velocity"]) and np.abs(velocity[-1]).max() < 1e-9
    ways = [
        np.array(r["acceleration"]) * (r["duration"] - r["rise"]) * (1.2 - r["start"] - r["duration"] / 2)
        for r in ramps
    ]
    assert np.array(moves["start"]) + sum(ways) == pytest.approx(UR_GOAL, abs=1e-9)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--write", "doc"], "--write 'doc'; known are csv"),
        (["--rate", "100"], "--rate 100: belongs to --write"),
        (["--write", "csv", "--rate", "-5"], "--rate -5: expected samples per second"),
        (["--vias", "2"], "--vias belongs to --as moves"),
    ],
)
def test_options_that_do_not_fit(capsys: pytest.CaptureFixture[str], words: list[str], says: str) -> None:
    assert main(["optimize", "--robot", "ur5", "--start", "0,0,0,0,0,0", "--goal", "0,0,0,0,0,1", *words]) == 2
    assert says in capsys.readouterr().err


@pytest.mark.slow
def test_a_plan_of_moveit_py_is_retimed_by_one_command(tmp_path: Path, panda: Robot) -> None:
    """`get_robot_trajectory_msg()` of a planned path as YAML: joints in MoveIt's order, no accelerations given."""
    order = [*reversed(panda.joints)]
    rows = swing(panda.joints, START, GOAL, 4.0, 15)
    points = [
        {"positions": [float(q[panda.joints.index(name)]) for name in order],
         "velocities": [float(v[panda.joints.index(name)]) for name in order], "accelerations": [], "effort": [],
         "time_from_start": {"sec": int(t), "nanosec": round((t % 1) * 1e9)}}
        for t, q, v in zip(rows.time.tolist(), rows.position, rows.velocity, strict=True)
    ]  # fmt: skip
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "world"}
    message = {
        "joint_trajectory": {"header": header, "joint_names": order, "points": points},
        "multi_dof_joint_trajectory": {"header": header, "joint_names": [], "points": []},
    }
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump(message) + "---\n")
    words = ["optimize", "--robot", "panda", "--path", str(tmp_path / "plan.yaml"), "--mode", "retime", "--quiet"]
    assert main([*words, "--duration", "4", "--out", str(tmp_path / "out"), "--compile", "never"]) == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["status"] == "solved"
    named = {b["name"]: b["energy"]["total"] for b in result["baselines"]}
    assert result["energy"]["total"] <= min(named["input"], named["scaled"]) + 1e-6
    ends = read_trajectory(tmp_path / "out" / "trajectory.yaml", panda.joints).position[[0, -1]]
    np.testing.assert_allclose(ends, [START, GOAL], atol=1e-9)


def test_the_ros_2_example_slows_what_we_write(tmp_path: Path, ur5: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its own functions, with nothing of ROS behind the imports."""
    import runpy
    import sys
    from types import ModuleType

    for name in ("rclpy", "rclpy.action", "rclpy.wait_for_message", "control_msgs", "control_msgs.action",
                 "rosidl_runtime_py", "rosidl_runtime_py.set_message", "sensor_msgs", "sensor_msgs.msg"):  # fmt: skip
        module = ModuleType(name)
        for thing in ("ActionClient", "wait_for_message", "FollowJointTrajectory", "set_message_fields", "JointState"):
            setattr(module, thing, None)
        monkeypatch.setitem(sys.modules, name, module)
    example = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "examples" / "ros2_follow.py"))
    curve = resampled(swing(ur5.joints, UR_START, UR_GOAL, 1.0), 20)
    write(curve, tmp_path / "t.goal.yaml")
    goal = example["slowed"](yaml.safe_load((tmp_path / "t.goal.yaml").read_text()), 0.25)
    (tmp_path / "slow.yaml").write_text(yaml.safe_dump(goal))
    slow = read_trajectory(tmp_path / "slow.yaml", ur5.joints)
    assert slow.duration == pytest.approx(4.0) and slow.position == pytest.approx(curve.position)
    time = np.linspace(0, 1, 50)
    assert slow.sample(4 * time)[0] == pytest.approx(curve.sample(time)[0], abs=1e-9)
    state = type("State", (), {"name": ["extra", *ur5.joints], "position": [9.0, *(UR_START + 0.01)]})
    assert example["distance"](goal, state) == pytest.approx(0.01)


def test_a_program_in_rad_is_refused_for_an_arm_that_slides(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its metres were written as radians."""
    limit = '<limit lower="-1" upper="1" effort="90" velocity="1"/>'
    mass = '<inertial><mass value="2"/><inertia ixx=".02" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial>'
    text = "<robot name='six'><link name='l0'/>"
    for k in range(6):
        kind = "prismatic" if k == 1 else "revolute"
        text += f"<link name='l{k + 1}'>{mass}</link><joint name='j{k}' type='{kind}'><parent link='l{k}'/>"
        text += f"<child link='l{k + 1}'/><origin xyz='0 0 0.2'/><axis xyz='{k % 2} 1 0'/>{limit}</joint>"
    (tmp_path / "six.urdf").write_text(text + "</robot>")
    words = ["optimize", "--robot", str(tmp_path / "six.urdf"), "--start", "0,0,0,0,0,0", "--goal", ".1,.1,.1,.1,.1,.1"]
    assert main([*words, "--write", "urscript", "--out", str(tmp_path / "out")]) == 2
    assert "--write urscript: j1 slides; expected an arm whose joints all turn" in capsys.readouterr().err
