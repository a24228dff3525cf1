"""The verb `job`: a cycle of moves and waits, of one robot or of several."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

from energy_opt.errors import BadInput
from energy_opt.front.controllers import check_rate_of, check_written
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import cell_of, robot_of, several
from energy_opt.front.jobs import WORKCELL, JobAnswer, answers_of, content_of, prepared
from energy_opt.front.models import rivals_from, said, with_careful
from energy_opt.front.moves import settings_of
from energy_opt.jobs import job_files
from energy_opt.jobs.models import compared, efforts_held, grounded, held, mean_of, stated, warned
from energy_opt.jobs.run_posed import run_posed
from energy_opt.jobs.solve_job import JobResult, run_job
from energy_opt.motion.plan.planner import Shares
from energy_opt.power import PowerModel
from energy_opt.power.assumptions import assumptions_line as assumed
from energy_opt.requests.moves import JobRequest
from energy_opt.robot import Robot

NONE: Shares = MappingProxyType({})
OF_ONE_ROBOT = ("robot", "payload", "base")  # options of one robot, which are refused in a job of several


def run(request: JobRequest, desk: Desk) -> JobAnswer:
    """Plan a cycle of moves and waits; its time is shared so that it takes the least energy.

    Raises:
        BadInput: a fault of the job; names the step. Infeasible: no motion keeps the limits in the time there is.
    """
    if content_of(request)[0].get("format") == WORKCELL:
        return run_workcell_job(request, desk)
    if request.jitter is not None:
        raise BadInput("--jitter belongs to a job of several robots (format = 'energy-opt/job/2')")
    _ = request.worth  # refuses invalid numbers before the work
    job, rivals, kind, asked = prepared(request, desk)
    formats = check_written(request, job.robot)
    settings, cell = settings_of(request), cell_of(request)
    document = desk.take(JobAnswer.answer, asked)
    answers = answers_of(request, job, rivals, settings, desk)
    with desk.working() as (stopped, show):
        usual: dict[str, Any] = {"cell": cell, "stopped": stopped, "progress": show}
        with desk.stating(JobAnswer.answer, robot=job.robot.name, cycle_time=job.cycle_time, request=document):
            first = run_posed(job, mean_of(rivals), settings, answers=answers, **usual)

            def under(model: PowerModel, held: Shares = NONE, result: JobResult | None = None) -> JobResult:
                """The job planned under a model, or `result` of it, with a margin for samples that break limits."""

                def planned(shares: Shares) -> JobResult:
                    both = {name: shares.get(name, 1.0) * held.get(name, 1.0) for name in {*shares, *held}}
                    return replace(run_job(first.job, model, settings, room=both, **usual), choice=first.choice)

                return job_files.with_room(result or planned(NONE), formats, request.rate, planned)

            result = under(mean_of(rivals), result=first)
            if kind is not None:
                result = held(result, rivals, under)
                result = efforts_held(result, rivals, partial(under, mean_of(rivals)))
        if kind is None:
            result = compared(result, with_careful(rivals, job.robot))
            result = replace(result, warnings=(*result.warnings, *said(result.models, "the cycle")))
        else:
            result = warned(stated(result, rivals), rivals)
        result = replace(grounded(result, rivals), interrupted=stopped())
        answer = desk.keep(JobAnswer.of(result, asked, desk.stamp, formats))
    if result.solved and answers is not None:
        answers.forget()
    programs = [row for row in answer.files if row.file != job_files.CYCLE]
    desk.report(programs, assumed(result.assumptions), answer.document()["warnings"])
    return answer


def run_workcell_job(request: JobRequest, desk: Desk) -> JobAnswer:
    """A cycle of several robots, scheduled and planned for least energy.

    Raises:
        BadInput: an option of one robot, or a fault of the file.
        Infeasible: no schedule keeps cycle time, lags, zones, limits of the supply, and arms apart.
    """
    from energy_opt.workcell import programs
    from energy_opt.workcell.as_job import model_named
    from energy_opt.workcell.file import workcell_of
    from energy_opt.workcell.solve_cell import run_workcell

    content, path = content_of(request)
    given = next((name for name in OF_ONE_ROBOT if getattr(request, name) is not None), None)
    if given is not None:
        raise BadInput(f"--{given} belongs to a job of one robot; in a job of several, give it in each [[robot]]")
    if request.resume:
        raise BadInput("--resume belongs to a job of one robot; a job of several cannot be continued")
    if request.robust not in (None, "mean"):
        raise BadInput(
            f"--robust {request.robust} belongs to a job of one robot; a job of several takes the mean of the models"
        )
    kind = None if request.robust is None else "mean"
    cell = workcell_of(content if request.jitter is None else {**content, "jitter": request.jitter}, path)
    check_rate_of(request)
    load = partial(robot_of, request)
    formats = programs.formats_of(cell, list(request.write), path, load, request.allow_outside)

    def model_of(name: str | None, robot: Robot) -> PowerModel:
        own = [] if name is None else [model_named(name, path, request.allow_outside)]
        return mean_of(rivals_from(several(request.model) or own, kind, robot)[0])

    asked = replace(request, job=content, folder=str(path.parent.resolve()))
    _ = request.worth  # refuses invalid numbers before the work
    document = desk.take(JobAnswer.answer, asked)
    settings = settings_of(request)
    with desk.working() as (stopped, show):
        with desk.stating(JobAnswer.answer, cycle_time=cell.cycle_time, request=document):
            plan = partial(
                run_workcell, cell, path, load=load, model_of=model_of, settings=settings, request=cell_of(request),
                stopped=stopped, progress=show,
            )  # fmt: skip
            result = programs.with_room(plan(), formats, request.rate, lambda room: plan(room=room))
        answer = desk.keep(JobAnswer.of(result, asked, desk.stamp, formats))
    desk.report(programs.asked_of(answer.files), warnings=answer.document()["warnings"])
    return answer


job = verb(JobRequest, run)
