"""The verb `place`: the pose of the base, or of a fixture, at which a job takes the least energy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from energy_opt.folders import written_whole
from energy_opt.front.desk import Answered, Desk, verb
from energy_opt.front.given import cell_of
from energy_opt.front.jobs import prepared
from energy_opt.front.moves import settings_of
from energy_opt.jobs.file import Job
from energy_opt.jobs.models import efforts_held, mean_of, warned
from energy_opt.jobs.solve_job import JobResult, run_job
from energy_opt.jobs.work import Worker
from energy_opt.motion import Settings
from energy_opt.motion.plan.planner import Shares
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.placement import Placement
from energy_opt.placement import PlaceRequest as Box
from energy_opt.placement import place as placed
from energy_opt.placement.placement import headline, write
from energy_opt.poses.pose import TURNS, Freedom
from energy_opt.requests.moves import JobRequest, PlaceRequest
from energy_opt.results import exit_of

ENDS = ("to", "pose", "free", "pose_tolerance")  # keys of a step that say where it ends


@dataclass(frozen=True, repr=False, kw_only=True, eq=False)
class PlaceAnswer(Answered):
    """A placement: `placement.place`, the pose [m, rad], and `placement.result`, the job solved there; by name, as
    `["energy_total"]` [J], the values of place.json.

    Attributes:
        placement: the base pose, and the job solved there.
        job: the request that gives this job.
        saved: place.json as it was written.
    """

    placement: Placement
    request: PlaceRequest
    job: PlaceRequest | JobRequest
    saved: Mapping[str, Any] | None = None
    answer = "place.json"

    @property
    def exit_code(self) -> int:
        """Exit code of the command line."""
        return exit_of(self.placement.interrupted, self.placement.solved)

    def document(self) -> dict[str, Any]:
        """Content of place.json without its files."""
        return {**self.placement.document(), "request": self.asked}

    def text(self, out: Path) -> str:
        """A line for a terminal, of a placement that was saved into `out`."""
        return f"{headline(self.saved or self.document())}\nfiles in {out}"

    def kept(self, out: Path) -> PlaceAnswer:
        """Write place.json, map.png, report.html and the job solved at the answer into the folder `out`."""
        with written_whole(out, self.answer) as aside:
            job = {**self.job.document(), **self.stamp, "command": None}
            saved = write(self.placement, self.asked, self.asked if self.job is self.request else job, aside)
        return replace(self, saved=saved)

    def __repr__(self) -> str:
        robot, at = self.placement.result.job.robot.name, ", ".join(f"{x:.4g}" for x in self.placement.place)
        return f"PlaceAnswer({robot!r}, {self.placement.what} at [{at}], {self.placement.result.energy:.5g} J)"


def run(request: PlaceRequest, desk: Desk) -> PlaceAnswer:
    """The pose of the base, or of a fixture, in a box that makes a job cheapest.

    Raises:
        BadInput: a fault of the job or of the box. Infeasible: the job cannot be done from anywhere in the box.
    """
    given = request.base_box
    words = given if isinstance(given, str) else ",".join(map(str, given if hasattr(given, "__iter__") else [given]))
    counts = {name: getattr(request, name) for name in ("looked_at", "seeds", "steps", "fixture")}
    box, around = Box.of(words, **counts), cell_of(request)
    job, rivals, kind, asked = prepared(request, desk)
    document = desk.take(PlaceAnswer.answer, asked)
    with desk.working() as (stopped, show):
        with desk.stating(PlaceAnswer.answer, robot=job.robot.name, request=document):
            found = placed(
                job, mean_of(rivals), box, settings=settings_of(request), cell=around, stopped=stopped, progress=show
            )
        if kind is not None:
            found = _held(found, rivals, settings_of(request), stopped)
        answer = desk.keep(
            PlaceAnswer(placement=found, request=asked, job=_job_at(found, job, asked), stamp=desk.stamp)
        )
    desk.report(warnings=() if answer.saved is None else answer.saved["warnings"])
    return answer


place = verb(PlaceRequest, run)


def _job_at(found: Placement, job: Job, asked: PlaceRequest) -> PlaceRequest | JobRequest:
    """The request of the job at a placement: poses in the frame of the base stay where they are in the scene.

    Args:
        found: the placement. job: as asked for. asked: the request with the job file's content.

    Returns:
        The request itself where an object of the scene was placed: a job has no option for this.
    """
    if found.fixture is not None or not isinstance(asked.job, Mapping):
        return asked
    steps, choice = [dict(step) for step in asked.job["step"]], found.result.choice
    for k, pose in ({} if choice is None else choice.poses).items():
        given = job.steps[k].pose
        if given is not None and not given.frame:
            place = [*pose.matrix[:3, 3].tolist(), *Rotation.from_matrix(pose.matrix[:3, :3]).as_quat().tolist()]
            distance, angle = pose.tolerance
            ends = {"pose": place, "free": list(map(_words, pose.free)), "pose_tolerance": f"{distance}m,{angle}rad"}
            steps[k] = {"name": job.steps[k].name} | {key: x for key, x in steps[k].items() if key not in ENDS} | ends
    common = {f.name for f in fields(JobRequest)} & {f.name for f in fields(asked)} - {"job", "base"}
    shared = {name: getattr(asked, name) for name in common}
    return JobRequest({**asked.job, "step": steps}, base=found.place, **shared)


def _words(free: Freedom) -> str:
    """A free direction as `Freedom.of` reads it."""
    if not np.isfinite([free.low, free.high]).any():
        return free.axis
    low, high = (np.degrees(end) if free.axis in TURNS else 1e3 * end for end in (free.low, free.high))
    return f"{free.axis}:{float(low)!r}:{float(high)!r}"


def _held(found: Placement, rivals: Sequence[Rival], settings: Settings, stopped: Callable[[], bool]) -> Placement:
    """The placement with a job that holds the torque limits under each of the models, or with a warning."""
    first, mean = found.result, mean_of(rivals)

    def again(shares: Shares) -> JobResult:
        worker = Worker(first.job, mean, settings, first.cells, stopped, shares)
        return replace(run_job(first.job, mean, settings, worker=worker, stopped=stopped), choice=first.choice)

    result = efforts_held(first, rivals, again)
    said = warned(result, rivals).warnings[len(result.warnings) :]
    return replace(found, result=result, warnings=(*found.warnings, *said), interrupted=stopped())
