"""The request of a placement: the box for the base, the effort of the search, and what of a job and scene it moves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from energy_opt.cell.load import scene_of
from energy_opt.cell.request import FAR, CellRequest
from energy_opt.errors import BadInput
from energy_opt.jobs.file import Job
from energy_opt.poses.given import WORLD

AXES = ("x", "y", "z", "yaw")
FORM = "X0,X1,Y0,Y1,Z0,Z1 [m], then nothing, `yaw` or YAW0,YAW1 [rad]"


@dataclass(frozen=True)
class PlaceRequest:
    """The box of a search for the base's pose.

    Attributes:
        box: lowest and highest x, y and z of the base in the scene's frame [m].
        yaw: lowest and highest yaw [rad]; None for the given yaw.
        fixture: the object of the scene to place in the box instead of the base; None for the base.
        looked_at: number of placements at which the job is estimated.
        seeds: number of best estimates at which the job is solved.
        steps: most placements at which it is solved roughly after these.
    """

    box: tuple[float, float, float, float, float, float]
    yaw: tuple[float, float] | None = None
    looked_at: int = 120
    seeds: int = 3
    steps: int = 5
    fixture: str | None = None

    def __post_init__(self) -> None:
        if len(self.box) != 6 or not np.isfinite(self.box).all() or np.abs(self.box).max() > FAR:
            raise BadInput(f"--base-box: expected {FORM}")
        pairs = [self.box[0:2], self.box[2:4], self.box[4:6], self.yaw or (0.0, 0.0)]
        for axis, (low, high) in zip(AXES, pairs, strict=True):
            if not low <= high:
                raise BadInput(f"--base-box: {axis} begins at {low:g} and ends at {high:g}; expected the smaller first")
        if np.abs(pairs[3]).max() > 4 * np.pi:
            raise BadInput(f"--base-box: yaw {pairs[3][0]:g}, {pairs[3][1]:g}: expected rad")
        for name in ("looked_at", "seeds", "steps"):
            if not 0 <= getattr(self, name) <= 10_000:
                raise BadInput(f"--{name.replace('_', '-')} {getattr(self, name)}: expected 0 to 10000")

    @classmethod
    def of(cls, words: str, **more: Any) -> PlaceRequest:
        """From X0,X1,Y0,Y1,Z0,Z1 [m], and `yaw` (all round) or YAW0,YAW1 [rad]; `more` are further fields.

        Raises:
            BadInput: another form, a range whose end is below its beginning, or a value that no search has.
        """
        parts = [part.strip() for part in words.split(",")]
        turning = len(parts) == 7 and parts[6].lower() == "yaw"
        try:
            numbers = [float(part) for part in parts[: 6 if turning else None]]
        except ValueError:
            numbers = []
        if len(numbers) not in (6, 8):
            raise BadInput(f"--base-box {words}: expected {FORM}")
        yaw = (-np.pi, np.pi) if turning else (numbers[6], numbers[7]) if len(numbers) == 8 else None
        x0, x1, y0, y1, z0, z1 = numbers[:6]
        return cls((x0, x1, y0, y1, z0, z1), yaw, **more)

    def bounds(self, given: tuple[float, ...]) -> np.ndarray:
        """Lowest and highest x, y, z [m] and yaw [rad], (4, 2); by default the given yaw (x, y, z, roll, pitch,
        yaw).
        """
        yaw = self.yaw or (given[5], given[5])
        return np.array([self.box[0:2], self.box[2:4], self.box[4:6], yaw])


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
