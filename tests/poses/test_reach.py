"""Joint positions that reach a pose: all branches, what is free, and what is said where none does."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares
from tool_poses import by_pinocchio, pose_at

from energy_opt.poses.inverse import ToolKinematics, jacobian_of, reach, solve
from energy_opt.poses.pose import Freedom, Pose, pose_error, pose_from
from energy_opt.poses.sets import unreachable_error
from energy_opt.robot import load_robot


def ur_branches(tool: ToolKinematics, pose: Pose) -> int:
    """How many branches there are, by exhaustion: a grid of starts over all joints, each brought to the pose."""
    found: list[np.ndarray] = []
    for start in product((-2.5, -0.8, 0.8, 2.5), (-2.2, -0.7), (-1.5, 1.5), (-1.0, 1.0), (-1.5, 1.5), (0.5,)):
        result = least_squares(lambda q: tool.pose_error(pose, q[None])[0], np.array(start), xtol=1e-14)
        if np.abs(result.fun).max() < 1e-8:
            q = (result.x + np.pi) % (2 * np.pi) - np.pi
            if all(np.abs((q - other + np.pi) % (2 * np.pi) - np.pi).max() > 1e-3 for other in found):
                found.append(q)
    return len(found)


def test_all_branches_of_a_ur_are_found(ur: ToolKinematics) -> None:
    q = np.array([0.4, -1.2, 1.4, -1.1, -1.3, 0.3])
    pose = pose_at(ur, q)
    found = reach(ur, pose, near=q).positions
    for row in found:
        assert np.abs(by_pinocchio(ur.robot, row) - by_pinocchio(ur.robot, q)).max() < 1e-7
    wrapped = {tuple(np.round((row + np.pi) % (2 * np.pi) - np.pi, 3)) for row in found}
    assert len(wrapped) == 8 == ur_branches(ur, pose)
    assert np.abs(found - q).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("free", [("rz",), ("rx:-20:20", "rz"), ("x:-50:50", "ry")])
def test_upright_and_opposite_poses_are_reached(free: tuple[str, ...]) -> None:
    """Starts at joint limits, which are multiples of pi, point the tool exactly opposite to what is wanted."""
    tool = ToolKinematics(load_robot("ur10"))
    pose = pose_from("0.4,0.25,0.25,3.14159265,0,0.78539816", free)
    found = reach(tool, pose, near=np.array([0.2, -1.4, 1.4, -1.5, -1.5, 0.1])).positions
    assert len(found) > 20
    if free == ("rz",):
        for row in found[::10]:
            at = by_pinocchio(tool.robot, row)
            assert np.abs(at[:3, 3] - [0.4, 0.25, 0.25]).max() < 1e-8
            assert np.abs(at[:3, 2] - pose.matrix[:3, 2]).max() < 1e-8


@pytest.mark.parametrize("name", ["panda", "ur5e", "xarm7", "z1"])
def test_no_pose_that_is_reached_is_out_of_reach(name: str) -> None:
    robot = load_robot(name)
    tool = ToolKinematics(robot, f"{robot.joints[-1]},0.1,0,0.2")
    limits = robot.limits
    for q in np.random.default_rng(0).uniform(limits.lower, limits.upper, (200, robot.n)):
        assert not tool.out_of_reach(pose_at(tool, q))
    far = pose_from("2.5,0,0.3,0,0,0", (), "1mm,1deg")
    assert tool.out_of_reach(far) and not tool.out_of_reach(replace(far, free=(Freedom("x"),)))


@pytest.mark.parametrize("name", ["panda", "ur5e", "xarm7", "z1"])
def test_a_pose_that_was_reached_is_found_again(name: str) -> None:
    tool = ToolKinematics(load_robot(name))
    limits = tool.robot.limits
    q = np.random.default_rng(3).uniform(np.maximum(limits.lower, -2), np.minimum(limits.upper, 2))
    found = reach(tool, pose_at(tool, q), starts=200).positions
    assert len(found)
    assert (found >= limits.lower).all() and (found <= limits.upper).all()
    for row in found[:3]:
        assert np.abs(by_pinocchio(tool.robot, row) - by_pinocchio(tool.robot, q)).max() < 1e-7


def test_a_panda_is_found_at_every_angle_of_its_redundancy() -> None:
    """Fixing joint 7 on a fine grid leaves isolated branches: each angle that a grid search reaches is near a find."""
    tool = ToolKinematics(load_robot("panda"))
    limits = tool.robot.limits
    pose = pose_at(tool, np.array([0.3, 0.2, -0.4, -1.8, 0.3, 2.0, 0.5]))
    found = reach(tool, pose, near=limits.near_zero).positions[:, 6]
    rng = np.random.default_rng(2)
    for angle in np.linspace(limits.lower[6] + 0.05, limits.upper[6] - 0.05, 24):
        starts = rng.uniform(limits.lower, limits.upper, (40, 7))
        starts[:, 6] = angle
        q, error = solve(tool, pose, starts)
        held = q[(error < 1e-9) & (np.abs(q[:, 6] - angle) < 0.05)]
        if len(held):
            assert np.abs(found - held[0, 6]).min() < 0.35


@pytest.mark.parametrize(("name", "joint", "by"), [("panda", 4, 0.25), ("z1", 3, 0.25)])
def test_a_pose_beyond_only_a_limit_names_the_joint(name: str, joint: int, by: float) -> None:
    """Judged by what the message says: at that value of that joint, others within their limits, the pose is reached."""
    tool = ToolKinematics(load_robot(name))
    limits = tool.robot.limits
    rng = np.random.default_rng(0)
    for _ in range(100):
        q = rng.uniform(np.maximum(limits.lower, -3), np.minimum(limits.upper, 3))
        q[joint] = limits.upper[joint] + by
        pose = pose_at(tool, q)
        found = reach(tool, pose, starts=80)
        if not len(found.positions):
            break
    error = unreachable_error(tool, pose, found)
    assert error.joint in tool.robot.joints and error.limit == "position"
    value = float(str(error).rpartition("would have to be at ")[2].split()[0])
    k = tool.robot.joints.index(error.joint)
    assert not limits.lower[k] <= value <= limits.upper[k]
    wide = replace(limits, lower=limits.lower - 1.5, upper=limits.upper + 1.5)
    there = reach(ToolKinematics(replace(tool.robot, limits=wide)), pose).positions
    assert np.abs(there[:, k] - value).min() < 0.05


@pytest.mark.parametrize(("name", "words"), [("xarm7", "0.9,0,0.9,0,0,0"), ("ur3e", "0.6,0.3,0.5,1,2,0")])
def test_the_stated_nearest_pose_is_the_nearest(name: str, words: str) -> None:
    """No start of SciPy's bounded least squares comes nearer, with 0.3 m as much as a radian."""
    tool, pose = ToolKinematics(load_robot(name)), pose_from(words)
    limits, said = tool.robot.limits, reach(tool, pose)
    low, high = np.maximum(limits.lower, -7.0), np.minimum(limits.upper, 7.0)

    def missed_by(q: np.ndarray) -> np.ndarray:
        return tool.pose_error(pose, q[None])[0] / [0.3, 0.3, 0.3, 1, 1, 1]

    starts = np.random.default_rng(8).uniform(low, high, (12, len(low)))
    least = min(2 * least_squares(missed_by, q, bounds=(low, high), max_nfev=60).cost for q in starts)
    assert (said.distance / 0.3) ** 2 + said.angle**2 < 1.01 * least


