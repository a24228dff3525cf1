"""Goals of retimed moves: their straight paths must fit into the time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plane_arm import arm

import energy_opt as eo
from energy_opt.errors import Infeasible
from energy_opt.front.given import source_model
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.result import Result
from energy_opt.poses.choose import Chooser
from energy_opt.poses.estimate import fastest_straight
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.pose import pose_from
from energy_opt.poses.sets import positions_of
from energy_opt.robot import load_robot

START = np.array([0.3, -0.6, 0.2])
PLACE = [0.7, 0, 0.2, 0, 0, 0]


def test_durations_between_two_that_work_work_too(tmp_path: Path) -> None:
    """Goals were moved along their freedom to where the straight path was too slow, and no others were tried."""
    asked = {"start": START, "goal_pose": PLACE, "free": "ry", "tool": "tip", "self_collision": False}
    for seconds in (0.55, 0.6, 0.65, 0.7):
        found = eo.optimize(arm(tmp_path, 3), "source-method-2", **asked, mode="retime", duration=seconds)
        assert found.status == "solved" and found.trajectory.duration == pytest.approx(seconds)


def test_the_nearest_goal_is_tried_where_the_cheaper_ones_fail(tmp_path: Path) -> None:
    robot, tried = load_robot(str(arm(tmp_path, 3))), list[np.ndarray]()
    tool, planner = ToolKinematics(robot, "tip"), Planner(robot, source_model(robot), Settings(starts=1))
    pose = pose_from(PLACE, ("ry",), None, "goal")

    def none(move: Move, warm: object = (), *, confirm: bool = True) -> Result:
        tried.append(move.goal)
        raise Infeasible("too short")

    chooser = Chooser(tool, [Scorer(robot, planner.model)], None, none, planner.sketch, planner.settle)
    with pytest.raises(Infeasible, match="too short"):
        chooser.choose(Move(START, START, "retime", 1.0), [pose])
    found = positions_of(tool, pose, None, near=START)
    nearest = found[np.argmin(fastest_straight(robot, np.broadcast_to(START, found.shape), found))]
    assert any(np.allclose(nearest, goal) for goal in tried)


def test_the_fastest_straight_move_has_one_timing_for_all_joints(tmp_path: Path) -> None:
    robot = load_robot(str(arm(tmp_path, 3)))
    v, a, j, far = np.array([1.0, 2.0, 2.0]), np.array([4.0, 1.0, 4.0]), np.full(3, np.inf), np.array([[1.0, 1.0, 0.0]])

    def seconds(v: np.ndarray, a: np.ndarray, j: np.ndarray, far: np.ndarray) -> float:
        limits = robot.limits.replace(velocity=v, acceleration=a, jerk=j)
        return float(fastest_straight(replace(robot, limits=limits), 0 * far, far)[0])

    assert seconds(v, a, j, far) == pytest.approx(2.0)  # the first joint's speed and the second one's acceleration
    assert seconds(v, a, j, 4 * far) == pytest.approx(4 / 1 + 1 / 1)
    assert seconds(v, a, np.full(3, 4.0), far * 0.01) == pytest.approx((32 * 0.01 / 4) ** (1 / 3))
    assert seconds(v, a, np.full(3, 4.0), far * 8) == pytest.approx(8 / 1 + 1 / 1 + 1 / 4)
