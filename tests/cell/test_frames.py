"""The frames of a scene's objects: the scene's own, that of a link that does not move, and names that are none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tool_poses import JOB

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene
from energy_opt.cell.scene_files import read_scene
from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.front.given import source_model
from energy_opt.jobs.file import load_job
from energy_opt.placement import PlaceRequest, place
from energy_opt.poses.given import Given, in_base
from energy_opt.robot import Robot, load_robot

# `mount` is 1 m along the base's y, turned by 90 deg: its x is the base's y
ARM = """<robot name="arm"><link name="base"/><link name="mount"/>
<link name="l1"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 0.2"/><geometry><box size="0.1 0.1 0.4"/></geometry></collision></link>
<joint name="m" type="fixed"><parent link="base"/><child link="mount"/><origin xyz="0 1 0" rpy="0 0 1.570796326794897"/>
</joint><joint name="j1" type="revolute"><parent link="mount"/><child link="l1"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="2" effort="50"/></joint></robot>"""


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(ARM)
    return load_robot(str(path))


def at(x: float, y: float, z: float) -> dict[str, Any]:
    return {"position": [x, y, z], "orientation": [0, 0, 0, 1]}


def box(frame: str, name: str = "crate", **more: Any) -> dict[str, Any]:
    solid = [{"type": "box", "dimensions": [0.1, 0.1, 0.1]}]
    entry = {"id": name, "header": {"frame_id": frame}, "primitives": solid, "primitive_poses": [at(0.5, 0, 0)]}
    return {**entry, **more}


def scene(folder: Path, *objects: dict[str, Any], **more: Any) -> Path:
    path = folder / "scene.json"
    path.write_text(json.dumps({"world": {"collision_objects": list(objects)}, **more}))
    return path


def place_in_base(robot: Robot, path: Path, request: CellRequest) -> np.ndarray:
    """Where the last object is in the base frame; the same after the scene's way to a worker process."""
    read = read_scene(path)
    found = [Cell(robot, request, each).bodies.all[-1].pose[:3, 3] for each in (read, Scene.from_text(read.to_text()))]
    assert np.array_equal(*found)
    return found[0]


@pytest.mark.parametrize(
    ("frame", "expected"),
    [
        ("mount", [0, 1.5, 0]), ("/mount", [0, 1.5, 0]),
        ("", [-1.5, 0, 0]), ("world", [-1.5, 0, 0]), ("map", [-1.5, 0, 0]), ("odom", [-1.5, 0, 0]),
    ],
)  # fmt: skip
def test_an_object_is_in_the_frame_that_it_names(tmp_path: Path, arm: Robot, frame: str, expected: list[float]) -> None:
    """All frames were taken as the scene's: a clearance was proven from a post that stood elsewhere."""
    asked = CellRequest(base=(2, 0, 0, 0, 0, 0))
    assert np.allclose(place_in_base(arm, scene(tmp_path, box(frame)), asked), expected)
    posed = box(frame, pose=at(0.5, 0, 0), primitive_poses=[at(0, 0, 0)])
    assert np.allclose(place_in_base(arm, scene(tmp_path, posed), asked), expected)
    if frame:  # a pose of the tool means the same
        pose = in_base(Given().pose(f"{frame.strip('/')}: 0.5,0,0,0,0,0", "goal"), arm, None, asked.base_pose)
        assert np.allclose(pose.matrix[:3, 3], expected)


@pytest.mark.parametrize(
    ("frame", "says"), [("base", "base: the frame of objects is taken"), ("hall", "no link is named 'hall'")]
)
def test_the_root_link_and_a_single_unknown_name_are_the_scenes_frame_and_a_warning_says_so(
    tmp_path: Path, arm: Robot, frame: str, says: str
) -> None:
    """Planning scenes name the root link; `place` and --base move the arm among their objects."""
    path, asked = scene(tmp_path, box(frame)), CellRequest(base=(2, 0, 0, 0, 0, 0))
    assert np.allclose(place_in_base(arm, path, asked), [-1.5, 0, 0])
    assert any(says in warning for warning in Cell(arm, asked, read_scene(path)).warnings)
    if frame == "base":  # without a base, both are the same
        assert not any(says in warning for warning in Cell(arm, CellRequest(), read_scene(path)).warnings)