@pytest.mark.parametrize(("name", "words"), [("panda", "2,0,0.5,3.14,0,0"), ("z1", "0.1,1,0.1,0,1.5707963,0")])
def test_the_nearest_pose_is_stated(name: str, words: str) -> None:
    """Only its distance was."""
    tool, pose = ToolKinematics(load_robot(name)), pose_from(words)
    found = reach(tool, pose)
    error = unreachable_error(tool, pose, found)
    said = pose_from(str(error).partition("deg away: ")[2].partition(" in the base frame")[0])
    assert np.linalg.norm(said.matrix[:3, 3] - pose.matrix[:3, 3]) == pytest.approx(found.distance, abs=1e-6)
    for stated, error_ in ((said, 2e-7), (pose_from(error.document()["nearest_pose"]), 1e-9)):
        assert np.abs(stated.matrix - by_pinocchio(tool.robot, found.nearest)).max() < error_


@pytest.mark.parametrize(("shift", "turn"), [(0.0, 0.3), (0.04, 0.0), (0.01, 0.2)])
def test_the_nearest_pose_is_within_the_tolerance_if_any_is(shift: float, turn: float) -> None:
    """With 0.3 m as much as a radian, the nearest one missed a small tolerance of one kind for less of the other."""
    tool = ToolKinematics(load_robot("ur5e", lock={"wrist_2_joint": -1.5}))
    pose = pose_at(tool, np.array([0.8, -1.2, 1.3, -1.4, 0.4]), tolerance=(1.02 * shift + 1e-4, 1.02 * turn + 1e-4))
    pose.matrix[:3, 3] += shift * pose.matrix[:3, 1]
    pose.matrix[:3, :3] = pose.matrix[:3, :3] @ pin.exp3(turn * np.array([0.6, 0.8, 0.0]))
    found = reach(tool, pose)
    assert not len(found.positions) and found.distance <= pose.tolerance[0] and found.angle <= pose.tolerance[1]


