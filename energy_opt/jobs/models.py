"""A job under several models: stated under the first, and never with more energy than the evenly slowed cycle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.jobs.cycle import Plan, Scorers, efforts, energy_of
from energy_opt.jobs.solve_job import JobResult
from energy_opt.motion.judge.certificate import ALLOWED
from energy_opt.motion.judge.energy import COARSER
from energy_opt.motion.limits.joint import Effort
from energy_opt.motion.plan.efforts import EFFORT_ROUNDS, HELD, smaller
from energy_opt.motion.plan.planner import Shares
from energy_opt.motion.plan.robust_models import SAME, Rival, exceeds, judges_of
from energy_opt.motion.travel import detours
from energy_opt.power import Mixture, PowerModel
from energy_opt.power.assumptions import assumptions, break_even

BESIDE = "evenly_slowed"  # the baseline of stated savings


def compared(result: JobResult, judges: Sequence[Rival]) -> JobResult:
    """The result with a record in `models` for every judge, the model that it was planned with first."""
    job = result.job
    slowed = result.baselines[BESIDE]
    records: list[dict[str, Any]] = []
    for judge in judges:
        scorers = Scorers(job.robot, judge.model)
        energy, joules = energy_of(job, scorers, result.plan.under(job, scorers)), None
        if slowed is not None:
            joules = energy_of(job, scorers, slowed.under(job, scorers)) - energy
        share = None if joules is None else 100 * joules / (energy + joules)
        records.append({"name": judge.name, "total": energy, "saving_joules": joules, "saving_total_percent": share})
    return replace(result, models=tuple(records))


def grounded(result: JobResult, rivals: Sequence[Rival]) -> JobResult:
    """The result with its assumptions, the dry friction that ends the saving, and joints that take detours.

    Args:
        rivals: the models that it was planned with, the one that it is stated under first.
    """
    job = result.job
    slowed = result.baselines[BESIDE]

    def saved(model: PowerModel) -> float:
        assert slowed is not None
        scorers = Scorers(job.robot, model)
        theirs, ours = (energy_of(job, scorers, p.under(job, scorers, COARSER)) for p in (slowed, result.plan))
        return theirs - ours - SAME * abs(theirs)

    share = None if slowed is None else break_even(saved, rivals[0].model, job.robot)
    records = [
        {"step": leg.name, **row}
        for leg, answer in zip(result.plan.legs, result.plan.answers, strict=True)
        for row in detours(answer.trajectory)
    ]
    used = assumptions(job.robot, [rival.model for rival in rivals])
    return replace(result, assumptions=used, break_even_friction=share, travel=tuple(records))


def mean_of(rivals: Sequence[Rival]) -> PowerModel:
    """The model to plan a job with: the mean of the models, or the only one."""
    return rivals[0].model if len(rivals) == 1 else Mixture.of([rival.model for rival in rivals])


def held(result: JobResult, rivals: Sequence[Rival], again: Callable[[PowerModel], JobResult]) -> JobResult:
    """The job, or a plan under the corner of assumed friction at which the evenly slowed cycle costs less.

    Args:
        rivals: the result was planned under the mean of these.
        again: plans the job under another model. The corner takes the place of its own model in the mean.
    """
    costly = _costlier(result, rivals)
    if not costly or result.interrupted:
        return result
    place, corner = costly[0]
    others = [corner if k == place else rival for k, rival in enumerate(rivals)]
    found = replace(again(mean_of(others)), baselines=result.baselines, bound=result.bound)
    return found if found.solved and not _costlier(found, rivals) else result


def efforts_held(result: JobResult, rivals: Sequence[Rival], again: Callable[[Shares], JobResult]) -> JobResult:
    """The job, or one planned with smaller torque limits, so that the motors' limits hold under each of the rivals.

    Args:
        result: planned under the mean of the rivals, with the limits held under the first one.
        again: plans the job with these shares of the limits' bounds.
    """
    found, share, use = result, np.ones(result.job.robot.n), _efforts(result, rivals[1:])
    for _ in range(EFFORT_ROUNDS):
        if use.max() <= HELD or found.interrupted:
            break
        share = smaller(share, use, _efforts(found, rivals[:1]))
        try:
            found = again({Effort.name: share})
        except Infeasible:
            break
        use = _efforts(found, rivals[1:])
    if found is result or use.max() > HELD or not found.solved:
        return result
    return replace(found, baselines=result.baselines, bound=result.bound)


def warned(result: JobResult, rivals: Sequence[Rival]) -> JobResult:
    """The job with a warning if a motor's torque exceeds its limit under another of the rivals than the first."""
    use, job = _efforts(result, rivals[1:]), result.job
    if use.max() <= 1 + ALLOWED:
        return result
    joint = job.robot.joints[int(use.argmax())]
    said = f"under another model than {rivals[0].name!r} {joint} takes {100 * use.max():.4g} % of its torque limit"
    return replace(result, warnings=(*result.warnings, said))


def _efforts(result: JobResult, rivals: Sequence[Rival]) -> np.ndarray:
    """The largest share (n,) of each joint's torque limit that the motions use under any of the rivals."""
    legs = zip(result.plan.legs, result.plan.answers, strict=True)
    motions = ((leg.step, answer.trajectory) for leg, answer in legs)
    return efforts(result.job.robot, [rival.model for rival in rivals], motions)


def _costlier(result: JobResult, rivals: Sequence[Rival]) -> list[tuple[int, Rival]]:
    """The judges under which the cycle costs more than the evenly slowed one, the worst first."""
    judges = judges_of(rivals, result.job.robot)
    records = compared(result, [judge for _, judge in judges]).models
    found = [
        (row["saving_joules"], k)
        for k, row in enumerate(records)
        if row["saving_joules"] is not None and exceeds(row["total"], row["total"] + row["saving_joules"])
    ]
    return [judges[k] for _, k in sorted(found)]


def stated(result: JobResult, rivals: Sequence[Rival]) -> JobResult:
    """A job that was planned under the mean of `rivals`, stated under the first of them.

    If the cycle costs more than the evenly slowed one under any of them, or at a corner of assumed friction, it is
    replaced by the evenly slowed one, unless only this one exceeds a torque limit under some of them. The bound is of
    the mean, not of the stated energy: it is in `robust`.
    """
    job = result.job
    costly = _costlier(result, rivals)
    slowed = result.baselines[BESIDE]
    plan, warnings = result.plan, result.warnings
    held = [_efforts(replace(result, plan=p), rivals[1:]).max() <= HELD for p in (plan, slowed or plan)]
    if costly and slowed is not None and held != [True, False]:
        plan = slowed
        said = f"no cycle was found that takes less energy than the evenly slowed one under {costly[0][1].name!r} too"
        warnings = (*warnings, said)
    plans, under = result.baselines.items(), [Scorers(job.robot, rival.model) for rival in rivals]
    scorers = under[0]

    def mean(plan: Plan) -> float:
        return float(np.mean([energy_of(job, each, plan.under(job, each)) for each in under]))

    baselines = {name: None if plan is None else mean(plan) for name, plan in plans}
    robust = {"kind": "mean", "total": mean(plan), "lower_bound": result.bound, "baselines": baselines}
    stated = replace(
        result, plan=plan.under(job, scorers), scorers=scorers, bound=None, robust=robust, warnings=warnings,
        baselines={name: None if plan is None else plan.under(job, scorers) for name, plan in plans},
    )  # fmt: skip
    return compared(stated, [judge for _, judge in judges_of(rivals, job.robot)])
