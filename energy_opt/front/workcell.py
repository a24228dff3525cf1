"""The verb `job` for several robots in one cycle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from energy_opt.errors import BadInput, Infeasible
from energy_opt.front.controllers import check_rate_of
from energy_opt.front.desk import Desk
from energy_opt.front.given import cell_of, robot_of, several
from energy_opt.front.jobs import JOB, JobAnswer, content_of, job_settings
from energy_opt.front.rivals import rivals_from
from energy_opt.jobs.models import mean_of
from energy_opt.power import PowerModel
from energy_opt.power.per_year import per_year_words
from energy_opt.reports.workcell import BRIEF
from energy_opt.requests.moves import JobRequest
from energy_opt.robot import Robot

WORKCELL = "energy-opt/job/2"
OF_ONE_ROBOT = ("robot", "payload", "base")  # options of one robot, which are refused here


def run_workcell_job(request: JobRequest, desk: Desk) -> JobAnswer:
    """A cycle of several robots, scheduled and planned for least energy.

    Raises:
        BadInput: an option of one robot, or a fault of the file.
        Infeasible: no schedule keeps cycle time, lags, zones, limits of the supply, and arms apart.
    """
    from energy_opt.workcell.as_job import model_named
    from energy_opt.workcell.file import workcell_of
    from energy_opt.workcell.output import found_of, write
    from energy_opt.workcell.program import formats_of, write_programs
    from energy_opt.workcell.run import run_workcell

    content, path = content_of(request)
    given = next((name for name in OF_ONE_ROBOT if getattr(request, name) is not None), None)
    if given is not None:
        raise BadInput(f"--{given} is of one robot; in a job of several, [[robot]] has its own")
    if request.robust not in (None, "mean"):
        raise BadInput(
            f"--robust {request.robust} is of one robot; a job of several is planned under the mean of the models"
        )
    kind = None if request.robust is None else "mean"
    cell = workcell_of(content if request.jitter is None else {**content, "jitter": request.jitter}, path)
    check_rate_of(request)
    load = partial(robot_of, request)
    formats = formats_of(cell, list(request.write), path, load, request.allow_outside)

    def model_of(name: str | None, robot: Robot) -> PowerModel:
        own = [] if name is None else [model_named(name, path, request.allow_outside)]
        return mean_of(rivals_from(several(request.model) or own, kind, robot)[0])

    asked = replace(request, job=content, folder=str(path.parent.resolve()))
    _ = request.worth  # refuses invalid numbers before the work
    document = desk.take(JOB, asked)
    settings = job_settings(request)
    with desk.working() as (stopped, show):
        try:
            result = run_workcell(
                cell, path, load=load, model_of=model_of, settings=settings, request=cell_of(request),
                stopped=stopped, progress=show,
            )  # fmt: skip
        except Infeasible as error:
            desk.failed(JOB, error, cycle_time=cell.cycle_time, request=document)
            raise
        answer = desk.keep(
            JobAnswer(
                result=result, request=asked, stamp=desk.stamped({}), formats=formats, programs=write_programs,
                found_of=found_of, write=write, words=table,
            )
        )  # fmt: skip
    for row in answer.files:
        if row.format != "csv" or not row.valid:
            file = row.file if desk.out is None else desk.out / row.file
            desk.say(f"{file}: {row}; begins at {row.about['starts_at']:.3f} s of the cell's cycle")
    desk.report(warnings=answer.document()["warnings"])
    return answer


def table(found: Mapping[str, Any], cycles: float | None) -> str:
    """Table of the schedule and the saving by each lever, for a terminal.

    Args:
        found: the content of job.json. cycles: how many a year, if asked for.
    """
    lines = [f"{'robot':<14} {'step':<28} {'begins [s]':>10} {'takes [s]':>10} {'mode':<16} {'energy [J]':>12}"]
    for robot in found["robots"]:
        lines += [
            f"{robot['name'][:14]:<14} {s['name'][:28]:<28} {s['start']:>10.3f} {s['duration']:>10.3f} "
            f"{(s['mode'] or 'moves')[:16]:<16} {s['energy_total']:>12.1f}"
            for s in robot["steps"]
            if s["duration"] > BRIEF
        ]
    bound = "" if found["bound"] is None else f"; no schedule of these curves takes less than {found['bound']:.1f} J"
    lines.append(f"the cycle of {found['cycle_time']:g} s takes {found['energy_total']:.1f} J{bound}")
    lines.append(_apart(found))
    lines += _supplied(found)
    lines += _levers(found)
    if "per_year" in found:
        lines.append(per_year_words(found["per_year"], cycles or 0.0))
    return "\n".join(line for line in lines if line)


def _apart(found: Mapping[str, Any]) -> str:
    """Line on the proven distance of the arms; empty for a single arm."""
    clearance = found["clearance"]
    if clearance is None:
        return ""
    late = f"each up to {1e3 * clearance['jitter']:g} ms early or late"
    if clearance["verdict"] == "proven":
        return f"the arms keep at least {1e3 * clearance['lower_bound']:.3g} mm apart, {late}: proven"
    return f"the arms, {late}: {clearance['verdict']}"


def _supplied(found: Mapping[str, Any]) -> list[str]:
    """Lines on the arms' energy from supplies of their own and from the supply of the file."""
    supply = found["supply"]
    if supply is None or found["levers"][-1]["name"] != "supply":
        return []
    most = "" if supply["max_power"] is None else f" of {supply['max_power']:.5g} W"
    return [
        f"supplies of their own: {supply['energy_own']:.1f} J, {supply['lost_own']:.1f} J of braking lost, "
        f"peak {supply['peak_own']:.1f} W",
        f"the supply of the file: {supply['energy']:.1f} J, {supply['lost']:.1f} J of braking lost, "
        f"peak {supply['peak']:.1f} W{most}",
    ]


def _levers(found: Mapping[str, Any]) -> list[str]:
    """The cycle with one lever after the other; levers that were computed for evenly slowed moves are marked."""
    levers = found["levers"]
    first, year = levers[0]["energy_total"], "per_year" in levers[0]
    lines = [f"{'with':<10} {'energy [J]':>12} {'saved [J]':>12} {'saved [%]':>10}"]
    lines[0] += f" {'[kWh a year]':>13} {'[money]':>10}" if year else ""
    for lever in levers:
        mark = "*" if lever["moves"] == "evenly_slowed" else ""
        saved = first - lever["energy_total"]
        line = f"{lever['name'].replace('_', ' ') + mark:<10} {lever['energy_total']:>12.1f} {saved:>12.1f}"
        line += f" {100 * saved / first:>10.2f}"
        if year:
            kwh, money = lever["per_year"]["kwh"], lever["per_year"]["money"]
            line += f" {kwh:>13.2f} {'-' if money is None else format(money, '.2f'):>10}"
        lines.append(line)
    if any(lever["moves"] == "evenly_slowed" for lever in levers):
        lines.append("* computed for moves slowed evenly along initial paths, which are not kept apart from other arms")
    return lines
