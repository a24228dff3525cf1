"""Suites that name scenes, paths and the rest of body and cell; what they name travels to workers as text."""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from faults import faults_of

import energy_opt as eo
from energy_opt.batches.suite import load_suite
from energy_opt.batches.task import Task
from energy_opt.cell.scene import Scene
from energy_opt.cell.scene_files import read_scene

CELLS = Path(__file__).parents[2] / "benchmarks" / "suites" / "cells.toml"
HEAD = 'format = "energy-opt/suite/1"\nrobots = ["panda"]\n'
MOVE = """
[[moves]]
start = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
goal = [0.3, -0.5, 0, -2.1, 0, 1.7, 0.785]
"""
SCENE = """objects:
  - {name: post, type: cylinder, radius: 0.05, height: 1.0, position: [0.6, 0.5, 0.5]}
  - {name: part, type: mesh, file: part.obj, position: [0.5, -0.6, 0.2]}
  - {name: held, type: sphere, radius: 0.03, position: [0, 0, 0.25], attach: true, touch_links: [panda_hand]}
allow: [[held, post]]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "cell.yaml").write_text(SCENE)
    (tmp_path / "part.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    return tmp_path


def tasks(folder: Path, text: str) -> tuple[Task, ...]:
    (folder / "suite.toml").write_text(HEAD + text)
    return load_suite(folder / "suite.toml").tasks


def placed(scene: Scene) -> np.ndarray:
    return np.array([shape.pose for shape in scene.placed()])


def test_the_cells_suite_has_twenty_moves_of_four_arms_with_and_without_a_payload() -> None:
    assert faults_of(load_suite, CELLS) == []
    suite = load_suite(CELLS).tasks
    assert len(suite) == 40 and {t.robot.name for t in suite} == {"panda", "ur5", "ur5e", "xarm7"}
    assert sum(t.payload[0] > 0 for t in suite) == 20 and all(t.surroundings.scene for t in suite)
    assert len({t.key for t in suite}) == 40


def test_a_scene_travels_as_text_with_its_meshes(folder: Path) -> None:
    (task,) = tasks(
        folder, 'scene = "cell.yaml"\nfloor = -0.5\nbase = [0, 0, 0.1, 0, 0, 0.2]\nclearance = 0.001\n' + MOVE
    )
    scene = read_scene(folder / "cell.yaml")
    for file in ("cell.yaml", "part.obj"):
        (folder / file).unlink()
    there: Task = pickle.loads(pickle.dumps(task))
    again = Scene.from_text(there.surroundings.scene)
    assert np.array_equal(placed(again), placed(scene)) and again.allowed == scene.allowed
    assert again.objects[1].shapes[0].triangles.tolist() == [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    assert (again.objects[2].attached_to, again.objects[2].touch_links) == ("<tool>", ("panda_hand",))
    cell = there.surroundings.cell(there.robot.load())
    assert cell.asked == 0.001 and {"post", "part", "held", "floor"} <= {body.name for body in cell.bodies.all}


def test_the_key_depends_on_the_surroundings(folder: Path) -> None:
    keys = {tasks(folder, line + MOVE)[0].key for line in ("", 'scene = "cell.yaml"\n', "self_collision = false\n")}
    keys.add(tasks(folder, 'scene = "cell.yaml"\nfloor = 0\n' + MOVE)[0].key)
    assert len(keys) == 4
    (folder / "cell.yaml").write_text(SCENE.replace("0.6, 0.5", "0.6, 0.6"))
    assert tasks(folder, 'scene = "cell.yaml"\n' + MOVE)[0].key not in keys


def test_a_path_gives_the_ends_and_travels_with_the_move(folder: Path) -> None:
    joints = [f"panda_joint{k}" for k in range(1, 8)]
    rows = [[0, -0.785, 0, -2.356, 0, 1.571, 0.785], [0.2, -0.5, 0, -2.2, 0, 1.6, 0.7], [0.5, -0.4, 0, -2, 0, 1.7, 0.6]]
    header = ",".join(f"{joint}.position" for joint in joints)
    (folder / "way.csv").write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]))
    (task,) = tasks(folder, '[[moves]]\npath = "way.csv"\n')
    assert np.allclose([task.start, task.goal], [rows[0], rows[2]]) and task.path[0] == ".csv"
    assert header in task.path[1]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('scene = "none.yaml"\n' + MOVE, "scene: .*none.yaml"),
        ('scene = "../cell.yaml"\n' + MOVE, "scene: .*outside"),
        ("scene = 3\n" + MOVE, "scene = 3; expected text"),
        ('floor = "low"\n' + MOVE, "floor = 'low'; expected a number"),
        ("base = [1, 2]\n" + MOVE, "cell: .*base"),
        ("clearance = -1\n" + MOVE, "cell: .*clearance"),
        ("self_collision = 1\n" + MOVE, "self_collision = 1; expected true or false"),
        ('planner = "rrt"\n' + MOVE, "cell: .*planner"),
        ('[[moves]]\npath = "none.csv"\n', "none.csv"),
        (MOVE + 'path = "way.csv"\n', "start and goal, or a path"),
    ],
)
def test_faults_are_named(folder: Path, text: str, says: str) -> None:
    (folder / "suite.toml").write_text(HEAD + text)
    faults = faults_of(load_suite, folder / "suite.toml")
    assert faults and any(re.search(says, fault) for fault in faults), faults


def test_an_object_of_a_scene_that_is_faulty_is_named(folder: Path) -> None:
    (folder / "cell.yaml").write_text(SCENE.replace("radius: 0.05", "radius: 0"))
    (folder / "suite.toml").write_text(HEAD + 'scene = "cell.yaml"\n' + MOVE)
    (fault,) = faults_of(load_suite, folder / "suite.toml")
    assert "object post: radius of its cylinder is 0" in fault


def test_options_take_the_place_of_the_suites_cell(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the command line says of body and cell holds for every move, and what it does not say stays."""
    from energy_opt.batches import batch
    from energy_opt.cli.main import main
    from energy_opt.front import bench

    (folder / "suite.toml").write_text(
        HEAD + 'self_collision = false\nclearance = 0.002\nplanner = "none"\nfloor = -0.5\n' + MOVE
    )
    found = []

    def stop(suite: batch.Suite, *_: object, **__: object) -> None:
        found.append(suite.tasks[0].surroundings)
        raise KeyboardInterrupt

    monkeypatch.setattr(bench, "run_batch", stop)  # as imported there, whatever ran before
    words = ["bench", str(folder / "suite.toml"), "--out", str(folder / "out"), "--quiet"]
    main(words)
    main(
        [
            *words,
            "--self-collision",
            "on",
            "--planner",
            "auto",
            "--scene",
            str(folder / "cell.yaml"),
            "--base=0,0,1,0,0,0",
        ]
    )
    plain, said = found
    assert not plain.request.self_collision and plain.request.planner == "none" and not plain.scene
    assert said.request.self_collision and said.request.planner == "auto" and said.scene
    assert said.request.base == (0, 0, 1, 0, 0, 0) and said.request.floor == -0.5 and said.request.clearance == 0.002


def test_check_takes_the_scene_of_an_option_as_bench_does(folder: Path) -> None:
    """It was ignored: "no pose 'pick'", of a suite that `bench --scene` plans."""
    (folder / "other.yaml").write_text('objects: []\nposes: {pick: {pose: "0.4, 0.1, 0.4, 3.1416, 0, 0"}}\n')
    (folder / "suite.toml").write_text(HEAD + re.sub("goal = .*", 'goal_pose = "pick"', MOVE))
    assert "no pose 'pick'" in str(eo.check(folder / "suite.toml"))
    assert eo.check(folder / "suite.toml", scene=folder / "other.yaml").usable
