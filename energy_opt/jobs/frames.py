"""The poses of a job's steps in the frame of the robot's base."""

from __future__ import annotations

from dataclasses import replace

from energy_opt.cell.load import scene_of
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.jobs.legs import Job, Step
from energy_opt.poses.given import in_base
from energy_opt.poses.pose import Pose
from energy_opt.robot import Robot


def pose_in_base(step: Step, robot: Robot, cell: CellRequest) -> Pose:
    """The pose of a step in the frame of the robot's base.

    Args:
        step: one with a pose. cell: as requested; the step's own scene replaces its scene.

    Raises:
        BadInput: the pose names an unknown frame, or one that moves with the arm.
    """
    assert step.pose is not None
    scene = scene_of(replace(cell, scene=step.scene or cell.scene)) if step.pose.frame else None
    return in_base(step.pose, robot, scene, cell.base_pose)


def wrong_frames(job: Job, cell: CellRequest) -> list[str]:
    """Faults of the frames that poses of a job name, one line each."""
    faults: dict[str, None] = {}
    for k in job.open:
        try:
            pose_in_base(job.steps[k], job.robot, cell)
        except BadInput as error:
            faults[str(error)] = None
    return list(faults)
