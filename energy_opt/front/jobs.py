"""The job that a request names, its answer, and `tradeoff` for it: its energy over its cycle time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from energy_opt.errors import BadInput, at_least
from energy_opt.files import plain, read_toml
from energy_opt.folders import written_whole
from energy_opt.formats.controller_files import Written, files_from
from energy_opt.formats.controller_program import load_of
from energy_opt.front.desk import Answered, Desk
from energy_opt.front.given import as_loaded, cell_of, payload_document, robot_of
from energy_opt.front.models import members, rivals_of
from energy_opt.front.moves import documents, settings_of
from energy_opt.jobs import job_files
from energy_opt.jobs.file import job_of
from energy_opt.jobs.legs import Job, Load
from energy_opt.jobs.models import efforts_held, mean_of, stated, warned
from energy_opt.jobs.over_time import document, over_time, page, text
from energy_opt.jobs.solve_job import JobResult
from energy_opt.jobs.work import Answers
from energy_opt.motion import Settings, Trajectory
from energy_opt.motion.plan.planner import Shares
from energy_opt.motion.plan.robust_models import Rival
from energy_opt.motion.plan.robust_weights import Kind
from energy_opt.poses.given import poses_of_request
from energy_opt.power.assumptions import assumptions, assumptions_line
from energy_opt.requests.moves import JobRequest, PlaceRequest, TradeoffRequest
from energy_opt.results import Document, exit_of
from energy_opt.robot import Robot
from energy_opt.tradeoffs.front_files import Tradeoff

WORKCELL = "energy-opt/job/2"
Asked = TypeVar("Asked", JobRequest, TradeoffRequest, PlaceRequest)


def content_of(request: JobRequest | TradeoffRequest | PlaceRequest) -> tuple[dict[str, Any], Path]:
    """A job's document, and the file whose folder contains its other files."""
    if isinstance(request.job, Mapping):
        path = Path(request.folder or ".")  # or the file of a request that holds the job
        return plain(request.job), path if path.is_file() else path / "job"
    path = Path(str(request.job))
    return read_toml(path, "job"), path


def job_from(
    request: JobRequest | TradeoffRequest | PlaceRequest, payload: Load | None = None, robot: Robot | None = None
) -> Job:
    """The job, for the robot that the request names, or else its own.

    Args:
        payload: until a step states another one, in place of the job's. robot: if loaded already.

    Raises:
        BadInput: a fault of the job, or it has several robots.
    """
    document, path = content_of(request)
    if document.get("format") == WORKCELL:
        other = "; use `job` with other values of cycle_time" if request.verb == "tradeoff" else ""
        raise BadInput(f"{path}: a job of several robots ({WORKCELL}); {request.verb} takes jobs of one robot{other}")
    return job_of(
        document, path, lambda name: robot or robot_of(request, name), allow_outside=request.allow_outside,
        named=poses_of_request(cell_of(request)),
        payload=payload,
    )  # fmt: skip


def prepared(request: Asked, desk: Desk, **known: Any) -> tuple[Job, list[Rival], Kind | None, Asked]:
    """The job, the models, how several are combined, and the request with everything resolved.

    The job carries its own payload, else that of the request, or of the models' first. The resolved request contains
    the job file's content, and documents of the models.

    Args:
        request: names the job. desk: takes a warning if the models' payloads differ. known: further fields.
    """
    job, (document, path) = job_from(request), content_of(request)
    rivals, kind = rivals_of(request, job.robot, desk)
    if getattr(request, "payload", None) is not None or "payload" not in document:
        carried = [load_of(model) for model in members(rivals)]
        if len(set(carried)) > 1:
            desk.say(
                "warning: the payloads of the models differ; a job has one at a time: that of the first model is used "
                "for all, unless the job or --payload states it"
            )
        job = job if carried[0] is None else job_from(request, carried[0], job.robot)
    if not isinstance(request, PlaceRequest):
        known["payload"] = payload_document(request.payload)
    asked = replace(
        request, job=document, folder=str(path.parent.resolve()), model=documents(rivals), robust=kind,
        **as_loaded(job.robot, request.robot), **known,
    )  # fmt: skip
    return job, rivals, kind, asked


def answers_of(
    request: JobRequest | TradeoffRequest, job: Job, rivals: list[Rival], settings: Settings, desk: Desk
) -> Answers | None:
    """Answers to the moves that an earlier run into the folder left, for --resume; None without a folder.

    Raises:
        BadInput: an earlier run is to be continued, but there is no folder.
    """
    if desk.out is None:
        if request.resume:
            raise BadInput("--resume needs the folder of the earlier run: --out DIR")
        return None
    about = [*(rival.model.to_document() for rival in rivals), job.robot.name, vars(job.robot.limits), vars(settings)]
    return Answers(desk.out, job.robot.joints, [*about, cell_of(request).document()], request.resume)


