"""What models that a job was not planned with make of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from energy_opt.job.cycle import Plan, Scorers, assembled, energy_of
from energy_opt.job.run import JobResult
from energy_opt.job.work import unloaded
from energy_opt.motion.plan.robust import Rival

BESIDE = "evenly_slowed"  # the baseline that savings are stated against


def compared(result: JobResult, judges: Sequence[Rival]) -> JobResult:
    """The result with a row of `models` for every judge, the model that it was planned with first."""
    job = result.job
    slowed = next((b.plan for b in result.baselines if b.name == BESIDE), None)
    rows: list[dict[str, Any]] = []
    for judge in judges:
        scorers = Scorers(job.robot, unloaded(judge.model))

        def total(plan: Plan, scorers: Scorers = scorers) -> float:
            return energy_of(assembled(job, scorers, plan.under(job, scorers)))

        energy, joules = total(result.plan), None
        if slowed is not None:
            joules = total(slowed) - energy
        share = None if joules is None else 100 * joules / (energy + joules)
        rows.append({"name": judge.name, "total": energy, "saving_joules": joules, "saving_total_percent": share})
    return replace(result, models=tuple(rows))
