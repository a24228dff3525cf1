"""Rest of single joints in a cycle under several models: the cycle must not cost too much under any of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.jobs.cycle import Plan, Scorers, energy_of
from energy_opt.jobs.work import Worker
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.efforts import HELD, used
from energy_opt.motion.plan.robust_models import Rival, judges_of
from energy_opt.motion.plan.robust_rests import rested
from energy_opt.motion.trajectory import Trajectory


def with_rests(work: Worker, plan: Plan, even: Plan | None) -> Plan:
    """The plan, or one of less mean energy in which single joints rest before and after their moves.

    Args:
        work: solved the legs, under the mean of several models; under one model, its answers rest already.
        even: the evenly slowed cycle, if it is valid. Under each model, and at the corners of its assumed friction, the
            cycle takes no more energy than this or the given plan.
    """
    job, weighted = work.job, work.scorers.model.weighted
    if len(weighted) == 1:
        return plan
    judges = judges_of([Rival("", model) for _, model in weighted], job.robot)
    scorers = [Scorers(job.robot, judge.model) for _, judge in judges]
    weights = np.array([share for share, _ in weighted])

    def value(totals: np.ndarray) -> float:
        return float(weights @ totals[: len(weights)])

    def cycle(of: Plan) -> np.ndarray:
        return np.array([energy_of(job, each, of.under(job, each)) for each in scorers])

    room = np.full(len(judges), np.inf) if even is None else np.maximum(cycle(even) - cycle(plan), 0.0)
    limit, answers = job.robot.limits.effort, list(plan.answers)
    for k, (leg, answer) in enumerate(zip(plan.legs, plan.answers, strict=True)):
        if work.stopped() or not leg.moves or answer.status != "solved" or answer.source in ("scaled", "toppra"):
            continue
        own, planner = [each.of(leg.step) for each in scorers], work.planner(leg.step)

        def totals(motion: Trajectory, own: Sequence[Scorer] = own) -> np.ndarray:
            return np.array([each.energy(motion).total for each in own])

        def overloads(motion: Trajectory, own: Sequence[Scorer] = own) -> bool:
            return bool(used(motion, own[1 : len(weights)], limit).max() > HELD)

        move, before = leg.move(answer.trajectory.duration), totals(answer.trajectory)
        motion = rested(planner, move, answer.trajectory, before + room, totals, value, overloads, work.stopped)
        if motion is not answer.trajectory:
            room -= totals(motion) - before
            answers[k] = replace(answer, trajectory=motion, energy=planner.score(motion))
    return replace(plan, answers=tuple(answers))
