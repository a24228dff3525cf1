"""The verb `job`: a cycle of moves and waits, of one robot or of several."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from energy_opt.errors import BadInput, Infeasible
from energy_opt.formats.output import Files
from energy_opt.front.controllers import check_written
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import cell_of
from energy_opt.front.jobs import JOB, JobAnswer, answers_of, content_of, job_from, job_settings, loaded, resolved_job
from energy_opt.front.rivals import rivals_of, said, with_careful
from energy_opt.front.workcell import WORKCELL, run_workcell_job
from energy_opt.jobs.models import compared, efforts_held, grounded, held, mean_of, stated, warned
from energy_opt.jobs.output import found_of, with_room, write, write_programs
from energy_opt.jobs.posed import run_posed
from energy_opt.jobs.run import JobResult, run_job
from energy_opt.motion.plan.planner import Shares
from energy_opt.power import PowerModel
from energy_opt.power.assumptions import assumptions_line as assumed
from energy_opt.power.per_year import per_year_words
from energy_opt.requests.moves import JobRequest


def run(request: JobRequest, desk: Desk) -> JobAnswer:
    """A cycle of moves and waits, its time spent where it saves most.

    Raises:
        BadInput: a fault of the job; names the step. Infeasible: no motion keeps the limits in the time there is.
    """
    if content_of(request)[0].get("format") == WORKCELL:
        return run_workcell_job(request, desk)
    if request.jitter is not None:
        raise BadInput("--jitter is of several robots (format = 'energy-opt/job/2')")
    job, _ = job_from(request), request.worth
    rivals, kind = rivals_of(request, job.robot, desk)
    job = loaded(request, job, rivals, desk)
    formats = check_written(request, job.robot.n)
    settings = job_settings(request)
    cell = cell_of(request)
    asked = resolved_job(request, job.robot, rivals, kind)
    document = desk.take(JOB, asked)
    answers, known = answers_of(request, job, rivals, settings, desk)
    with desk.working() as (stopped, show):
        usual: dict[str, Any] = {"cell": cell, "stopped": stopped, "progress": show}
        try:
            first = run_posed(job, mean_of(rivals), settings, **known, **usual)

            def planned(model: PowerModel, shares: Shares) -> JobResult:
                return replace(run_job(first.job, model, settings, room=shares, **usual), choice=first.choice)

            def roomy(result: JobResult, model: PowerModel, held: Shares = MappingProxyType({})) -> JobResult:
                def again(shares: Shares) -> JobResult:
                    both = {name: shares.get(name, 1.0) * held.get(name, 1.0) for name in {*shares, *held}}
                    return planned(model, both)

                return with_room(result, Files(formats, request.rate), again)

            def under(model: PowerModel, shares: Shares = MappingProxyType({})) -> JobResult:
                return roomy(planned(model, shares), model, shares)

            result = roomy(first, mean_of(rivals))
            if kind is not None:
                result = held(result, rivals, under)
                result = efforts_held(result, rivals, lambda shares: under(mean_of(rivals), shares))
        except Infeasible as error:
            desk.failed(JOB, error, robot=job.robot.name, cycle_time=job.cycle_time, request=document)
            raise
        if kind is None:
            result = compared(result, with_careful(rivals, job.robot))
            result = replace(result, warnings=(*result.warnings, *said(result.models, "the cycle")))
        else:
            result = warned(stated(result, rivals), rivals)
        result = grounded(result, rivals)
        answer = desk.keep(
            JobAnswer(
                result=result, request=asked, stamp=desk.stamped({}), formats=formats, programs=write_programs,
                found_of=found_of, write=write, words=table,
            )
        )  # fmt: skip
    if result.solved and answers is not None:
        answers.forget()
    desk.report(answer.files, assumed(result.assumptions), answer.document()["warnings"])
    return answer


job = verb(JobRequest, run)


def table(found: Mapping[str, Any], cycles: float | None) -> str:
    """Table of the steps and savings, for a terminal.

    Args:
        found: the content of job.json. cycles: how many a year, if asked for.
    """
    lines = [f"{'step':<24} {'begins [s]':>10} {'takes [s]':>10} {'energy [J]':>11} {'kg':>5}"]
    for row in found["steps"]:
        lines.append(
            f"{row['name'][:24]:<24} {row['start']:>10.3f} {row['duration']:>10.3f} {row['energy_total']:>11.3f} "
            f"{row['payload']:>5.2g}"
        )
    lines.append(f"in a {found['cycle_time']:g} s cycle: this plan {found['energy_total']:.3f} J")
    for row in found["baselines"]:
        name = row["name"].replace("_", " ")
        if row["energy_total"] is None:
            lines.append(f"  {name}: not possible within the limits")
        else:
            saved = 100 * (1 - found["energy_total"] / row["energy_total"])
            lines.append(f"  {name} {row['energy_total']:.3f} J (this plan saves {saved:.2f} %)")
    choice, mean = found.get("choice"), " in the mean of the models" if found.get("robust") else ""
    if choice and choice["greedy_nearest"] is not None:
        chosen, nearest = choice["energy_total"], choice["greedy_nearest"]
        lines.append(f"positions at the poses: {chosen:.3f} J a cycle, with the nearest ones {nearest:.3f} J{mean}")
    if "per_year" in found:
        lines.append(per_year_words(found["per_year"], cycles or 0.0))
    several = found.get("robust")
    bound, of = (several or found["optimality"])["lower_bound"], " (mean of the models)" if several else ""
    if bound is not None:
        gap = found["optimality"]["gap_percent"]
        lines.append(f"no timing of these paths takes less than {bound:.3f} J{of} (gap {gap:.2g} %)")
    return "\n".join(lines)
