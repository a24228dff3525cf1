"""A first path on which the tool keeps its pose: the usual one, brought there point by point by inverse kinematics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.motion.limits.base import Limit, box_of
from energy_opt.motion.limits.keep import Keep
from energy_opt.motion.path import JointPath, through
from energy_opt.motion.path_dynamics import PathDynamics, points_of
from energy_opt.power import PowerModel
from energy_opt.robot import Robot, Tool
from energy_opt.robot.kinematics import Kinematics

POINTS = 61  # of the path that are brought there, both ends included: between them it is a cubic spline
STEPS = 40  # of each of them
FARTHEST = 0.2  # [rad] that a joint goes in a step
DAMPING = 1e-4  # of the least squares, beside squared Jacobians [m, rad] of order one
CHECKS = 401  # places at which the path is looked at


def holds(robot: Robot, model: PowerModel, limits: Sequence[Limit], path: JointPath) -> bool:
    """Does the tool keep along a path what it should keep?"""
    d = PathDynamics(robot, model, path, points_of(path, CHECKS))
    found = [limit.fixed(d) for limit in limits if isinstance(limit, Keep)]
    return all(fixed.excess.max() <= 0 for fixed in found)


def posed(robot: Robot, model: PowerModel, limits: Sequence[Limit], path: JointPath) -> JointPath | None:
    """The path between the same ends whose inner points are moved least to where the tool keeps its pose.

    Damped least squares on what is off. None where that does not lead to a path on which it does.
    """
    kept = [limit for limit in limits if isinstance(limit, Keep)]
    lower, upper = box_of(limits, robot.n)
    kinematics, share = Kinematics(robot.body.tree()), np.linspace(0, 1, POINTS)
    q = path(share)
    inner = slice(1, -1)
    for _ in range(STEPS):
        poses, jacobian = _moved(kinematics, kept[0].tool, q[inner])
        parts = [limit.correction(poses, share[inner]) for limit in kept]
        off = np.concatenate([x for x, _ in parts], axis=1)[:, :, None]
        slope = np.concatenate([of @ jacobian for _, of in parts], axis=1)
        square = slope.transpose(0, 2, 1) @ slope + DAMPING * np.eye(robot.n)
        step = np.linalg.solve(square, slope.transpose(0, 2, 1) @ off)[:, :, 0]
        step *= np.minimum(1, FARTHEST / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
        q[inner] = np.clip(q[inner] + step, lower, upper)
    found = through(q)
    return found if holds(robot, model, limits, found) else None


def _moved(kinematics: Kinematics, tool: Tool, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A tool's poses (M, 4, 4) at q (M, n), and the Jacobian (M, 6, n) of its origin and rotation, base frame."""
    at, pose = kinematics(q), np.array(tool.pose)
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    poses[:, :3, :3] = at.rotation[:, tool.joint] @ pose[:3, :3]
    poses[:, :3, 3] = at.origin[:, tool.joint] + at.rotation[:, tool.joint] @ pose[:3, 3]
    turns = np.where(kinematics.prismatic, 0.0, 1.0)[:, None]
    lever = np.cross(at.axis, poses[:, None, :3, 3] - at.origin[:, :-1])
    linear = np.where(turns > 0, lever, at.axis)
    moves = kinematics.moves[tool.joint][:, None]
    jacobian = kinematics.coupling.joined(np.concatenate([linear * moves, at.axis * turns * moves], axis=2), axis=1)
    return poses, jacobian.transpose(0, 2, 1)
