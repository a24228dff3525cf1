"""Poses of the tool for tests: from positions, and judged by a model that Pinocchio reads from the URDF itself."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.pose import Pose

JOB = """
format = "energy-opt/job/1"
robot = "ur5e"
cycle_time = 6.0
home = [0, -1.57, 1.57, -1.57, -1.57, 0]
[poses]
part = { pose = [0.45, 0.2, 0.1, 3.14159265, 0, 0], free = ["rz:-30:30"] }
[[step]]
to = "part"
[[step]]
name = "place"
pose = "world: -0.2, 0.5, 0.2, 3.14159265, 0, 0"
pose_tolerance = "1mm,1deg"
[[step]]
to = "home"
"""


def pose_at(tool: ToolKinematics, q: np.ndarray, **more: object) -> Pose:
    rotation, origin = tool(q[None])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation[0], origin[0]
    return Pose(matrix, **more)


def by_pinocchio(robot: object, q: np.ndarray) -> np.ndarray:
    """The last joint's frame (4, 4), from a model that Pinocchio reads from the URDF itself."""
    model = pin.buildModelFromUrdf(str(robot.urdf))
    full = pin.neutral(model)
    for name, value in zip(robot.joints, q, strict=True):
        full[model.joints[model.getJointId(name)].idx_q] = value
    data = model.createData()
    pin.forwardKinematics(model, data, full)
    return data.oMi[model.getJointId(robot.joints[-1])].homogeneous
