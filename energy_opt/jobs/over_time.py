"""Energy of a job over its cycle time, and the knee beyond which more time saves little."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from energy_opt.cell.request import CellRequest
from energy_opt.errors import Infeasible
from energy_opt.jobs.legs import Job
from energy_opt.jobs.posed import Posed
from energy_opt.jobs.solve_job import JobResult, RoughCycles, run_job
from energy_opt.jobs.work import Answers, Cells, Worker
from energy_opt.motion.move import Settings
from energy_opt.motion.plan.planner import Shares
from energy_opt.power import PowerModel
from energy_opt.power.per_year import per_year_words
from energy_opt.reports.charts import Chart, Line
from energy_opt.reports.optimize import assumed
from energy_opt.reports.page import Report
from energy_opt.reports.words import yearly
from energy_opt.results import interrupted_words

COUNT = 10  # default number of cycle times
ROOM = 1.0005  # times the shortest cycle: the shortest itself leaves nothing to share
REACH = 2.0  # the default ends at this multiple of the shortest cycle, or of the job's own time beyond it
TOO_SHORT = 1e-3  # [s] infeasible cycle time: its error contains the shortest one


@dataclass(frozen=True)
class JobPoint:
    """A cycle time [s] and the job solved for it; `reason` says why it cannot be solved."""

    cycle_time: float
    result: JobResult | None
    reason: str = ""

    @property
    def status(self) -> str:
        """ "solved", "not_converged" or "infeasible"."""
        if self.result is None:
            return "infeasible"
        return "solved" if self.result.solved else "not_converged"


def over_time(
    job: Job,
    model: PowerModel,
    settings: Settings,
    *,
    cell: CellRequest | None = None,
    times: Sequence[float] | None = None,
    answers: Answers | None = None,
    restated: Callable[[JobResult, Callable[[Shares], JobResult]], JobResult] = lambda result, again: result,
    stopped: Callable[[], bool] = lambda: False,
    progress: Callable[[str, float], None] = lambda text, share: None,
) -> tuple[list[JobPoint], float]:
    """The job at several cycle times, and its shortest cycle time [s].

    Each leg is solved alone once; at other durations its optimum is continued.

    Args:
        times: cycle times [s]; by default `COUNT` of them from the shortest on.
        restated: converts each result, for example by `jobs.models.stated` for several models. It also gets a function
            that plans the same cycle with shares of the limits' bounds.
        answers, stopped, progress: as those of `run_job`.

    Raises:
        Infeasible: a leg cannot be done at all.
    """
    around = cell or CellRequest()
    if job.open:  # the same positions at every cycle time
        rough = RoughCycles(model, settings, job, stopped)
        job = job.at(Posed(job, model, settings, around).likely(rough)[0])
    shortest, work = TOO_SHORT, Worker(job, model, settings, Cells(job, around), stopped, answers=answers)
    usual: dict[str, Any] = {"stopped": stopped, "worker": work}
    try:
        run_job(replace(job, cycle_time=TOO_SHORT), model, settings, **usual)
    except Infeasible as error:
        if error.shortest_duration is None:
            raise
        shortest = error.shortest_duration
    if times is None:
        times = np.geomspace(ROOM * shortest, REACH * max(shortest, job.cycle_time), COUNT).tolist()
    points = []
    for k, time in enumerate(times):
        progress(f"cycle of {time:.4g} s", k / len(times))
        if stopped():
            break
        at = replace(job, cycle_time=time)

        def again(shares: Shares, at: Job = at) -> JobResult:
            return run_job(at, model, settings, cell=around, stopped=stopped, room=shares)

        try:
            points.append(JobPoint(time, restated(run_job(at, model, settings, **usual), again)))
        except Infeasible as error:
            points.append(JobPoint(time, None, str(error)))
    return points, shortest


def knee(time: np.ndarray, energy: np.ndarray) -> int | None:
    """The point (of at least three) farthest below the line between the ends; None if none is below.

    Overhead is proportional to time and does not move the knee.

    >>> knee(np.array([1.0, 2.0, 4.0, 8.0]), np.array([9.0, 5.0, 4.5, 4.0]))
    1
    """
    if len(time) < 3:
        return None
    line = np.interp(time, time[[0, -1]], energy[[0, -1]])
    k = int(np.argmax(line - energy))
    return k if line[k] - energy[k] > 1e-9 * abs(energy[k]) else None


def document(job: Job, points: Sequence[JobPoint], shortest: float, interrupted: bool) -> dict[str, Any]:
    """The content of a job's tradeoff.json: `duration` is the cycle time [s], energies are of the whole cycle [J].

    Args:
        job: as asked. points: its cycle times. shortest: [s] the shortest cycle. interrupted: whether it stopped early.
    """
    records = [_row(point) for point in points]
    found = [row for row in records if row["energy_total"] is not None]
    bend = knee(*(np.array([row[name] for row in found]) for name in ("duration", "energy_total")))
    known = {row["status"] for row in records} - {"infeasible"}
    status = "solved" if known == {"solved"} else "not_converged" if known else "infeasible"
    return {
        "status": "interrupted" if interrupted else status,
        "robot": job.robot.name,
        "joints": list(job.robot.joints),
        "points": records,
        "minimum": _short(min(found, key=lambda row: row["energy_total"], default=None)),
        "knee": _short(None if bend is None else found[bend]),
        "fastest": shortest,
        "cycle_time": job.cycle_time,
        "warnings": [*interrupted_words(interrupted, "; --resume continues it"), *_warnings(points)],
    }


def _warnings(points: Sequence[JobPoint]) -> list[str]:
    """The warnings of all cycle times, each once, with the cycle times [s] that it is about."""
    found: dict[str, list[str]] = {}
    for point in points:
        for said in () if point.result is None else point.result.warnings:
            found.setdefault(said, []).append(f"{point.cycle_time:.4g}")
    return [f"cycle of {', '.join(times)} s: {said}" for said, times in found.items()]


def _row(point: JobPoint) -> dict[str, Any]:
    """The record of a cycle time: energies [J] of the whole cycle and of its baselines, or why there is none."""
    row: dict[str, Any] = {"duration": point.cycle_time, **dict.fromkeys(("energy_total", "energy_standby"))}
    row |= {"energy_loss": None, "status": point.status}
    result = point.result
    if result is None:
        return {**row, "reason": point.reason}
    standby = result.standby
    row |= {"energy_total": result.energy, "energy_standby": standby, "energy_loss": result.energy - standby}
    return row | result.energies


def _short(row: dict[str, Any] | None) -> dict[str, Any] | None:
    return None if row is None else {"duration": row["duration"], "energy_total": row["energy_total"]}


PLAIN = ("evenly_slowed", "fastest_then_wait")


def text(found: Mapping[str, Any]) -> str:
    """The content of a job's tradeoff.json as a short table for a terminal."""
    lines = [f"{'cycle [s]':>10} {'energy [J]':>14} {'evenly slowed':>14} {'fastest, wait':>14}  status"]
    for row in found["points"]:
        joules = (row["energy_total"], *(row.get(name) for name in PLAIN))
        cells = [f"{'-' if value is None else format(value, '.2f'):>14}" for value in joules]
        lines.append(f"{row['duration']:>10.3f} {' '.join(cells)}  {row['status']}")
    several = found["request"].get("robust")
    if several:
        lines.append(f"under {several['models'][0]['name']}; planned for the {several['kind']} of the models")
    lines.append(f"shortest cycle: {found['fastest']:.4g} s")
    if found["knee"] is not None:
        lines.append(f"knee: {found['knee']['duration']:.4g} s, {found['knee']['energy_total']:.5g} J")
    if "per_year" in found:
        lines.append(per_year_words(found["per_year"], found["request"]["cycles_per_year"]))
    return "\n".join(lines)


