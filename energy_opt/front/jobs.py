"""The job that a request names, and `tradeoff` for it: its energy over its cycle time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from energy_opt.errors import BadInput
from energy_opt.files import plain, read_toml
from energy_opt.front.desk import Desk
from energy_opt.front.given import cell_of, named_robot, payload_document, robot_of
from energy_opt.front.moves import documents, settings_of
from energy_opt.front.rivals import rivals_of
from energy_opt.jobs.file import job_of
from energy_opt.jobs.legs import Job, Load
from energy_opt.jobs.models import mean_of, stated
from energy_opt.jobs.over_time import document, over_time
from energy_opt.jobs.work import Answers
from energy_opt.motion import Settings
from energy_opt.motion.plan.rivals import Rival
from energy_opt.motion.plan.robust import Kind
from energy_opt.poses.given import poses_of_request
from energy_opt.power.assumptions import assumptions, assumptions_line
from energy_opt.power.per_year import per_year_words
from energy_opt.requests.moves import JobRequest, PlaceRequest, TradeoffRequest
from energy_opt.results import Found
from energy_opt.robot import Robot

Asked = TypeVar("Asked", JobRequest, TradeoffRequest, PlaceRequest)


def content_of(request: JobRequest | TradeoffRequest | PlaceRequest) -> tuple[dict[str, Any], Path]:
    """A job's document, and the file whose folder contains its other files."""
    if isinstance(request.job, Mapping):
        return dict(request.job), Path(request.folder or ".") / "job.toml"
    path = Path(str(request.job))
    return read_toml(path, "job"), path


def job_from(
    request: JobRequest | TradeoffRequest | PlaceRequest, payload: Load | None = None, robot: Robot | None = None
) -> Job:
    """The job, for the robot that the request names, or else its own.

    Args:
        payload: until a step states another one, in place of the job's. robot: if loaded already.
    """
    document, path = content_of(request)
    return job_of(
        document, path, lambda name: robot or robot_of(request, name), allow_outside=request.allow_outside,
        named=poses_of_request(cell_of(request)),
        payload=payload,
    )  # fmt: skip


def resolved_job(request: Asked, robot: Robot, rivals: list[Rival], kind: Kind | None, **known: Any) -> Asked:
    """The request with everything resolved: it contains the job file's content, and documents of the models.

    Args:
        request: as asked. robot: the job's. rivals: the models. kind: how several are combined. known: further fields.
    """
    document, path = content_of(request)
    if not isinstance(request, PlaceRequest):
        known["payload"] = payload_document(request.payload)
    return replace(
        request, job=document, folder=str(path.parent.resolve()), robot=named_robot(robot, request.robot),
        model=documents(rivals), robust=kind, **known,
    )  # fmt: skip


def job_settings(request: JobRequest | PlaceRequest) -> Settings:
    """Solver settings for the moves of a job."""
    given = {name: getattr(request, name, None) for name in ("seed", "compile", "starts", "deadline")}
    return Settings(**{name: value for name, value in given.items() if value is not None})


ANSWER = "tradeoff.json"
OF_A_MOVE = (
    "start", "goal", "start_pose", "goal_pose", "path", "duration", "max_duration", "cycle", "idle_power", "payload",
)  # fmt: skip
EXITS = {"solved": 0, "infeasible": 3, "not_converged": 4, "interrupted": 130}


@dataclass(frozen=True, repr=False)
class JobFront(Found):
    """Energy of a job over its cycle time.

    Attributes:
        document: tradeoff.json. request: what was asked.
    """

    document: Mapping[str, Any]
    request: TradeoffRequest

    @property
    def exit_code(self) -> int:
        """Exit code of the command line."""
        return EXITS[self.document["status"]]

    def text(self, out: Path) -> str:
        """A short table for a terminal, of a front that was saved into `out`."""
        found = self.document
        lines = [f"{'cycle [s]':>10} {'energy [J]':>14} {'evenly slowed':>14} {'fastest, wait':>14}  status"]
        for row in found["points"]:
            joules = (row["energy_total"], row.get("evenly_slowed"), row.get("fastest_then_wait"))
            cells = [f"{'-' if value is None else format(value, '.2f'):>14}" for value in joules]
            lines.append(f"{row['duration']:>10.3f} {' '.join(cells)}  {row['status']}")
        lines.append(f"shortest cycle: {found['fastest']:.4g} s")
        if found["knee"] is not None:
            knee = found["knee"]
            lines.append(f"knee: {knee['duration']:.4g} s, {knee['energy_total']:.5g} J")
        if "per_year" in found:
            lines.append(per_year_words(found["per_year"], self.request.cycles_per_year or 0.0))
        return "\n".join([*lines, f"files in {out}"])

    def kept(self, out: Path) -> JobFront:
        """Write tradeoff.csv, tradeoff.json and report.html into the folder `out`."""
        from energy_opt.jobs.over_time import write

        write(out, self.document)
        return self

    def __repr__(self) -> str:
        return f"JobFront({self.document['status']!r}, {len(self.document['points'])} cycle times)"


def run_job(request: TradeoffRequest, times: list[float] | None, desk: Desk) -> JobFront:
    """Energy of a job over its cycle time.

    Args:
        request: names the job. times: cycle times [s]; None: the program chooses. desk: see `desk.Desk`.

    Raises:
        BadInput: an option that belongs to one move, or a fault of the job.
    """
    given = next((name for name in OF_A_MOVE if getattr(request, name) is not None), None)
    if request.mode != TradeoffRequest.mode:
        given = "mode"
    if given is not None or request.via or request.via_pose or request.free:
        file = "the job" if isinstance(request.job, Mapping) else request.job
        raise BadInput(f"--{(given or 'via').replace('_', '-')} belongs to one move; {file} states its own moves")
    worth = request.worth
    job = job_from(request)
    (rivals, kind), settings, cell = rivals_of(request, job.robot, desk), settings_of(request), cell_of(request)
    asked = resolved_job(request, job.robot, rivals, kind, durations=times)
    stamped = desk.take(ANSWER, asked)
    about = [*(rival.model.to_document() for rival in rivals), job.robot.name, vars(job.robot.limits), vars(settings)]
    answers = Answers(desk.out, job.robot.joints, [*about, cell.document()], request.resume) if desk.out else None
    known: dict[str, Any] = {} if answers is None else {"known": answers.known, "answered": answers.keep}
    with desk.working() as (stopped, show):
        points, shortest = over_time(
            job, mean_of(rivals), settings, cell=cell, times=times, stopped=stopped, progress=show,
            **known, restated=lambda result: result if kind is None else stated(result, rivals),
        )  # fmt: skip
        records = assumptions(job.robot, [rival.model for rival in rivals])
        used = {"assumptions": [asdict(row) for row in records]}
        found = {**document(job, points, shortest, stopped()), **used, "request": plain(stamped)}
        if worth is not None:
            bend = found["knee"] or found["minimum"] or {}
            row: dict[str, Any] = next((row for row in found["points"] if row["duration"] == bend.get("duration")), {})
            slowed = row.get("evenly_slowed")
            found["per_year"] = worth.of(None if slowed is None else slowed - row["energy_total"])
        front = desk.keep(JobFront(found, asked))
        if answers is not None and not stopped():
            answers.forget()
    desk.report((), assumptions_line(records))
    if found["status"] == "infeasible":
        desk.say(f"none of these cycle times is possible; the shortest possible one is {shortest:.6g} s")
    return front