def test_freedom_counts_within_its_range_and_not_beyond() -> None:
    turn = pin.exp3(np.array([0.0, 0.0, 0.5]))
    shifted, origin = turn[None], np.array([[0.0, 0.002, 0.0]])
    free = Pose(np.eye(4), (Freedom.of("rz"), Freedom.of("y:-5:5")))
    assert np.abs(pose_error(free, shifted, origin)).max() < 1e-12
    narrow = Pose(np.eye(4), (Freedom.of("rz:-10:10"), Freedom.of("y:-1:1")))
    off = pose_error(narrow, shifted, origin)[0]
    assert off[1] == pytest.approx(0.001)
    assert off[5] == pytest.approx(0.5 - np.radians(10))
    two = Pose(np.eye(4), (Freedom.of("rx"), Freedom.of("ry")))
    tilted = (pin.exp3(np.array([0.3, 0, 0])) @ pin.exp3(np.array([0, -0.7, 0])))[None]
    assert np.abs(pose_error(two, tilted, np.zeros((1, 3)))).max() < 1e-12
    assert np.abs(pose_error(two, tilted @ turn, np.zeros((1, 3)))).max() == pytest.approx(0.5)


@pytest.mark.parametrize("free", [(), ("rz",), ("ry:-40:60", "x:-100:50")])
def test_the_derivative_of_the_pose_error_equals_differences(ur: ToolKinematics, free: tuple[str, ...]) -> None:
    rng = np.random.default_rng(5)
    pose = pose_at(ur, rng.uniform(-1, 1, 6), free=tuple(map(Freedom.of, free)))
    q = rng.uniform(-1.5, 1.5, (20, 6))
    steps = 1e-6 * np.eye(6)
    apart = [(ur.pose_error(pose, q + d) - ur.pose_error(pose, q - d)) / 2e-6 for d in steps]
    exact = jacobian_of(ur, pose, q, ur.pose_error(pose, q))
    assert np.abs(exact - np.stack(apart, axis=2)).max() < 1e-7


def test_a_range_may_go_past_half_a_turn() -> None:
    pose = Pose(np.eye(4), (Freedom.of("rz:150:210"),))
    turns = np.stack([pin.exp3(np.array([0.0, 0.0, np.radians(angle)])) for angle in (160, -170, -140)])
    off = pose_error(pose, turns, np.zeros((3, 3)))[:, 5]
    assert off == pytest.approx([0.0, 0.0, np.radians(10)], abs=1e-9)
