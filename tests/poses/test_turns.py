"""Joints of start poses, via poses and stations of jobs turn by whole turns where that pays."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tool_poses import pose_at

import energy_opt as eo
from energy_opt.cell.request import CellRequest
from energy_opt.errors import Infeasible
from energy_opt.front.given import source_model
from energy_opt.jobs.file import load_job
from energy_opt.jobs.posed import Posed
from energy_opt.motion import Settings
from energy_opt.poses.cheapest_move import nearest_move
from energy_opt.poses.choose import Chooser
from energy_opt.poses.given import Ends
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.turns import nearest_pairs, unwound
from energy_opt.robot import load_robot

TURN = 2 * np.pi
NEAR_GOAL = np.array([0.4, -1.2, 1.3, -1.6, -1.4, 4.2])  # the last joint is a turn away from where it is near zero
GOAL = np.array([0.1, -1.5, 1.6, -1.5, -1.2, 4.5])


@pytest.mark.parametrize("closed", [True, False])
def test_a_chain_is_unwound_to_the_least_travel_of_all_turns(ur: ToolKinematics, closed: bool) -> None:
    limits, rng = ur.robot.limits, np.random.default_rng(2)
    chain, turning = [*rng.uniform(-np.pi, np.pi, (4, 6))], [True, False, True, True]
    chain[1][5] = 5.0
    found = np.array(unwound(ur, chain, turning, closed))
    assert np.array_equal(found[1], chain[1])
    turns = (found - chain) / TURN
    assert np.allclose(turns, np.round(turns))
    assert (found >= limits.lower).all() and (found <= limits.upper).all()

    def travel(q: np.ndarray) -> float:
        return float(np.abs(np.diff([*q, q[0]] if closed else q)).sum())

    for j in range(6):
        ways = [np.array([q[j] for q in chain]) + TURN * np.insert(k, 1, 0) for k in product((-1, 0, 1), repeat=3)]
        inside = [way for way in ways if (way >= limits.lower[j]).all() and (way <= limits.upper[j]).all()]
        assert travel(found[:, j]) == pytest.approx(min(map(travel, inside)))


def test_branches_are_compared_at_their_nearest_turns_within_the_limits(ur: ToolKinematics) -> None:
    a, b = np.array([[3.0, 3.0, 3.0, 0.1, 0.2, 4.2]]), np.array([[-3.0, -3.0, -3.0, 0.0, 0.3, -2.0]])
    may, not_ = np.array([True]), np.array([False])
    one, two = nearest_pairs(ur, a, b, may, may)
    assert np.abs(one - two)[0] == pytest.approx([TURN - 6, TURN - 6, 6.0, 0.1, 0.1, TURN - 6.2])  # the elbow cannot
    one, two = nearest_pairs(ur, a, b, not_, not_)
    assert np.array_equal(one, a) and np.array_equal(two, b)


def test_a_start_pose_is_taken_near_a_goal_a_turn_away(ur: ToolKinematics) -> None:
    """It was taken near zero, from where 1.5 s are too short."""
    given = {"goal": GOAL, "duration": 1.5, "starts": 1}
    found = eo.optimize(ur.robot, "source-method-2", start=pose_at(ur, NEAR_GOAL), **given)
    own = eo.optimize(ur.robot, "source-method-2", start=NEAR_GOAL, **given)
    assert found.status == "solved" and found.energy.loss <= 1.01 * own.energy.loss


def test_a_joint_without_limits_starts_near_a_goal_many_turns_away() -> None:
    """It began near zero: the shortest duration was 20 s."""
    tool = ToolKinematics(load_robot("kinova"))
    start, goal = np.array([20.2, 2.6, 1.8, -14.0, 1.0, 9.0]), [20.0, 2.4, 1.7, -13.8, 0.9, 9.2]
    given = {"goal": goal, "duration": 2.0, "starts": 1, "self_collision": False}
    found = eo.optimize(tool.robot, "source-method-2", start=pose_at(tool, start), **given)
    assert found.status == "solved" and np.abs(found.trajectory.position[0] - start).max() < np.pi


def test_the_least_time_from_a_start_pose_is_that_from_its_turn_near_the_goal(ur: ToolKinematics) -> None:
    ends = Ends(pose_at(ur, NEAR_GOAL), (GOAL,))
    near = nearest_move(ends, eo.Move(GOAL, GOAL), ur.robot, None, Settings())
    assert near.start == pytest.approx(NEAR_GOAL, abs=1e-6) and np.array_equal(near.goal, GOAL)
    zero = nearest_move(replace(ends, goals=(ends.start,)), eo.Move(GOAL, GOAL), ur.robot, None, Settings())
    assert np.abs(zero.start).max() <= np.pi


def test_both_poses_of_a_move_are_turned_together() -> None:
    """Branches were compared at turns near zero, which are far apart here: the move took 87.9 J instead of 76.9 J."""
    tool = ToolKinematics(load_robot("ur10e"))
    start, goal = [3.43, 3.93, 0.76, 4.99, 2.34, 1.98], [2.82, 2.83, 1.45, 4.97, 1.96, 1.9]
    poses = {"start": pose_at(tool, np.array(start)), "goal": pose_at(tool, np.array(goal))}
    found = eo.optimize(tool.robot, **poses, duration=0.79, starts=1)
    assert found.status == "solved" and found["robust"]["total"] < 78


def test_the_next_start_is_solved_where_there_is_no_answer_from_the_first(
    ur: ToolKinematics, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Starts are compared by sketches, which ignore bodies."""
    tried: list[np.ndarray] = []
    choose = Chooser.choose

    def failing(chooser: Chooser, move: eo.Move, goals: object) -> object:
        tried.append(move.start)
        if len(tried) == 1:
            raise Infeasible("it touches something")
        return choose(chooser, move, goals)

    monkeypatch.setattr(Chooser, "choose", failing)
    start = pose_at(ur, NEAR_GOAL)
    found = eo.optimize(ur.robot, "careful", start=start, goal=GOAL, duration=2.5, starts=1)
    assert found.status == "solved" and len(tried) == 2
    assert np.abs(tried[1] - tried[0]).max() > 0.1


