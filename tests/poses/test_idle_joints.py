"""Joints that do not move the tool keep their positions where goals are poses: a gripper does not drop its part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mimic_arms import PALLETIZER, START
from scipy.spatial.transform import Rotation
from tool_poses import pose_at

import energy_opt as eo
from energy_opt.cell.request import CellRequest
from energy_opt.front.given import source_model
from energy_opt.jobs.file import load_job
from energy_opt.jobs.posed import Posed
from energy_opt.motion import Settings
from energy_opt.poses.freedom import directions, has_freedom
from energy_opt.poses.inverse import ToolKinematics, other_turns, reach
from energy_opt.poses.pose import Freedom
from energy_opt.robot import Robot, load_robot

OPEN = 0.02  # [m] of the gripper, the last of five joints
THERE = np.array([0.8, 0.4, 0.3, 0.5, 0.0])


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(PALLETIZER)
    return load_robot(path)


@pytest.mark.parametrize(
    ("tool", "moving"), [("flange", "11110"), ("head", "11100"), ("rod", "11000"), ("finger_b", "11111")]
)
def test_joints_move_the_tool_by_themselves_or_by_followers(arm: Robot, tool: str, moving: str) -> None:
    assert "".join(map(str, ToolKinematics(arm, tool).moving.astype(int))) == moving


def test_other_joints_are_no_freedom_of_a_pose(arm: Robot) -> None:
    tool = ToolKinematics(arm, "flange")
    pose = pose_at(tool, THERE, free=(Freedom("rz"),))
    assert not has_freedom(tool, pose_at(tool, THERE))
    assert np.abs(directions(tool, pose, THERE)) == pytest.approx(np.eye(5)[3:4], abs=1e-6)  # the flange alone
    near = np.append(THERE[:4], OPEN)
    assert (reach(tool, pose, near=near).positions[:, 4] == OPEN).all()
    column = ToolKinematics(arm, "head")
    assert (other_turns(near, None, column)[:, 3:] == near[3:]).all(), "the flange has no limits, but stays"


def test_a_move_to_a_pose_leaves_the_gripper_as_it_is(arm: Robot) -> None:
    tool, start = ToolKinematics(arm, "flange"), np.append(START[:4], OPEN)
    poses = [pose_at(tool, THERE + shift, free=(Freedom("rz"),)) for shift in (0.0, 0.1)]
    given = {"mode": "retime", "duration": 2.0, "tool": "flange", "self_collision": False}
    found = eo.optimize(arm, "source-method-2", start=start, goal=eo.AnyOf(poses), **given)
    assert found.trajectory.position[:, 4] == pytest.approx(OPEN, abs=1e-9)


def test_a_step_to_a_pose_leaves_the_gripper_as_the_step_before_it(arm: Robot, tmp_path: Path) -> None:
    at = pose_at(ToolKinematics(arm, "flange"), THERE).matrix
    pose = [float(x) for x in (*at[:3, 3], *Rotation.from_matrix(at[:3, :3]).as_euler("xyz"))]
    path, opened = tmp_path / "job.toml", [*START[:4].tolist(), OPEN]
    steps = "".join(f"[[step]]\n{key} = {value}\n" for key, value in (
        ("pose", pose), ("to", START.tolist()), ("pose", pose), ("to", opened))
    )  # fmt: skip
    path.write_text(f'format = "energy-opt/job/1"\nrobot = "arm"\ncycle_time = 9.0\n{steps}')
    job = load_job(path, lambda name: arm)
    posed = Posed(job, source_model(arm), Settings(), CellRequest(tool="flange", self_collision=False))
    for ends in (posed.choices()[0], posed.greedy()):
        assert [ends[k][4] for k in range(4)] == [OPEN, 0.0, 0.0, OPEN]
