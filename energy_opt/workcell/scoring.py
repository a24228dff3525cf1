"""Energies and torques of one arm: under the mean of its models, by which it is planned, and under the first of them,
under which results are stated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.effects import Regeneration
from energy_opt.jobs.cycle import Answer, Scorers
from energy_opt.jobs.legs import Step
from energy_opt.jobs.work import unloaded
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.efforts import used
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.robot import Robot
from energy_opt.schedule.problem import SAME
from energy_opt.workcell.motion import nearest


class Scoring:
    """The scorers of an arm; `mixed`: its model is the mean of several.

    Args:
        robot: the arm's. mean: scorers of its model. model: of the arm.
    """

    def __init__(self, robot: Robot, mean: Scorers, model: PowerModel) -> None:
        first = model.weighted[0][1]
        self.robot, self.mixed = robot, len(model.weighted) > 1
        # with the second ones, all negative power is used again: the link's losses are computed elsewhere
        self._of_mean = mean, Scorers(robot, unloaded(model.replaced(Regeneration(efficiency=1.0))))
        self._of_first = (
            Scorers(robot, unloaded(first)),
            Scorers(robot, unloaded(first.replaced(Regeneration(efficiency=1.0)))),
        )

    def of(self, lossless: bool, first: bool) -> Scorers:
        """The scorers of the first model or of the mean; `lossless`: with all braking energy used again."""
        return (self._of_first if first else self._of_mean)[lossless]

    def stated(self, step: Step, answer: Answer) -> float:
        """Energy [J] of an answer under the first model."""
        return self.of(False, True).of(step).energy(answer.trajectory).total if self.mixed else answer.energy.total

    def between(self, step: Step, known: dict[float, Answer], durations: np.ndarray, duration: float) -> float:
        """Energy [J] of a move under the first model, linear between those of its answers at `durations` (K,) [s]."""
        k = int(np.clip(np.searchsorted(durations, duration * (1 - SAME)), 1, max(len(durations) - 1, 1)))
        ends = durations[k - 1 : k + 1].tolist()
        return float(np.interp(duration, ends, [self.stated(step, known[nearest(known, end)]) for end in ends]))

    def efforts(self, motions: Sequence[tuple[Step, Trajectory]]) -> tuple[np.ndarray, np.ndarray]:
        """The largest share (n,) of each joint's torque limit that motions use: under the first model, the others."""
        own, others = [], []
        for step, trajectory in motions:
            model = self.of(False, False).of(step).model
            scorers = [Scorer(self.robot, one) for _, one in model.weighted]
            own.append(used(trajectory, scorers[:1], self.robot.limits.effort))
            others.append(used(trajectory, scorers[1:], self.robot.limits.effort))
        return np.max(own, axis=0), np.max(others, axis=0)
