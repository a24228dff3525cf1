"""Goals as poses of the tool: their freedom, all joint positions that reach them, and the cheapest one."""

from energy_opt.poses.pose import AnyOf, Freedom, Pose, pose_from

__all__ = ["AnyOf", "Freedom", "Pose", "pose_from"]
