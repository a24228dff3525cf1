"""Moves among bodies that can be passed on several sides, of which the first path takes a dear one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene_files import read_scene
from energy_opt.effects import CopperLoss, CoulombFriction, Regeneration, Standby
from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Planner, Settings
from energy_opt.robot import load_robot

# A SCARA arm with a lift: name, type, axis, place [m], limits, mass [kg] and box [m] of its link with the box's place
JOINTS = (
    ("j1", "revolute", "0 0 1", "0 0 0.42", 'lower="-2.3" upper="2.3" velocity="6.5" effort="120"', 6, "0.15 0 0.05",
     "0.36 0.1 0.08", 0.06),
    ("j2", "revolute", "0 0 1", "0.3 0 0", 'lower="-2.5" upper="2.5" velocity="7.5" effort="60"', 4, "0.12 0 0.15",
     "0.3 0.1 0.08", 0.03),
    ("z", "prismatic", "0 0 -1", "0.25 0 0.1", 'lower="-0.05" upper="0.25" velocity="1.2" effort="150"', 1, "0 0 0",
     "0.03 0.03 0.4", 0.005),
    ("r", "revolute", "0 0 1", "0 0 -0.2", 'lower="-6" upper="6" velocity="15" effort="8"', 0.5, "0 0 -0.02",
     "0.05 0.05 0.03", 0.0005),
)  # fmt: skip
# two plates across the straight line, a plate over its end and a ball
SCENE = """objects:
- {name: w1, type: box, position: [0.48, 0, 0.15], size: [0.002, 0.3, 0.3]}
- {name: w2, type: box, position: [0.56, 0, 0.15], size: [0.002, 0.3, 0.3]}
- {name: lid, type: box, position: [0.4, 0.32, 0.24], size: [0.3, 0.2, 0.002]}
- {name: ball, type: sphere, position: [0.3, 0.45, 0.3], radius: 0.05}
"""
MOVE = Move(np.array([0.3015, -0.666, 0.1, 0.3645]), np.array([1.3, -0.4, 0.1, 1.0]))


def scara() -> str:
    """The URDF of the arm."""
    links, joints, parent = ['<link name="base"/>'], list[str](), "base"
    for name, kind, axis, place, limit, mass, at, box, inertia in JOINTS:
        links.append(
            f'<link name="l_{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/><inertia ixx="{inertia / 3}" '
            f'iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="{at}"/>'
            f'<geometry><box size="{box}"/></geometry></collision></link>'
        )
        joints.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="l_{name}"/>'
            f'<origin xyz="{place}"/><axis xyz="{axis}"/><limit {limit}/></joint>'
        )
        parent = f"l_{name}"
    return f'<robot name="scara">{"".join(links)}{"".join(joints)}</robot>'


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scara")
    (folder / "scara.urdf").write_text(scara())
    (folder / "scene.yaml").write_text(SCENE)
    return folder


@pytest.fixture(scope="module")
def planner(files: Path) -> Planner:
    robot = load_robot(str(files / "scara.urdf"))
    model = eo.PowerModel(robot.name, (
        Standby(power=40.0), CopperLoss(r_over_kt2=[0.005, 0.012, 0.0008, 0.18]),
        CoulombFriction(tau_c=[2.0, 1.0, 3.0, 0.3]), Regeneration(efficiency=0.2, level="bus"),
    ))  # fmt: skip
    scene = files / "scene.yaml"
    cell = Cell(robot, CellRequest(scene=scene), read_scene(scene))
    return Planner(robot, model, Settings(compile="never"), cell=cell)


def test_a_free_duration_costs_little_more_than_a_shorter_one(planner: Planner) -> None:
    """The first path swings the elbow the long way, and searches stayed there: 89 J beside 47 J in 1 s."""
    free, fixed = (planner.solve(replace(MOVE, duration=d)) for d in (None, 1.0))
    assert all(result.status == "solved" and result.certificate.valid for result in (free, fixed))
    assert free.energy.total < 1.15 * fixed.energy.total


@pytest.mark.slow
def test_the_least_time_takes_the_short_passage_and_is_the_advice(planner: Planner) -> None:
    """The least time was 1.5 s, although a move of 0.9 s was found."""
    assert planner.with_settings(objective="time").solve(MOVE).trajectory.duration < 1.2
    with pytest.raises(Infeasible, match=r"the shortest found .*; objective time may find a shorter one"):
        planner.solve(replace(MOVE, duration=0.5), confirm=False)
