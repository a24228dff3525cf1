"""Energy of a job over its cycle time, and the knee beyond which more time saves little."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from energy_opt.cell.request import CellRequest
from energy_opt.errors import Infeasible
from energy_opt.jobs.file import Job
from energy_opt.jobs.posed import Posed
from energy_opt.jobs.run import Answered, JobResult, Known, run_job
from energy_opt.motion.move import Settings
from energy_opt.power import PowerModel

COUNT = 10  # cycle times where none are asked for
ROOM = 1.0005  # of the shortest cycle: what is shortest leaves nothing to distribute
REACH = 2.0  # the default ends at this multiple of the shortest cycle, or of the job's own time beyond it
TOO_SHORT = 1e-3  # [s] no job is that quick: asking for it says how quick it can be


@dataclass(frozen=True)
class JobPoint:
    """A cycle time [s] and the job solved for it; `reason` says why where it cannot be."""

    cycle_time: float
    result: JobResult | None
    reason: str = ""

    @property
    def status(self) -> str:
        """ "solved", "not_converged" or "infeasible"."""
        if self.result is None:
            return "infeasible"
        return "solved" if self.result.solved else "not_converged"

    @property
    def energy(self) -> float:
        """J of the cycle; nan where there is none."""
        return np.nan if self.result is None else self.result.energy


def shortest_cycle(job: Job, model: PowerModel, settings: Settings, cell: CellRequest) -> float:
    """The shortest cycle time of a job's first paths, waits included [s]."""
    try:
        run_job(replace(job, cycle_time=TOO_SHORT), model, settings, cell=cell)
    except Infeasible as error:
        if error.shortest_duration is None:
            raise
        return error.shortest_duration
    return TOO_SHORT


def over_time(
    job: Job,
    model: PowerModel,
    settings: Settings,
    *,
    cell: CellRequest | None = None,
    times: Sequence[float] | None = None,
    known: Known = lambda leg, duration: None,
    answered: Answered = lambda leg, duration, trajectory: None,
    restated: Callable[[JobResult], JobResult] = lambda result: result,
    stopped: Callable[[], bool] = lambda: False,
    progress: Callable[[str, float], None] = lambda text, share: None,
) -> tuple[list[JobPoint], float]:
    """The job at several cycle times, and the shortest it can be [s].

    Args:
        times: cycle times [s]; by default `COUNT` of them from the shortest on.
        restated: makes of an answer what is kept, as `job.models.stated` does for several models.
        known, answered, stopped, progress: as those of `run_job`.

    Raises:
        Infeasible: a leg cannot be done at all.
    """
    around = cell or CellRequest()
    if job.open:  # the same positions at every cycle time
        job = job.at(Posed(job, model, settings, around).estimated()[0])
    shortest = shortest_cycle(job, model, settings, around)
    if times is None:
        times = np.geomspace(ROOM * shortest, REACH * max(shortest, job.cycle_time), COUNT).tolist()
    points = []
    for k, time in enumerate(times):
        progress(f"cycle of {time:.4g} s", k / len(times))
        if stopped():
            break
        try:
            found = run_job(
                replace(job, cycle_time=time),
                model,
                settings,
                cell=around,
                stopped=stopped,
                known=known,
                answered=answered,
            )
            points.append(JobPoint(time, restated(found)))
        except Infeasible as error:
            points.append(JobPoint(time, None, str(error)))
    return points, shortest


def knee(time: np.ndarray, energy: np.ndarray) -> int | None:
    """The point (of at least three) farthest below the line between the ends; None where none is below.

    Overhead is a straight line over the time and moves no knee.

    >>> knee(np.array([1.0, 2.0, 4.0, 8.0]), np.array([9.0, 5.0, 4.5, 4.0]))
    1
    """
    if len(time) < 3:
        return None
    line = np.interp(time, time[[0, -1]], energy[[0, -1]])
    k = int(np.argmax(line - energy))
    return k if line[k] - energy[k] > 1e-9 * abs(energy[k]) else None


def document(job: Job, points: Sequence[JobPoint], shortest: float, interrupted: bool) -> dict[str, Any]:
    """tradeoff.json of a job: `duration` is the cycle time [s], energies are of the whole cycle [J]."""
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
    }


def _row(point: JobPoint) -> dict[str, Any]:
    row: dict[str, Any] = {"duration": point.cycle_time, **dict.fromkeys(("energy_total", "energy_standby"))}
    row |= {"energy_loss": None, "status": point.status}
    result = point.result
    if result is None:
        return {**row, "reason": point.reason}
    standby = result.scorer(result.job.steps[0]).model.constant_power(result.job.robot.n) * point.cycle_time
    row |= {"energy_total": result.energy, "energy_standby": standby, "energy_loss": result.energy - standby}
    return row | {b.name: b.energy for b in result.baselines}


def _short(row: dict[str, Any] | None) -> dict[str, Any] | None:
    return None if row is None else {"duration": row["duration"], "energy_total": row["energy_total"]}
