"""Errors of positions from poses, recomputed with Pinocchio: the judge of the chosen and written positions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from energy_opt.poses.pose import Pose, missed
from energy_opt.robot import Robot
from energy_opt.robot.tool import tool_of


def pose_document(
    robot: Robot, tool_words: str | None, poses: Mapping[str, Pose], positions: Mapping[str, np.ndarray]
) -> dict[str, Any]:
    """Errors of positions (n,) from their poses, recomputed with Pinocchio: distance [m] and angle [rad]."""
    tool = tool_of(robot.body, tool_words)
    out: dict[str, Any] = {}
    for end, pose in poses.items():
        q = positions[end][None]
        still = np.zeros_like(q)
        at, _, _ = robot.body.frame_motion(tool.joint, np.array(tool.pose), q, still, still)
        off = missed(pose, at[:, :3, :3], at[:, :3, 3])
        distance, angle = float(np.linalg.norm(off.shift)), float(np.linalg.norm(off.turn))
        inside = distance <= pose.tolerance[0] and angle <= pose.tolerance[1]
        out[end] = {"distance": distance, "angle": angle, "valid": inside}
    return out
