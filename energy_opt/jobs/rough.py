"""Rough cycles of a job: near the optimum in a fraction of a solve's time; nothing is proven.

The first motions of a cycle are sketched. Those of a neighbour are bent to the new ends and settle to the nearest
optimum: one sequential quadratic program for each leg. Bodies are considered only for legs whose motions touch
something.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from energy_opt.jobs.cycle import Plan, Scorers, cheapest_rest, energy_of
from energy_opt.jobs.file import Job
from energy_opt.jobs.legs import legs_of
from energy_opt.jobs.run import shares_of
from energy_opt.jobs.work import Cells, Worker, unloaded
from energy_opt.motion.move import Settings
from energy_opt.motion.plan.planner import Planner
from energy_opt.power import PowerModel


class RoughCycles:
    """Solves cycles of one job roughly for different end positions; all share what the first has built.

    Args:
        model: its payload is replaced by those of the job's steps.
        stopped: called between solves.
    """

    def __init__(self, model: PowerModel, settings: Settings, job: Job, stopped: Callable[[], bool]) -> None:
        self._model, self._settings, self._stopped = model, settings, stopped
        quick = replace(settings, solver="sqp")
        self._planner = Planner(job.robot, unloaded(model), quick, batch=True, stopped=stopped)
        self.scorers = Scorers(job.robot, unloaded(model))

    def cycle(self, job: Job, cells: Cells, near: Plan | None = None) -> tuple[Plan, float]:
        """A cycle of a job without open ends, and its energy [J].

        Args:
            cells: bodies that the arm keeps clear of.
            near: a cycle of the same steps with other ends, whose durations are kept.

        Raises:
            Infeasible: nothing within limits was found for a leg, or the cycle is too short.
        """
        work = Worker(job, self._model, self._settings, cells, self._stopped, planner=self._planner)
        legs = tuple(legs_of(job.steps))
        rest = cheapest_rest(job, self.scorers)
        if near is None:
            durations = shares_of(job, work, legs, [work.timing(leg) for leg in legs], rest)[1].durations
        else:
            durations = np.array([answer.trajectory.duration for answer in near.answers])
        before = [None] * len(legs) if near is None else near.answers
        answers = tuple(map(work.rough, legs, np.round(durations, 9).tolist(), before))
        left = job.cycle_time - job.waiting - sum(answer.trajectory.duration for answer in answers)
        plan = Plan(legs, answers, rest, max(left, 0.0))
        return plan, energy_of(job, self.scorers, plan)
