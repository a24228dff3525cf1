"""Verbs that play or propose motions know the arm's body and its cell; judged by a judge that knows nothing of ours."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from dense_judge import DenseJudge
from poses import GOAL, START

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene_files import read_scene
from energy_opt.cli.main import main
from energy_opt.effects import CoulombFriction, ViscousFriction
from energy_opt.formats import write
from energy_opt.motion.trajectory import Trajectory
from energy_opt.next_motion.motion_search import propose
from energy_opt.next_motion.rival_models import Rival
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot
from energy_opt.tables import read_table

TABLE = "objects:\n  - {name: table, type: box, size: [1.0, 1.6, 0.1], position: [0.9, 0.0, 0.05]}\n"


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scene") / "table.yaml"
    file.write_text(TABLE)
    return file


def quintic(robot: Robot, a: np.ndarray, b: np.ndarray) -> Trajectory:
    t = np.linspace(0, 2, 101)
    u = t[:, None] / 2
    s, ds, dds = u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2 / 2, 60 * u * (1 - u) * (1 - 2 * u) / 4
    return Trajectory(robot.joints, t, a + s * (b - a), ds * (b - a), dds * (b - a))


def test_the_judge_of_many_poses_sees_what_touches(panda: Robot, table: Path, tmp_path: Path) -> None:
    folded = np.array([0.0, 0.0, 0.0, -3.05, 0.0, 0.2, 0.0])
    low = np.array([0.0, 1.5, 0.0, -0.5, 0.0, 2.0, 0.785])
    judge = DenseJudge(panda, table)
    for goal, touches in ((GOAL, None), (folded, "panda_"), (low, "table")):
        write(quintic(panda, START, goal), tmp_path / "t.csv")
        found = judge.file(tmp_path / "t.csv", 300)
        assert (found.touching == 0) == (touches is None) and (touches is None or touches in " ".join(found.pair))


def test_simulate_refuses_what_would_break_an_arm(panda: Robot, table: Path, tmp_path: Path, capsys) -> None:
    source_method_2("panda").save(tmp_path / "plant.toml")
    for name, goal in (("free", GOAL), ("low", np.array([0.0, 1.5, 0.0, -0.5, 0.0, 2.0, 0.785]))):
        write(quintic(panda, START, goal), tmp_path / f"{name}.csv")
    words = ["--plant", str(tmp_path / "plant.toml"), "--quiet", "--out", str(tmp_path / "set"), "--force"]
    scene = ["--scene", str(table)]
    assert main(["simulate", str(tmp_path / "free.csv"), *words, *scene]) == 0
    assert main(["simulate", str(tmp_path / "low.csv"), *words, *scene]) == 3
    assert "collision: panda_hand–table at 1." in capsys.readouterr().err
    assert main(["simulate", str(tmp_path / "low.csv"), *words]) == 0


def test_suggested_poses_touch_nothing(ur5: Robot, table: Path, tmp_path: Path) -> None:
    judge, touching = DenseJudge(ur5, table), []
    for words in (["--scene", str(table)], ["--self-collision", "off"]):
        assert main(["identify", "--suggest", "8", "--robot", "ur5", "--out", str(tmp_path), "--force", *words]) == 0
        rows = read_table(tmp_path / "suggested_poses.csv")
        poses = np.column_stack([rows[f"{joint}.position"] for joint in ur5.joints])
        touching.append(sum(judge.pose(q) is not None for q in poses))
    assert touching[0] == 0 < touching[1]


@pytest.mark.slow
def test_the_motion_to_record_next_touches_nothing(ur5: Robot, table: Path, tmp_path: Path) -> None:
    base = source_method_2("ur5")
    rivals = [Rival(base.replaced(effect)) for effect in (ViscousFriction(b=2.0), CoulombFriction(tau_c=2.0))]
    motions = [propose(rivals, ur5, 0, at) for at in (None, Cell(ur5, CellRequest(), read_scene(table)))]
    found = []
    for motion in motions:
        assert motion is not None
        write(motion.trajectory, tmp_path / "t.csv")
        found.append(DenseJudge(ur5, table).file(tmp_path / "t.csv", 1500).touching)
    assert found[1] == 0 < found[0]


WHEEL = """<robot name="wheel"><link name="base"/><link name="beam"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="1 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="wheel" type="continuous"><parent link="base"/><child link="beam"/><axis xyz="0 0 1"/>
<limit velocity="2" effort="100"/></joint>
<joint name="turn" type="revolute"><parent link="beam"/><child link="arm"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="2" effort="100"/></joint></robot>"""


def test_the_judge_of_many_poses_places_locked_wheels(tmp_path: Path) -> None:
    """A beam of 1 m that is locked at a right angle, an arm of 1 m straight on: its ball is 2 m along y."""
    named = WHEEL.replace('link name="beam"', 'link name="wheel"').replace('link="beam"', 'link="wheel"')
    (tmp_path / "wheel.urdf").write_text(named)  # a link and the joint that is locked share a name
    robot = load_robot(tmp_path / "wheel.urdf", lock={"wheel": np.pi / 2})
    box = {"type": "box", "size": [0.1, 0.1, 0.1]}
    things = [{"name": name, "position": at, **box} for name, at in (("there", [0, 2, 0]), ("beside", [2, 0, 0]))]
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump({"objects": things}))
    touched = DenseJudge(robot, tmp_path / "scene.yaml").pose(np.zeros(1))
    assert touched is not None and "there" in touched
    assert DenseJudge(robot, tmp_path / "scene.yaml").pose(np.ones(1)) is None