def test_an_object_may_be_in_the_frame_of_another_and_an_unknown_name_beside_the_scenes_is_refused(
    tmp_path: Path, arm: Robot
) -> None:
    path = scene(tmp_path, box("world", "post", pose=at(1, 0, 0)), box("post"))
    assert np.allclose(place_in_base(arm, path, CellRequest()), [1.5, 0, 0])
    with pytest.raises(BadInput, match="object crate: no frame 'hall'"):
        Cell(arm, CellRequest(), read_scene(scene(tmp_path, box("world", "post"), box("hall"))))


def test_frames_that_the_file_relates_to_each_other(tmp_path: Path, arm: Robot) -> None:
    turn = {"translation": [0, 0, 1], "rotation": [0, 0, 0, 1]}
    rows = [
        {"header": {"frame_id": parent}, "child_frame_id": child, "transform": turn}
        for parent, child in (("room", "cell"), ("cell", "shelf"), ("mount", "tray"))
    ]
    asked = CellRequest(base=(2, 0, 0, 0, 0, 0))
    for frame, expected in (("room", [-1.5, 0, 0]), ("shelf", [-1.5, 0, 2]), ("tray", [0, 1.5, 1])):
        path = scene(tmp_path, box("mount", "other"), box(frame), fixed_frame_transforms=rows)
        assert np.allclose(place_in_base(arm, path, asked), expected)
    moved = [box("mount"), {**box("room", pose=at(0, 0, 3)), "operation": 3}]
    path = scene(tmp_path, *moved, fixed_frame_transforms=rows)
    assert np.allclose(place_in_base(arm, path, asked), [-1.5, 0, 3])
    with pytest.raises(BadInput, match="object crate: shapes are appended in another frame"):
        read_scene(scene(tmp_path, box("mount"), {**box("base"), "operation": 2}))


@pytest.mark.parametrize(
    ("things", "says"),
    [
        ([box("l1")], "object crate: l1 moves with the arm"),
        ([box("hall", "a"), box("mout")], "object a: no frame 'hall'; frames are world, base, mount"),
    ],
)
def test_frames_that_move_or_are_unknown_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], things: list[dict[str, Any]], says: str
) -> None:
    urdf, path = tmp_path / "arm.urdf", scene(tmp_path, *things)
    urdf.write_text(ARM)
    with pytest.raises(BadInput, match=says):
        Cell(load_robot(str(urdf)), CellRequest(), read_scene(path))
    assert main(["check", str(path), "--robot", str(urdf)]) == 2
    capsys.readouterr()
    assert main(["check", str(path)]) == 0  # a file alone does not say which links there are
    assert "not checked without --robot" in capsys.readouterr().err


def test_a_frame_that_two_arms_of_a_cell_have_is_refused(tmp_path: Path, arm: Robot) -> None:
    read = read_scene(scene(tmp_path, box("mount")))
    for x, says in ((0.0, ""), (1.0, "several frames are named 'mount'")):
        asked = CellRequest(beside=(("other", arm, (x, 0, 0, 0, 0, 0)),))
        if not says:
            assert np.allclose(Cell(arm, asked, read).bodies.all[-1].pose[:3, 3], [0, 1.5, 0])
            continue
        with pytest.raises(BadInput, match=says):
            Cell(arm, asked, read)


def test_an_object_has_not_the_name_of_a_body_of_the_arm(tmp_path: Path, arm: Robot) -> None:
    """`l1` and `l1` touched, and nobody could say which of them may."""
    with pytest.raises(BadInput, match="object l1: a link has this name; give each object its own name"):
        Cell(arm, CellRequest(), read_scene(scene(tmp_path, box("world", "l1"))))
    Cell(arm, CellRequest(), read_scene(scene(tmp_path, box("world", "mount"))))  # a link without a body


def test_place_refuses_objects_that_would_move_with_the_base(tmp_path: Path) -> None:
    path, robot = tmp_path / "job.toml", load_robot("ur5e")
    path.write_text(JOB)
    asked = CellRequest(scene=scene(tmp_path, box("base_link_inertia")))  # turned against the root, base_link
    with pytest.raises(BadInput, match="object crate: its frame base_link_inertia moves with the base"):
        place(load_job(path, lambda name: robot), source_model(robot), PlaceRequest((0, 0.1, 0, 0, 0, 0)), cell=asked)
