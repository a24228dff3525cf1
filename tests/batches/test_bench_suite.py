"""Suites: what they resolve to, and every fault by name."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from faults import faults_of
from tool_poses import pose_at

from energy_opt.batches.executors import solve_task
from energy_opt.batches.suite import load_suite
from energy_opt.batches.tables import random_moves
from energy_opt.batches.task import Duration
from energy_opt.cli.main import example
from energy_opt.errors import BadInput
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.trajectory import Trajectory
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.robot import load_robot

SHIPPED = Path(__file__).parents[2] / "benchmarks" / "suites"
HEAD = 'format = "energy-opt/suite/1"\nrobots = ["panda"]\n'


def written(folder: Path, text: str) -> Path:
    path = folder / "suite.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["panda20", "arms", "source_paper", "hard", "objectives"])
def test_shipped_suites_are_usable(name):
    assert faults_of(load_suite, SHIPPED / f"{name}.toml") == []
    suite = load_suite(SHIPPED / f"{name}.toml")
    assert suite.name == name
    assert len({task.key for task in suite.tasks}) == len(suite.tasks) > 0


def test_shipped_suites_cover_what_they_promise():
    arms = load_suite(SHIPPED / "arms.toml")
    assert {task.robot.name for task in arms.tasks} == {
        *("panda", "ur3", "ur5", "ur10", "kinova", "xarm7", "z1", "ur3e", "ur5e", "ur10e")
    }
    paper = load_suite(SHIPPED / "source_paper.toml")
    assert {(t.move, t.timing.seconds, t.model) for t in paper.tasks if t.mode == "retime"} == {
        (move, seconds, model)
        for move, times in {
            "horizontal": (8.58, 4.26, 3.22),
            "diagonal": (9.66, 4.82, 3.58),
            "vertical": (10.92, 5.54, 3.92),
        }.items()
        for seconds in times
        for model in ("source_method_1", "source_method_2")
    }


def test_product_of_everything(tmp_path):
    text = HEAD + (
        'random = { count = 3, seed = 5 }\nmodes = ["retime", "reshape"]\ndurations = [2, "1.5x", "free"]\n'
        'payloads = [0, "1.5,0,0,0.1"]\nobjectives = ["energy", "torque"]\n'
    )
    suite = load_suite(written(tmp_path, text))
    assert len(suite.tasks) == 3 * 2 * 3 * 2 * 2
    assert [task.index for task in suite.tasks] == list(range(len(suite.tasks)))
    heavy = next(task for task in suite.tasks if task.payload_label == "1.5,0,0,0.1").power().get("payload")
    assert heavy is not None
    assert heavy.values["mass"][0] == 1.5
    assert heavy.values["com"].tolist() == [0.0, 0.0, 0.1]


def test_groups_take_from_the_top_what_they_do_not_say(tmp_path):
    text = (
        'format = "energy-opt/suite/1"\nmodes = ["retime"]\nrandom = { count = 1 }\n'
        '[[groups]]\nrobots = ["panda"]\n[[groups]]\nrobots = ["ur5"]\nmodes = ["reshape"]\n'
    )
    suite = load_suite(written(tmp_path, text))
    assert [(task.robot.name, task.mode) for task in suite.tasks] == [("panda", "retime"), ("ur5", "reshape")]


def test_the_groups_of_the_example_can_be_uncommented(tmp_path):
    head, groups = example("suite").split("# [[groups]]", 1)
    suite = load_suite(written(tmp_path, head + ("# [[groups]]" + groups).replace("# ", "")))
    assert Counter(task.robot.name for task in suite.tasks) == {"panda": 4, "ur5": 5, "ur5e": 5}


def test_moves_by_joint_name_equal_moves_in_order(tmp_path):
    values = [0.1, -0.5, 0.2, -2.0, 0.3, 1.5, 0.7]
    table = ", ".join(f"panda_joint{j} = {values[j - 1]}" for j in (3, 1, 2, 7, 6, 5, 4))
    text = HEAD + f"[[moves]]\nstart = {{ {table} }}\ngoal = {values}\n"
    (task,) = load_suite(written(tmp_path, text)).tasks
    assert task.start == task.goal == tuple(values)


@pytest.mark.parametrize("posed", [False, True])
def test_of_several_goals_the_cheapest_is_reached(tmp_path, posed):
    """Also as poses of the tool, and by joint name."""
    start, near, far = [0.0, 1.0, -1.0, 0, 0, 0], [0.3, 1.1, -1.1, 0, 0, 0], [2.0, 1.4, -0.6, 0.5, 0, 0]
    head = 'format = "energy-opt/suite/1"\nrobots = ["z1"]\nmodes = ["retime"]\ndurations = [1.5]\n'
    head += 'self_collision = false\nmodels = ["source-method-2"]\n'
    by_name = ", ".join(f"joint{k} = {q}" for k, q in enumerate(near, start=1))
    goals = {"both": f"[{far}, {{ {by_name} }}]", "near": near, "far": far}
    key = "goal"
    if posed:
        key, tool = "goal_pose", ToolKinematics(load_robot("z1"))
        near, far = (pose_at(tool, np.array(q)).matrix.tolist() for q in (near, far))
        goals = {"both": [far, near], "near": near, "far": far}
    text = head + "".join(f'[[moves]]\nname = "{n}"\nstart = {start}\n{key} = {g}\n' for n, g in goals.items())
    rows = {row["move"]: row for row in (solve_task(task)["row"] for task in load_suite(written(tmp_path, text)).tasks)}
    assert [row["status"] for row in rows.values()] == ["solved"] * 3
    totals = {name: row["energy_total"] for name, row in rows.items()}
    assert totals["both"] == pytest.approx(min(totals["near"], totals["far"]), rel=1e-3)
    assert abs(totals["near"] - totals["far"]) > 0.01 * totals["both"]


def test_random_moves_stay_in_range_and_follow_the_seed():
    robot = load_robot("kinova")  # three of its joints are continuous
    moves = random_moves(robot, 50, seed=3, share=0.5)
    ends = np.array([end for move in moves for end in (move.start, move.goal)])
    lower, upper = robot.limits.lower, robot.limits.upper
    lower, upper = np.where(np.isfinite(lower), lower, -np.pi), np.where(np.isfinite(upper), upper, np.pi)
    share = np.abs(ends - (lower + upper) / 2) / ((upper - lower) / 2)
    assert share.max() <= 0.5
    assert share.max(axis=0).min() > 0.4  # every joint is really moved
    assert random_moves(robot, 10, 3, 0.5)[4].start == moves[4].start
    assert random_moves(robot, 10, 4, 0.5)[4].start != moves[4].start


def test_key_changes_with_content_and_not_with_place(tmp_path):
    first = load_suite(written(tmp_path, HEAD + "random = { count = 2 }\n")).tasks
    longer = load_suite(written(tmp_path, HEAD + "random = { count = 3 }\n")).tasks
    assert [t.key for t in first] == [t.key for t in longer[:2]]
    other = load_suite(written(tmp_path, HEAD + "random = { count = 2 }\npayloads = [1]\n")).tasks
    assert not {t.key for t in first} & {t.key for t in other}


def test_urdf_and_limits_travel_as_text(tmp_path):
    source = load_robot("ur5e")
    (tmp_path / "arm.urdf").write_text(source.urdf.read_text())
    limits = "joint_limits:\n  elbow_joint: {has_velocity_limits: true, max_velocity: 1.25}\n"
    (tmp_path / "limits.yaml").write_text(limits)
    text = 'format = "energy-opt/suite/1"\nrobots = ["arm.urdf"]\nlimits = "limits.yaml"\nrandom = { count = 1 }\n'
    (task,) = load_suite(written(tmp_path, text)).tasks
    (tmp_path / "arm.urdf").unlink()
    (tmp_path / "limits.yaml").unlink()
    robot = task.robot.load()
    assert robot.name == "arm"
    assert robot.limits.velocity[robot.joints.index("elbow_joint")] == 1.25


@pytest.mark.parametrize("value", [0, -1, "0x", "fast", "x1.5", True, None, float("inf"), "1..5x"])
def test_no_duration(value):
    with pytest.raises(BadInput, match="not a duration"):
        Duration.parse(value)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('robots = ["panda"]\nrandom = { count = 1 }\n', "format is missing"),
        ('format = "energy-opt/suite/1"\nrandom = { count = 1 }\n', "robots is missing"),
        (HEAD, "moves: none"),
        (HEAD + "random = { count = 0 }\n", "random: count = 0"),
        (HEAD + "random = { count = 1, range = 2 }\n", "random: range = 2"),
        (HEAD + 'random = { count = 1 }\nmodes = ["reform"]\n', "modes 1 = 'reform'"),
        (HEAD + "random = { count = 1 }\nduration = [1]\n", "did you mean 'durations'?"),
        (HEAD + 'random = { count = 1 }\nobjectives = ["speed"]\n', "objectives 1 = 'speed'"),
        (HEAD + 'random = { count = 1 }\nmodels = ["none.toml"]\n', "models: 'none.toml'"),
        (HEAD + "random = { count = 1 }\npayloads = [-1]\n", "payloads 1 = -1"),
        (HEAD + "random = { count = 1 }\n[settings]\nspeed = 3\n", "settings: speed: unknown setting"),
        (HEAD + "random = { count = 1 }\n[settings]\nstarts = 'a'\n", "settings: starts 'a': expected a whole number"),
        (HEAD + "[[moves]]\nstart = [0, 0]\ngoal = [0, 0]\n", "moves 1 (move01) on panda: 2 values; the robot has 7"),
        (HEAD + "[[moves]]\nstart = [[0], [0]]\ngoal = [0, 0]\n", "several positions; expected those of one place"),
        (HEAD + "[[moves]]\nstart = [0]\ngoal = [[0], [0]]\nvia = [[0]]\n", "expected via_pose"),
        (HEAD + "[[moves]]\nstart = [0, 0]\n", "moves 1: goal is missing"),
        (HEAD + "[[moves]]\nname = 'a'\nstart = {elbow = 1}\ngoal = {}\n", "unknown joint 'elbow'"),
        (HEAD + "random = [{ count = 1 }, { count = 1 }]\n", "is given 2 times"),
        ('format = "energy-opt/suite/1"\nrobots = ["robbie"]\nrandom = { count = 1 }\n', "robots: 'robbie'"),
        ("robots = [\n", "not valid TOML"),
    ],
)
def test_fault_is_named(tmp_path, text, named):
    path = written(tmp_path, text)
    faults = faults_of(load_suite, path)
    assert any(named in fault for fault in faults), faults
    assert all(fault.startswith(str(path)) for fault in faults)
    with pytest.raises(BadInput):
        load_suite(path)


def test_all_faults_are_named_in_one_reading(tmp_path):
    text = HEAD + 'random = { count = -1 }\nmodes = ["reform"]\ndurations = ["soon"]\npayloads = ["a"]\n'
    faults = faults_of(load_suite, written(tmp_path, text))
    assert [fault.split(": ", 1)[1].partition(" = ")[0] for fault in faults] == [
        "modes 1", "durations 1", "payloads 1", "random: count",
    ]  # fmt: skip


def test_missing_file_is_named(tmp_path):
    assert faults_of(load_suite, tmp_path / "none.toml") == [f"{tmp_path / 'none.toml'}: No such file or directory"]


# Energies [J] of the paper's table, by Methods 1 and 2, in the order of its durations.
TABLE = {
    "horizontal": {8.58: (794.96, 802.20), 4.26: (395.88, 397.31), 3.22: (299.89, 300.02)},
    "diagonal": {9.66: (902.74, 900.01), 4.82: (455.88, 452.52), 3.58: (341.33, 338.22)},
    "vertical": {10.92: (1024.09, 1012.82), 5.54: (527.26, 519.41), 3.92: (377.62, 372.05)},
}


def test_source_paper_suite_gives_the_paper_s_energies():
    """With a smooth timing of the straight path, to 0.1 % by Method 1 and 1 % by Method 2."""
    x = np.linspace(0, 1, 81)[:, None]
    shape = 10 * x**3 - 15 * x**4 + 6 * x**5, 30 * x**2 - 60 * x**3 + 30 * x**4, 60 * x - 180 * x**2 + 120 * x**3
    tasks = [task for task in load_suite(SHIPPED / "source_paper.toml").tasks if task.mode == "retime"]
    robot = tasks[0].robot.load()
    assert len(tasks) == 18
    for task in tasks:
        start, goal = np.array(task.start), np.array(task.goal)
        duration = task.timing.seconds
        q, v, a = (s * (goal - start) / duration**k for k, s in enumerate(shape))
        trajectory = Trajectory(robot.joints, x[:, 0] * duration, start + q, v, a)
        method = int(task.model[-1])
        energy = Scorer(robot, task.power()).energy(trajectory).total
        assert energy == pytest.approx(TABLE[task.move][duration][method - 1], rel=1e-3 if method == 1 else 1e-2)


@pytest.mark.parametrize("name", ["x/../../evil", "..", ".hidden", "a\\u0000b", "", "a" * 300])
def test_a_name_that_is_no_folder_is_refused(tmp_path, name):
    path = written(tmp_path, HEAD + f'random = {{ count = 1 }}\nname = "{name}"\n')
    assert any("name" in fault for fault in faults_of(load_suite, path))


def test_files_stay_beside_the_suite_unless_allowed(tmp_path):
    (tmp_path / "inner").mkdir()
    (tmp_path / "secret.toml").write_text('format = "energy-opt/model/1"\n[[effect]]\nname = "standby"\npower = 1.0\n')
    path = written(tmp_path / "inner", HEAD + 'random = { count = 1 }\nmodels = ["../secret.toml"]\n')
    assert any("outside" in fault for fault in faults_of(load_suite, path))
    assert load_suite(path, allow_outside=True).tasks


def test_a_file_of_another_kind_has_one_fault(tmp_path):
    path = written(tmp_path, 'format = "energy-opt/job/1"\nrobot = "panda"\ncycle_time = 8\n')
    assert [fault.partition("format: ")[2] for fault in faults_of(load_suite, path)] == [
        "'energy-opt/job/1'; expected 'energy-opt/suite/1'"
    ]
