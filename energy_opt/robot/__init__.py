"""Robots: from a name or a URDF file to joints, limits and a rigid body."""

from energy_opt.robot.catalog import known_robots, robot_named
from energy_opt.robot.kinematics import Link, PointMass
from energy_opt.robot.limits import Limits
from energy_opt.robot.rigid_body import RigidBody
from energy_opt.robot.robot import Robot, load_robot
from energy_opt.robot.tool import Tool, tool_of

__all__ = ["Limits", "Link", "PointMass", "RigidBody", "Robot", "Tool", "known_robots", "load_robot", "robot_named",
           "tool_of"]  # fmt: skip
