"""Poses as options, jobs and files give them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from faults import faults_of
from tool_poses import JOB

import energy_opt as eo
from energy_opt.cell.load import scene_of
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.front.moves import ends_of
from energy_opt.jobs.file import load_job
from energy_opt.poses.given import Given, in_base, poses_of_request
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.pose import Freedom, pose_from
from energy_opt.requests.moves import OptimizeRequest
from energy_opt.robot import load_robot


def test_words_of_poses() -> None:
    pose = pose_from("0.1,0.2,0.3,0,0,0.7071068,0.7071068", ["rz:-30:30"], "1mm,2deg")
    assert np.allclose(pose.matrix[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-6)
    assert pose.tolerance == pytest.approx((1e-3, np.radians(2)))
    assert np.allclose(pose_from([0.1, 0.2, 0.3, 0, 0, np.pi / 2]).matrix, pose.matrix, atol=1e-6)
    for words in ("1,2,3", "0,0,0,1,1,1,1", "400,0,300,0,0,0", "a,0,0,0,0,0"):
        with pytest.raises(BadInput):
            pose_from(words)
    with pytest.raises(BadInput, match="expected one of x, y, z"):
        Freedom.of("yaw")
    with pytest.raises(BadInput, match="two distances"):
        pose_from("0.1,0.2,0.3,0,0,0", (), "1mm,1mm")
    with pytest.raises(BadInput, match=r"400 m is too far.*millimetres\? 0.4 m"):
        pose_from([400, 0, 300, 0, 0, 0])
    with pytest.raises(BadInput, match="nan is not finite"):
        pose_from([0.4, np.nan, 0.3, 0, 0, 0])
    for tolerance in ((1, 1), "5m,1deg", (0.001, 5)):
        with pytest.raises(BadInput, match=r"a tolerance of .*at most"):
            pose_from("0.1,0.2,0.3,0,0,0", (), tolerance)


def test_poses_in_a_job_stay_open_until_they_are_chosen(tmp_path: Path, ur: ToolKinematics) -> None:
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    job = load_job(path, lambda name: ur.robot)
    assert job.open == (0, 1)
    assert job.steps[0].pose.free[0].high == pytest.approx(np.radians(30))
    assert job.steps[1].pose.frame == "world"
    assert job.steps[1].pose.tolerance == pytest.approx((1e-3, np.radians(1)))
    ends = {0: np.ones(6), 1: np.zeros(6)}
    closed = job.at(ends)
    assert not closed.open
    assert np.array_equal(closed.steps[1].start, ends[0]) and np.array_equal(closed.steps[2].start, ends[1])
    assert np.array_equal(closed.steps[0].start, job.steps[2].goal)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('to = "part"', 'to = "home"\nfree = ["rz"]', "is joint positions; free belongs to a pose"),
        ('to = "part"', 'to = "part"\npose = "part"', "either `to` or `pose`"),
        ('free = ["rz:-30:30"]', 'free = ["yaw"]', "part: free yaw: expected one of x, y, z"),
        ("[0.45, 0.2, 0.1, 3.14159265, 0, 0]", "[0.45, 0.2]", "2 numbers; expected X,Y,Z"),
        ('"1mm,1deg"', "3", "such as"),
        ('to = "home"', 'pose = "part"', "does not return to where the cycle begins"),
    ],
)
def test_faults_of_poses_in_a_job(tmp_path: Path, ur: ToolKinematics, old: str, new: str, says: str) -> None:
    path = tmp_path / "job.toml"
    path.write_text(JOB.replace(old, new))
    assert any(says in line for line in faults_of(load_job, path, lambda name: ur.robot))


def test_a_pose_in_the_frame_of_an_object_and_from_a_message(tmp_path: Path, ur: ToolKinematics) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "objects: [{name: box_1, type: box, size: [0.1, 0.1, 0.1], position: [0.5, 0.1, 0.2],"
        " quaternion: [0, 0, 0.70710678, 0.70710678]}]\nposes: {pick: {pose: 'box_1: 0.1,0,0,0,0,0', free: [rz]}}\n"
    )
    (tmp_path / "at.yaml").write_text(
        "header: {frame_id: box_1}\npose: {position: {x: 0.1, y: 0, z: 0}, orientation: {x: 0, y: 0, z: 0, w: 1}}\n"
    )
    request = CellRequest(scene=scene, base=(0.5, 0, 0, 0, 0, np.pi / 2))
    given = Given(tmp_path, poses_of_request(request))
    for word in ("pick", "at.yaml", "box_1: 0.1,0,0,0,0,0"):
        pose = in_base(given.pose(word, "goal"), ur.robot, scene_of(request), request.base_pose)
        # the object is turned by 90 deg as the base is; 0.1 m along its x is 0.1 m along the scene's y
        assert np.allclose(pose.matrix[:3, 3], [0.2, 0.0, 0.2], atol=1e-6)
        assert np.allclose(pose.matrix[:3, :3], np.eye(3), atol=1e-6)
    assert given.pose("pick", "goal").free[0].axis == "rz"
    echoed = tmp_path / "echoed.yaml"  # as ROS prints a message
    echoed.write_text((tmp_path / "at.yaml").read_text().replace("box_1", "/box_1") + "---\n")
    assert np.array_equal(given.pose("echoed.yaml", "goal").matrix, given.pose("at.yaml", "goal").matrix)
    assert given.pose("echoed.yaml", "goal").frame == "box_1"
    echoed.write_text(2 * echoed.read_text())
    with pytest.raises(BadInput, match="holds 2 documents"):
        given.pose("echoed.yaml", "goal")
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(scene.read_text().replace("free: [rz]", "free: [turn]"))
    assert main(["check", str(scene), "--quiet"]) == 0
    assert main(["check", str(wrong), "--quiet"]) == 2
    with pytest.raises(BadInput, match="no frame 'box_2'; did you mean 'box_1'"):
        in_base(given.pose("box_2: 0,0,0,0,0,0", "goal"), ur.robot, scene_of(request), request.base_pose)


@pytest.mark.parametrize("name", ["ur5", "ur5e", "z1"])
def test_the_frame_world_is_the_scenes_where_a_link_has_this_name(name: str) -> None:
    """The URDFs of ur5 and z1 have a link `world`, which moves with --base."""
    pose = Given().pose("world: 0.4,0.3,1.2,0,0,0", "goal")
    base = CellRequest(base=(0.5, 0, 1, 0, 0, np.pi / 2)).base_pose
    assert np.allclose(in_base(pose, load_robot(name), None, base).matrix[:3, 3], [0.3, 0.1, 0.2])


def test_a_base_and_its_poses_may_be_far_from_the_scene_s_origin(ur: ToolKinematics) -> None:
    """A base 120 m away was refused, in words that were kept to."""
    asked = CellRequest(base=(120.0, -40.0, 0.0, 0.0, 0.0, 0.0))
    pose = Given().pose("world: 120.4,-40.2,0.3,0,0,0", "goal")
    found = in_base(pose, ur.robot, None, asked.base_pose)
    assert np.allclose(found.matrix[:3, 3], [0.4, -0.2, 0.3])
    with pytest.raises(BadInput, match=r"400 m is too far.*millimetres"):
        in_base(Given().pose("world: 400,0,300,0,0,0", "goal"), ur.robot, None, np.eye(4))


def test_named_numbers_that_may_be_a_pose_are_remarked(tmp_path: Path, ur: ToolKinematics) -> None:
    path = tmp_path / "job.toml"
    part = 'part = { pose = [0.45, 0.2, 0.1, 3.14159265, 0, 0], free = ["rz:-30:30"] }'
    assert part in JOB
    path.write_text(JOB)
    assert not load_job(path, lambda name: ur.robot).remarks
    path.write_text(JOB.replace(part, "part = [0.45, 0.2, 0.1, 3.14159265, 0, 0]"))
    (said,) = load_job(path, lambda name: ur.robot).remarks
    assert "part: these 6 numbers are joint positions; a pose of the tool is part = { pose = [...] }" in said
    path.write_text(JOB.replace(part, "part = [0.45, 0.2, 0.1, 0, 1, 0, 0]"))
    assert any(
        "a pose of the tool is { pose = [...] }" in line for line in faults_of(load_job, path, lambda name: ur.robot)
    )


def test_a_pose_is_numbers_or_the_same_in_one_text() -> None:
    numbers = [0.45, 0.25, 0.3, 1.0, 0.0, 0.0, 0.0]
    assert eo.Pose("0.45,0.25,0.3,1,0,0,0").same_as(eo.Pose(numbers))
    with pytest.raises(BadInput, match=r"pose 0\.45,up"):
        eo.Pose("0.45,up,0.3,0,0,0")


def test_a_matrix_that_is_no_pose_is_refused_and_a_rounded_one_is_a_rotation() -> None:
    """Scaled, mirrored and transposed ones were taken, and the arm went elsewhere."""
    right = eo.Pose("0.4,0.2,0.3,1,0.5,0.2").matrix
    assert np.array_equal(eo.Pose(right).matrix, right)
    rounded = eo.Pose(np.round(right, 3)).matrix[:3, :3]
    assert np.allclose(rounded @ rounded.T, np.eye(3), atol=1e-12) and np.allclose(rounded, right[:3, :3], atol=1e-3)
    for wrong in (1.5 * right, right * [1.5, 1.5, 1.5, 1], right * [-1, 1, 1, 1], right.T, np.zeros((4, 4))):
        with pytest.raises(BadInput, match="the matrix is no pose"):
            eo.Pose(wrong)
    listed = Given().pose(right.tolist(), "goal")
    assert np.array_equal(listed.matrix, right)
    with pytest.raises(BadInput, match=r"goal = \[\[1.*; expected X,Y,Z"):
        Given().pose([[1, 0], [1]], "goal")


def test_freedom_and_tolerance_from_python_are_checked_as_words_are() -> None:
    """A word was read letter by letter; a tolerance that is none failed later, or made every answer invalid."""
    numbers = [0.4, 0.2, 0.3, 3.14, 0, 0]
    assert eo.Pose(numbers, "rz").same_as(eo.Pose(numbers, ["rz"]))
    assert eo.Pose(numbers, (), (0, 0)).same_as(eo.Pose(numbers, (), "0mm,0deg"))
    for tolerance in (0.001, (-1, 1), (np.nan, 1), (0.1, 0.1, 0.1), ("1", "1"), ((1, 2), 3)):
        with pytest.raises(BadInput, match=r"tolerance .*; expected"):
            eo.Pose(numbers, (), tolerance)
    for free in (3, [3]):
        with pytest.raises(BadInput, match="free 3: expected AXIS"):
            eo.Pose(numbers, free)


def test_a_pose_on_the_way_may_be_numbers_or_a_matrix() -> None:
    """`goal_pose` took them; `via_pose` read each number as a pose."""
    robot, near = load_robot("ur5e"), [0.4, 0.2, 0.3, 3.14, 0, 0]
    start, goal = [0, -1.57, 1.57, -1.57, -1.57, 0], [0.3, -1.2, 1.3, -1.5, -1.5, 0]
    for via in (near, eo.Pose(near).matrix, eo.Pose(near).matrix.tolist()):
        ends = ends_of(OptimizeRequest(robot="ur5e", start=start, goal=goal, via_pose=via), robot, CellRequest())
        assert ends is not None and np.allclose(ends.via[0].matrix, eo.Pose(near).matrix)
