"""What a placement moves, in the scene's frame: the poses of a job, and the frame of a fixture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from energy_opt.cell.load import scene_of
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.jobs.file import Job
from energy_opt.poses.given import WORLD


def in_scene(job: Job, cell: CellRequest) -> Job:
    """The job with its poses fixed in the scene, as seen from the given base."""
    steps = list(job.steps)
    for k in job.open:
        pose = steps[k].pose
        assert pose is not None
        if not pose.frame:
            steps[k] = replace(steps[k], pose=replace(pose, matrix=cell.base_pose @ pose.matrix, frame=WORLD[0]))
    return replace(job, steps=tuple(steps))


def fixture_pose(job: Job, cell: CellRequest, fixture: str) -> tuple[float, ...]:
    """The placement of a fixture: x, y, z [m], roll, pitch, yaw [rad] (6,) of its frame in the scene's.

    Args:
        job: its steps name the fixture. cell: with the scene, unless the job has its own. fixture: the object's name.

    Raises:
        BadInput: no step ends at a pose in that frame, or there is no scene with such an object.
    """
    steps = [step for step in job.steps if step.pose is not None and step.pose.frame == fixture]
    if not steps:
        raise BadInput(f"{job.name}: no step ends at a pose in the frame of {fixture!r}, so its place changes nothing; "
                       f'give `pose = "{fixture}: X,Y,Z,R,P,Y"`')  # fmt: skip
    scene = scene_of(replace(cell, scene=steps[0].scene or cell.scene))
    if scene is None:
        raise BadInput(f"{job.name}: no scene has the object {fixture!r}; give --scene")
    known = {thing.name: thing for thing in scene.objects}
    if fixture not in known:
        scene.with_object_at(fixture, np.eye(4))
    at = known[fixture].place
    return *map(float, at[:3, 3]), *map(float, Rotation.from_matrix(at[:3, :3]).as_euler("xyz"))
