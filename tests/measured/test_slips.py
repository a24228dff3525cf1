"""Slips of units are refused or reported, with the factor that would make sense."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from poses import GOAL, START

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene_files import read_scene
from energy_opt.errors import BadInput
from energy_opt.formats import read_path
from energy_opt.front.given import carried
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.move import long_turns
from energy_opt.poses.pose import Pose
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot


@pytest.fixture(scope="module")
def panda() -> Robot:
    return load_robot("panda")


@pytest.mark.parametrize(
    ("thing", "said"),
    [("size: [800, 600, 30], position: [750, 0, -200]", "0.77"), ("size: [1.2, 0.8, 0.05], position: [1, 0, 0]", None),
     ("size: [1200, 800, 50], position: [0, 0, -200]", "0.2 m if"), ("size: [20, 0.1, 3], position: [15, 0, 0]", None)],
)  # fmt: skip
def test_a_scene_in_millimetres_causes_a_warning(panda: Robot, tmp_path: Path, thing: str, said: str | None) -> None:
    (tmp_path / "s.yaml").write_text(f"objects: [{{name: table, type: box, {thing}}}]\n")
    cell = Cell(panda, CellRequest(self_collision=False, scene=tmp_path / "s.yaml"), read_scene(tmp_path / "s.yaml"))
    words = [line for line in cell.warnings if "millimetres" in line]
    assert bool(words) == (said is not None) and all(str(said) in line for line in words)


@pytest.mark.parametrize(("floor", "said"), [(-50.0, True), (-0.05, False), (-3.0, False)])
def test_a_floor_in_millimetres_causes_a_warning(panda: Robot, floor: float, said: bool) -> None:
    cell = Cell(panda, CellRequest(self_collision=False, floor=floor))
    assert any("floor is 50 m from the base; 0.05 m if in millimetres" in line for line in cell.warnings) == said


def test_a_base_in_millimetres_causes_a_warning(panda: Robot) -> None:
    for x, said in ((900.0, True), (9.0, False)):
        cell = Cell(panda, CellRequest(self_collision=False, floor=0.0, base=(x, 0.0, 0.0, 0.0, 0.0, 0.0)))
        assert any("base is 900 m from the origin; 0.9 m if in millimetres" in line for line in cell.warnings) == said


def test_a_rail_reaches_as_far_as_it_slides(tmp_path: Path) -> None:
    """A floor 3.5 m below a rail of 8 m was too far away for an arm that "reaches 0.1 m"."""
    rail = tmp_path / "rail.urdf"
    rail.write_text(
        """<robot name="rail"><link name="base"/><link name="car"><inertial><mass value="5"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="x" type="prismatic"><parent link="base"/><child link="car"/><axis xyz="1 0 0"/>
        <limit lower="0" upper="8" velocity="2" effort="200"/></joint></robot>""",
    )
    cell = Cell(load_robot(rail), CellRequest(floor=-3.5))
    assert not any("millimetres" in line for line in cell.warnings)


@pytest.mark.parametrize(("setting", "value"), [("tool_speed", 250.0), ("tool_acceleration", 2500.0)])
def test_bounds_of_the_tool_in_millimetres_are_refused(panda: Robot, setting: str, value: float) -> None:
    with pytest.raises(BadInput, match=f"millimetres\\? {value / 1000:g} m/s"):
        Planner(panda, source_method_2(), Settings(**{setting: value}))


@pytest.mark.parametrize(
    ("kind", "factor"), [("velocity", 180 / np.pi), ("acceleration", 180 / np.pi), ("velocity", 1)]
)
def test_rates_in_degrees_are_refused(panda: Robot, tmp_path: Path, kind: str, factor: float) -> None:
    t = np.linspace(0, 2, 60)[:, None]
    way = np.linspace(0.2, 0.8, 7)
    q, v, a = way * (1 - np.cos(t)), way * np.sin(t), way * np.cos(t)
    v, a = (x * (factor if name == kind else 1) for name, x in (("velocity", v), ("acceleration", a)))
    names = [f"{joint}.{what}" for what in ("position", "velocity", "acceleration") for joint in panda.joints]
    np.savetxt(
        tmp_path / "p.csv", np.hstack([t, q, v, a]), delimiter=",", header=",".join(["time", *names]), comments=""
    )
    if factor == 1:
        assert read_path(tmp_path / "p.csv", panda.joints).n == 7
        return
    with pytest.raises(BadInput, match=f"{kind} of panda_joint1 is 57.* times .*in deg.*multiply by 0.0174"):
        read_path(tmp_path / "p.csv", panda.joints)


def test_the_long_turn_of_a_continuous_joint_causes_a_warning() -> None:
    kinova = load_robot("kinova")
    k = next(k for k, link in enumerate(kinova.body.own_links()) if link.continuous)
    start, goal = np.full(kinova.n, 1.0), np.full(kinova.n, 1.2)
    start[k], goal[k] = 3.1, -3.1
    (said,) = long_turns(kinova, Move(start, goal))
    assert kinova.joints[k] in said and "3.18319 rad is the same pose 0.08319 rad away" in said
    assert long_turns(kinova, Move(goal, np.where(goal == -3.1, -3.0, goal))) == []


def test_payloads_in_grams_and_millimetres_are_refused(panda: Robot) -> None:
    with pytest.raises(BadInput, match=r"grams\? then 0\.5 kg"):
        carried("500", panda)
    for given in ("1.5,20,0,50", [1.5, 0.0, 0.0, 50.0]):
        with pytest.raises(BadInput, match=r"millimetres\? 0\.05 m"):
            carried(given, panda)
    assert float(carried("3,0,0,0.2", panda).values["mass"][0]) == 3.0
    crane: Any = SimpleNamespace(name="crane", reach=11.0, body=panda.body)  # its boom is 8 m long
    assert carried("3,6,0,0", crane).values["com"].tolist() == [6.0, 0.0, 0.0]
    with pytest.raises(BadInput, match=r"millimetres\? 0\.05 m"):
        carried("3,0,0,50", crane)


def test_a_base_turned_by_degrees_is_refused() -> None:
    with pytest.raises(BadInput, match=r"in degrees\? Expected rad \(-90 deg = -1\.571 rad\)"):
        CellRequest(base=(0.5, 0.0, 0.2, 0.0, 0.0, -90.0))
    CellRequest(base=(0.5, 0.0, 0.2, 0.0, 0.0, np.pi))


def test_a_duration_in_milliseconds_causes_a_warning(panda: Robot) -> None:
    start, goal = START, START + 0.2 * (GOAL - START)
    planner = Planner(panda, source_method_2(), Settings(compile="never"))
    said = [" ".join(planner.solve(Move(start, goal, "retime", T)).warnings) for T in (500.0, 2.0)]
    assert "milliseconds? 0.5 s" in said[0] and "milliseconds" not in said[1]


def test_a_pose_turned_by_degrees_is_refused() -> None:
    with pytest.raises(BadInput, match=r"in degrees\? Expected rad \(180 deg = 3\.142 rad\)"):
        Pose("0.5,0.1,0.4,180,0,0")