def page(found: Mapping[str, Any]) -> Report:
    """The report."""
    report = Report(f"{found['robot']}: energy of a job over its cycle time")
    knee = found["knee"]
    if knee is not None:
        report.headline(f"Knee at a cycle of {knee['duration']:.4g} s: {knee['energy_total']:.5g} J.")
    report.numbers(yearly(found)).warning(*found["warnings"])
    shown = [row for row in found["points"] if row["energy_total"] is not None]
    time = np.array([row["duration"] for row in shown])
    marks = {} if knee is None else {"knee": (knee["duration"], knee["energy_total"])}

    def line(name: str, column: str, style: str) -> Line:
        return Line(name, time, np.array([row.get(column) for row in shown], dtype=float), style)

    lines = [line("this plan", "energy_total", "dots")]
    lines += [line(name.replace("_", " "), name, "dash") for name in PLAIN if any(row.get(name) for row in shown)]
    report.charts(
        Chart(
            "Energy of the cycle", "cycle time [s]", "energy [J]", lines, marks=marks,
            edges={"fastest": found["fastest"]}, pictured=True,
        ),
        Chart("Standby left out", "cycle time [s]", "energy [J]", [line("this plan", "energy_loss", "dots")]),
    )  # fmt: skip
    columns = {"cycle [s]": "duration", "energy [J]": "energy_total", "standby [J]": "energy_standby"}
    columns |= {"evenly slowed [J]": "evenly_slowed", "fastest then wait [J]": "fastest_then_wait"}
    report.records(found["points"], {**columns, "status": "status", "reason": "reason"}, digits=6)
    assumed(report, found)
    return report.command(found.get("request"))