@dataclass(frozen=True, repr=False, kw_only=True, eq=False)
class JobAnswer(Answered):
    """A solved cycle of one robot or of several: `result`, and of one robot its `trajectory`; by name, as
    `["energy_total"]` [J], the values of job.json.

    Attributes:
        result: `solve_job.JobResult` of one robot, `solve_cell.CellResult` of several.
        files: tables of the cycles, and programs, made, read back and judged in the call; `save` writes them.
    """

    result: Any
    request: JobRequest
    files: tuple[Written, ...]
    answer = "job.json"

    @classmethod
    def of(cls, result: Any, request: JobRequest, stamp: Mapping[str, Any], formats: Any) -> JobAnswer:
        """The answer with its files, in the formats (of each robot) that `--write` asks for."""
        programs = partial(_output(result).write_programs, result, formats)
        files = files_from(partial(programs, rate=request.rate, prefix=request.joint_prefix))
        return cls(result=result, request=request, stamp=stamp, files=files)

    @property
    def exit_code(self) -> int:
        """Exit code of the command line."""
        return exit_of(self.result.interrupted, self.result.solved and all(row.valid for row in self.files))

    @property
    def trajectory(self) -> Trajectory:
        """The cycle of one robot as one motion.

        Raises:
            BadInput: the job has several robots.
        """
        if not isinstance(self.result, JobResult):
            raise BadInput("a job of several robots: save it, and give cycle_<robot>.csv of one of them")
        return job_files.whole_cycle(self.result)[0]

    def document(self) -> dict[str, Any]:
        """Content of job.json."""
        return self._found

    @cached_property
    def _found(self) -> dict[str, Any]:
        found: dict[str, Any] = _output(self.result).found_of(self.result, self.asked, self.request.worth, self.files)
        return found

    def text(self, out: Path) -> str:
        """A short table for a terminal, of a job that was saved into `out`."""
        return f"{_output(self.result).table(self.document(), self.request.cycles_per_year)}\nfiles in {out}"

    def kept(self, out: Path) -> JobAnswer:
        """Write job.json, the tables of all motions, report.html and the programs asked for into the folder `out`."""
        with written_whole(out, self.answer) as aside:
            _output(self.result).write(self.result, self.asked, aside, self.request.worth, self.files)
        return self

    def __repr__(self) -> str:
        found = self.document()
        robots = repr(found["robot"]) if "robot" in found else f"{len(found['robots'])} robots"
        return f"JobAnswer({robots}, {found['cycle_time']:g} s, {found['energy_total']:.5g} J)"


def _output(result: Any) -> ModuleType:
    """The module that writes a job's result."""
    if isinstance(result, JobResult):
        return job_files
    from energy_opt.workcell import cell_files

    return cell_files


OF_A_MOVE = (
    "start", "goal", "start_pose", "goal_pose", "path", "duration", "max_duration", "cycle", "idle_power", "payload",
)  # fmt: skip


def run_job(request: TradeoffRequest, times: list[float] | None, desk: Desk) -> Tradeoff:
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
    worth, settings, cell = request.worth, settings_of(request), cell_of(request)
    job, rivals, kind, asked = prepared(request, desk, durations=times)
    stamped = desk.take(Tradeoff.answer, asked)
    answers = answers_of(request, job, rivals, settings, desk)

    def restated(result: JobResult, again: Callable[[Shares], JobResult]) -> JobResult:
        if kind is None:
            return result
        return warned(stated(efforts_held(result, rivals, again), rivals), rivals)

    with desk.working() as (stopped, show):
        points, shortest = over_time(
            job, mean_of(rivals), settings, cell=cell, times=times, stopped=stopped, progress=show,
            answers=answers, restated=restated,
        )  # fmt: skip
        records = assumptions(job.robot, [rival.model for rival in rivals])
        used = {"assumptions": [asdict(row) for row in records]}
        found = {**document(job, points, shortest, stopped()), **used, "request": plain(stamped)}
        if worth is not None:
            bend = found["knee"] or found["minimum"] or {}
            row: dict[str, Any] = next((row for row in found["points"] if row["duration"] == bend.get("duration")), {})
            slowed = row.get("evenly_slowed")
            found["per_year"] = worth.of(None if slowed is None else slowed - row["energy_total"])
        front = desk.keep(Tradeoff(Document(found), asked, page, text, job.robot))
        if answers is not None and not stopped():
            answers.forget()
    desk.report((), assumptions_line(records), found["warnings"])
    if found["status"] == "infeasible":
        desk.complain(f"none of these cycle times is possible; the shortest possible one is {at_least(shortest)} s")
    return front
