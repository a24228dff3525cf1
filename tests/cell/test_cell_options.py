"""Body and cell as the command line says them, and a scene as plain data."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest

from energy_opt.cell import solids
from energy_opt.cell.cell import Cell
from energy_opt.cell.curve import MotionCurve
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import AllowedPairs, Scene, SceneObject, Shape
from energy_opt.cli.options import add_options, request_of
from energy_opt.errors import BadInput, Infeasible
from energy_opt.front.given import cell_of
from energy_opt.front.verbs import VERBS
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.first_path import check_free
from energy_opt.power import PowerModel
from energy_opt.robot import Robot, load_robot


def asked(*words: str) -> CellRequest:
    parser = argparse.ArgumentParser()
    add_options(parser, "optimize", VERBS["optimize"])
    return cell_of(request_of(parser.parse_args(words), VERBS["optimize"]))


def test_the_least_distance_of_a_motion_is_that_of_all_its_pairs(panda: Robot) -> None:
    """It was that of pairs that the proof had to measure: 163.6 mm for a motion that starts at 145.4 mm."""
    ends = np.array([[0, -0.785, 0, -2.356, 0, 1.571, 0.785], [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]])
    cell, time, still = Cell(panda, CellRequest()), np.array([1.0, 3.0]), np.zeros_like(ends)
    found = cell.measured(cell.prove(time, ends, still, still), curve := MotionCurve(time, ends, still, still))
    assert found.proven and found.min_distance is not None and found.time is not None
    for t in np.linspace(1.0, 3.0, 21):
        assert all(d >= found.min_distance - 1e-4 for _, d in cell.distances(curve.sample(t), 0.3))
    nearest = min(cell.distances(curve.sample(1.0 + found.time), 0.3), key=lambda pair: pair[1])
    assert cell.bodies.names(nearest[0]) == found.pair and nearest[1] == pytest.approx(found.min_distance, abs=1e-6)


def test_a_distance_that_a_proof_bounds_from_below_is_measured() -> None:
    """The bound was stated as the distance: 6.2 mm for two links that are 8.6 mm apart during the whole motion."""
    ends = np.array([[0.0, -1.57, 1.57, -1.57, -1.57, 0.0], [0.9, -0.85, 1.5, -1.9, -1.57, 0.0]])
    cell, time, still = Cell(load_robot("ur5e"), CellRequest()), np.array([0.0, 2.5]), np.zeros_like(ends)
    found = cell.measured(cell.prove(time, ends, still, still), curve := MotionCurve(time, ends, still, still))
    assert found.time is not None and found.min_distance is not None
    assert found.min_distance == pytest.approx(
        min(d for _, d in cell.distances(curve.sample(found.time), 0.1)), abs=1e-6
    )


def test_gravity_is_the_scene_s_down(ur5: Robot, model: PowerModel) -> None:
    """Upside down, the torque of holding still turns round; turned about the vertical it stays."""
    q = np.array([[0.2, -1.0, 1.2, -0.4, 0.3, 0.0]])
    still = np.zeros_like(q)
    down = np.array([0.0, 0.0, -9.81])

    def held(*base: float) -> np.ndarray:
        return Scorer(ur5, model.standing(*base[3:5])).drive(q, still, still, np.zeros(1))[0]

    assert np.allclose(held(0, 0, 0, np.pi, 0, 0.3), -held(0, 0, 0, 0, 0, 1.0))
    assert np.allclose(held(0, 0, 0, 2 * np.pi, 0, 0), ur5.body.torque(q, still, still))
    turned = asked("--base", "0,0,0,0.4,-0.7,0.9").base_pose[:3, :3].T @ down
    assert np.allclose(held(0, 0, 0, 0.4, -0.7, 0.9), ur5.body.torque(q, still, still, gravity=turned))
    with pytest.raises(BadInput, match="give one of them"):
        model.standing(0.1, 0).standing(0.2, 0)


def test_without_options_the_body_alone_is_kept_clear() -> None:
    request = asked()
    assert request == CellRequest() and request.checks and request.planner == "auto"
    assert not asked("--self-collision", "off").checks
    assert asked("--self-collision", "off", "--floor", "-0.2").checks


def test_the_payload_box_is_centred_at_the_centre_of_mass() -> None:
    request = asked("--payload", "1.5,0,0,0.1", "--payload-size", "0.1,0.2,0.3")
    assert request.payload_size == (0.1, 0.2, 0.3) and request.payload_at == (0.0, 0.0, 0.1)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--base", "1,2,3"], "3 numbers"),
        (["--base", "1,2,3,0,0,nan"], "not finite"),
        (["--base", "20000,0,0,0,0,0"], "20000 m is too far.* metres, at most 10000"),
        (["--floor", "nan"], "not a height"),
        (["--clearance", "0"], "above 0"),
        (["--planner", "rrt"], "auto, none, ompl"),
        (["--payload-size", "1,1,1"], "belongs to payload"),
        (["--payload", "1", "--payload-size", "1,0,1"], "above 0"),
    ],
)
def test_what_cannot_be_meant_is_one_line(words: list[str], says: str) -> None:
    with pytest.raises(BadInput, match=says) as caught:
        asked(*words)
    assert "\n" not in str(caught.value)


def test_base_turns_as_urdf_does_and_shapes_come_into_its_frame() -> None:
    """Turned by 90 degrees about z and lifted: a box one metre along x of the scene lies along -y of the base."""
    request = asked("--base", "0,0,0.5,0,0,1.5707963267948966")
    at = np.eye(4)
    at[:3, 3] = [1.0, 0.0, 0.0]
    scene = Scene((SceneObject("box", (Shape("box", (0.1, 0.1, 0.1)),), at),), floor=0.0)
    box, floor = scene.placed(request.base_pose)
    assert np.allclose(box.pose[:3, 3], [0.0, -1.0, -0.5])
    assert floor.object == "floor" and np.allclose(floor.pose[:3, 3], [0.0, 0.0, -0.5])
    turned = asked("--base", "0,0,0,0.3,-0.2,0.1").base_pose[:3, :3]
    assert np.allclose(turned @ turned.T, np.eye(3))
    assert np.allclose(turned[2], [np.sin(0.2), np.cos(0.2) * np.sin(0.3), np.cos(0.2) * np.cos(0.3)])


@pytest.mark.parametrize(
    ("height", "flip", "up"),
    [(-0.5, 1, 1), (-0.5, -1, 1), (0.5, 1, -1), (0.0, -1, 1), (0.002, 1, 1), (0.002, -1, 1), (-0.002, -1, 1)],
)
def test_a_plane_leaves_the_base_s_side_free(height: float, flip: int, up: int) -> None:
    pose = np.diag([1.0, flip, flip, 1.0])
    pose[2, 3] = height
    (plane,) = Scene((SceneObject("wall", (Shape("plane"),), pose),)).placed()
    assert np.allclose(plane.pose[:3, 2], [0, 0, up]) and np.isclose(plane.pose[2, 3], height)
    assert np.isclose(np.linalg.det(plane.pose), 1.0)


@pytest.mark.parametrize(("height", "flip"), [(0.002, 1), (0.06, -1), (0.06, 1), (0.5, 1)])
def test_a_table_top_above_the_base_s_origin_bears_the_arm(panda: Robot, height: float, flip: int) -> None:
    """The arm touched a plane 2 mm above it, as if it hung below: "690 mm deep"."""
    pose = np.diag([1.0, flip, flip, 1.0])
    pose[2, 3] = height
    cell = Cell(panda, CellRequest(), Scene((SceneObject("top", (Shape("plane"),), pose),)))
    touches = cell.touching(np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]))  # its first joint is 333 mm up
    assert (touches is not None) == (height > 0.4)


def test_named_pairs_go_before_defaults_and_one_no_is_a_no() -> None:
    pairs = AllowedPairs({("a", "b"): False, ("b", "c"): True}, {"a": True, "b": True, "d": False})
    assert not pairs.allows("b", "a") and pairs.allows("c", "b")
    assert pairs.allows("a", "x") and not pairs.allows("a", "d") and not pairs.allows("x", "y")
    assert AllowedPairs({("a", "z"): True}).allows("z", "a")


def test_contact_with_an_object_in_another_unit_says_so(ur5: Robot) -> None:
    """The arm touched it, "1e+05 mm deep", and only plans that succeeded came with the remark on its unit."""
    hall = SceneObject("hall", (Shape("box", (200.0, 200.0, 200.0)),))
    cell = Cell(ur5, CellRequest(), Scene((hall,), source="hall.yaml"))
    with pytest.raises(
        Infeasible, match=r"touches hall .*; hall\.yaml: object hall measures 200 m; 0\.2 m if in milli"
    ):
        check_free(cell, np.array([0, -1.2, 1.0, -1.0, 0.5, 0]), "start")


@pytest.mark.parametrize(("scale", "moving"), [("1 1 1", True), ("0.001 0.001 -0.001", True), ("1 1 1", False)])
def test_a_moving_link_s_mesh_in_millimetres_is_refused(tmp_path: Path, scale: str, moving: bool) -> None:
    """Its body was 300 m long: around the other links, or far away from them, and its clearance was "proven"."""
    corners = [(x, y, z) for x in (170, 470) for y in (0, 60) for z in (0, 60)]
    faces = [(1, 2, 4), (1, 4, 3), (5, 7, 8), (5, 8, 6), (1, 5, 6), (1, 6, 2), (3, 4, 8), (3, 8, 7), (1, 3, 7),
             (1, 7, 5), (2, 6, 8), (2, 8, 4)]  # fmt: skip
    lines = ["v {} {} {}".format(*corner) for corner in corners] + ["f {} {} {}".format(*face) for face in faces]
    (tmp_path / "part.obj").write_text("\n".join(lines))
    shape = f'<collision><geometry><mesh filename="part.obj" scale="{scale}"/></geometry></collision>'
    (tmp_path / "arm.urdf").write_text(
        f"""<robot name="arm"><link name="base">{"" if moving else shape}</link>
        <link name="arm"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
        {shape if moving else ""}</link><joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
        <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="100"/></joint></robot>"""
    )
    robot = load_robot(tmp_path / "arm.urdf")
    if moving and scale == "1 1 1":
        with pytest.raises(BadInput, match=r'link arm: part\.obj is 300 m long; .* scale="0.001'):
            Cell(robot, CellRequest())
    else:
        assert Cell(robot, CellRequest()).links == 1


@pytest.mark.parametrize(
    ("unit", "metres"), [('meter="0.0254" name="inch"', 0.0254), ("name='mm' meter='1e-3'", 1e-3), ("", 1.0)]
)
def test_collada_files_are_in_the_unit_that_they_state(tmp_path: Path, unit: str, metres: float) -> None:
    """As RViz and MoveIt read them; coal takes every number for metres, and inches made bodies 39 times too large."""
    (tmp_path / "part.dae").write_text(
        f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit {unit}/></asset>
        <library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 2 0 0 0 3
        </float_array><technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param
        name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source><vertices id="v">
        <input semantic="POSITION" source="#p"/></vertices><triangles count="4"><input semantic="VERTEX" source="#v"
        offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles></mesh></geometry></library_geometries>
        <library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/></node></visual_scene>
        </library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
    )
    solid = solids.mesh_file(tmp_path / "part.dae", (1.0, -1.0, 1.0), 100)
    assert np.ptp(solid.hull.points, axis=0) == pytest.approx(np.array([1, 2, 3]) * metres)
