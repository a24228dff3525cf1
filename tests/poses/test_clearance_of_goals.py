"""Goals that are chosen keep the whole clearance that is asked for; only if none can, a nearer one is taken."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plane_arm import HEIGHT, LENGTHS, arm

import energy_opt as eo
from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.front.given import source_model
from energy_opt.motion import Move, Trajectory
from energy_opt.motion.judge.energy import Scorer
from energy_opt.poses.chosen import Candidate, Settling
from energy_opt.poses.freedom import improved
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.pose import Pose, pose_from
from energy_opt.robot import Robot, load_robot

FLAT = {"self_collision": False, "floor": 0.0}


def goal(x: float, z: float) -> Pose:
    """A pose of the tip with free rotation in the arm's plane."""
    return pose_from([x, 0, z, 0, 0, 0], ("ry",), None, "goal")


def test_of_two_branches_the_one_that_keeps_the_clearance_is_chosen(tmp_path: Path) -> None:
    """The nearer one was chosen, 0.21 m over the floor, and half of that was proven."""
    asked: dict[str, Any] = {"goal_pose": [0.6, 0, HEIGHT, 0, 0, 0], "free": ["ry"], "tool": "tip", "duration": 2.0}
    for mode in ("reshape", "retime"):
        found = eo.optimize(
            arm(tmp_path, 2), "source-method-2", start=[0.3, -0.6], mode=mode, clearance=0.3, **FLAT, **asked
        )
        assert found.status == "solved" and found.trajectory.position[-1, 0] < 0
        assert found.document()["certificate"]["clearance"]["lower_bound"] >= 0.3
        assert not [said for said in found.warnings if "of which half" in said]


def test_a_goal_that_is_near_on_every_branch_is_taken_with_a_warning(tmp_path: Path) -> None:
    asked: dict[str, Any] = {"goal_pose": [0.6, 0, 0.2, 0, 0, 0], "free": ["ry"], "tool": "tip", "duration": 2.0}
    found = eo.optimize(
        arm(tmp_path, 2), "source-method-2", start=[0.3, -0.6], mode="retime", clearance=0.3, **FLAT, **asked
    )
    assert found.status == "solved" and found.document()["certificate"]["clearance"]["lower_bound"] > 0.05
    (said,) = (said for said in found.warnings if "of which half is kept" in said)
    assert "goal-pose" in said and "300 mm" in said and "l1" in said and "floor" in said


@pytest.fixture
def three(tmp_path: Path) -> Robot:
    """An arm with one joint more than its poses need."""
    return load_robot(str(arm(tmp_path, 3)))


def test_steps_along_the_freedom_keep_the_clearance(three: Robot) -> None:
    """They went on until the elbow touched the floor."""
    tool, cell = ToolKinematics(three, "tip"), Cell(three, CellRequest(clearance=0.25, **FLAT))
    q = np.array([0.1, 0.2, -0.5])
    at = tool(q[None])
    pose = goal(float(at[1][0, 0]), float(at[1][0, 2]))
    assert not cell.short(q).any()
    found = improved(tool, pose, q, lambda at: HEIGHT - LENGTHS[0] * np.sin(at[:, 0]), cell)
    assert found[0] > q[0] + 0.1 and not cell.short(found).any()
    near = np.array([0.9, -0.6, -0.5])  # an elbow that is nearer from the start comes no nearer
    assert cell.short(near).any()
    at = tool(near[None])
    found = improved(tool, goal(float(at[1][0, 0]), float(at[1][0, 2])), near, lambda at: -at[:, 0], cell)
    assert (cell.short(found) <= cell.short(near) + 1e-5).all()


def test_an_optimum_of_curve_and_goal_that_is_too_near_is_left_out(three: Robot) -> None:
    tool, cell = ToolKinematics(three, "tip"), Cell(three, CellRequest(clearance=0.25, **FLAT))
    q, low = np.array([0.1, 0.2, -0.5]), np.array([0.9, -0.6, -0.5])
    pose = pose_from([0.6, 0, HEIGHT, 0, 0, 0], ("x", "z", "ry"), None, "goal")  # both reach it

    def line(end: np.ndarray) -> Trajectory:
        time = np.linspace(0, 1, 5)
        return Trajectory(three.joints, time, time[:, None] * end, np.tile(end, (5, 1)), np.zeros((5, 3)))

    move, scorers = Move(np.zeros(3), q, "reshape", 1.0), [Scorer(three, source_model(three))]
    for end, kept in ((q, True), (low, False)):
        settling = Settling(tool, scorers, cell, lambda move, motion, *more, end=end: (line(end), ()), None, ())
        found = settling(move, Candidate(q, 0.0, pose=pose), line(q), False)
        assert found is not None and any(np.array_equal(c.goal, end) for c, _ in found) == kept


def test_a_job_keeps_the_clearance_at_its_poses(tmp_path: Path) -> None:
    text = f'format = "energy-opt/job/1"\nrobot = "{arm(tmp_path, 2).name}"\ncycle_time = 4.0\n'
    text += 'home = [0.3, -0.6]\nmode = "retime"\n'
    text += f'[[step]]\npose = [0.6, 0, {HEIGHT}, 0, 0, 0]\nfree = ["ry"]\n[[step]]\nto = "home"\n'
    for height, words in ((HEIGHT, 0), (0.2, 1)):
        (tmp_path / "job.toml").write_text(text.replace(f"0.6, 0, {HEIGHT}", f"0.6, 0, {height}"))
        found = eo.job(tmp_path / "job.toml", model="source-method-2", tool="tip", clearance=0.3, **FLAT).document()
        (end,) = found["poses"]
        assert found["status"] == "solved" and (words or end["goal"][0] < 0)  # the elbow is up
        assert len([said for said in found["warnings"] if "of which half is kept" in said]) == words


def test_an_arm_of_a_cell_says_which_chosen_positions_are_near(tmp_path: Path) -> None:
    text = f'format = "energy-opt/job/2"\ncycle_time = 8.0\n[[robot]]\nname = "a"\nrobot = "{arm(tmp_path, 2).name}"\n'
    text += '[[robot.step]]\npose = [0.6, 0, 0.2, 0, 0, 0]\nfree = ["ry"]\n[[robot.step]]\nto = [0.3, -0.6]\n'
    (tmp_path / "cell.toml").write_text(text)
    found = eo.job(tmp_path / "cell.toml", model="source-method-2", tool="tip", clearance=0.3, starts=1, **FLAT)
    assert [said for said in found.document()["warnings"] if "robot a: step 1" in said and "of which half" in said]