def test_ctrl_c_ends_the_trial_of_starts(ur: ToolKinematics, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two further starts were tried, which took longer than a whole search."""
    tried: list[np.ndarray] = []

    def failing(chooser: Chooser, move: eo.Move, goals: object) -> object:
        tried.append(move.start)
        raise Infeasible("no time is left")

    monkeypatch.setattr(Chooser, "choose", failing)
    given = {"start": pose_at(ur, NEAR_GOAL), "goal": GOAL, "duration": 2.5, "starts": 1}
    with pytest.raises(Infeasible, match="no time is left"):
        eo.optimize(ur.robot, "careful", **given, stopped=lambda: bool(tried))
    assert len(tried) == 1


def test_poses_of_a_job_are_turned_towards_its_joint_positions(tmp_path: Path, ur: ToolKinematics) -> None:
    """They stood near zero: a joint went to and fro by nearly a turn in every cycle."""
    path, at = tmp_path / "job.toml", pose_at(ur, NEAR_GOAL).matrix
    pose = [*at[:3, 3], *Rotation.from_matrix(at[:3, :3]).as_euler("xyz")]
    head = 'format = "energy-opt/job/1"\nrobot = "ur5e"\ncycle_time = 6.0\n'
    path.write_text(f"{head}[[step]]\nto = {GOAL.tolist()}\n[[step]]\npose = {[float(x) for x in pose]}\n")
    job = load_job(path, lambda name: ur.robot)
    posed = Posed(job, source_model(ur.robot), Settings(), CellRequest())
    for ends in (posed.choices()[0], posed.greedy()):
        assert np.abs(ends[1] - GOAL)[5] < np.pi


def test_a_cycle_of_the_nearest_positions_is_not_solved_twice(tmp_path: Path) -> None:
    """The comparison with the nearest positions solved the same cycle once more."""
    home, tool = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0], ToolKinematics(load_robot("ur5e"))
    pose = pose_at(tool, np.array([0.5, -1.4, 1.5, -1.6, -1.5, 0.3])).matrix
    place = [*pose[:3, 3].tolist(), *Rotation.from_matrix(pose[:3, :3]).as_euler("xyz").tolist()]
    text = f'format = "energy-opt/job/1"\nrobot = "ur5e"\ncycle_time = 4.0\nmode = "retime"\nhome = {home}\n'
    (tmp_path / "job.toml").write_text(text + f'[[step]]\npose = {place}\n[[step]]\nto = "home"\n')
    found = eo.job(tmp_path / "job.toml", model="source-method-2", self_collision=False).document()
    assert found["choice"]["greedy_nearest"] == found["choice"]["energy_total"]
    assert found["choice"]["solves"] == 1


ONE = """<robot name="one"><link name="base"/><link name="arm">
  <inertial><origin xyz="0.3 0 0"/><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
  </inertial><collision><origin xyz="0.3 0 0"/><geometry><box size="0.6 0.05 0.05"/></geometry></collision></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit velocity="2" effort="50"/></joint></robot>"""


@pytest.mark.slow
def test_a_pose_behind_a_body_is_reached_the_other_way_round(tmp_path: Path) -> None:
    """The long way was estimated to cost more than the short one with a detour, so it was never tried."""
    (tmp_path / "one.urdf").write_text(ONE)
    scene = tmp_path / "scene.yaml"
    scene.write_text("objects: [{name: post, type: box, size: [0.1, 0.1, 0.3], position: [0.27, 0.31, 0.0]}]")
    found = eo.optimize(
        tmp_path / "one.urdf", "source-method-2", start=[0.0], goal_pose=[0, 0, 0, 0, 0, 1.745], scene=scene,
        planner="none", starts=1,
    )  # fmt: skip
    assert found.status == "solved"
    assert found.trajectory.position[-1] == pytest.approx([1.745 - 2 * np.pi])
