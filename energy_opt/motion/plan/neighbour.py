"""A move's optimum carried to another duration: one solve from the neighbour's curve, without starts and baselines.

Fronts of energy against duration are made of such steps. A reshaped curve is taken as it is, with the new duration, and
with the rows that bound it; a retimed path is retimed anew, which costs as little and needs no start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.move import Move
from energy_opt.motion.plan.candidates import Solve
from energy_opt.motion.plan.planner import Planner
from energy_opt.motion.reshape.level import Level, Outcome, fitted
from energy_opt.motion.reshape.search import COARSE, FEASIBLE, Reshaper, all_rows
from energy_opt.motion.timing.law import Timing
from energy_opt.motion.trajectory import Trajectory

ONLY_ONE = 1e-6  # so close to the minimum time (relative) there is no other timing of a path
TOLERANCE = 1e-4  # a step stops within about 0.2 % of the loss; the free optimum is solved to more
OPTIONS: dict[str, object] = {"mu_init": 1e-5}


@dataclass(frozen=True)
class Carried:
    """An optimum at one duration; the next step starts from `outcome` (None after retiming)."""

    trajectory: Trajectory
    energy: Energy
    converged: bool
    outcome: Outcome | None = None


class Carrier:
    """Carries the optimum of one move (its own duration is ignored) from duration to duration."""

    def __init__(self, planner: Planner, move: Move) -> None:
        self.planner, self.move = planner, replace(move, duration=None, max_duration=None)

    @cached_property
    def _fastest(self) -> Timing:
        return self.planner._fastest(self.move)

    @cached_property
    def _reshaper(self) -> Reshaper:
        return self.planner._reshaper("energy")

    @cached_property
    def _level(self) -> Level:
        vias = len(self.move.via)
        return self._reshaper.level(max(self._reshaper._fine, COARSE + 2 * vias + 4), vias)

    def at(self, duration: float, neighbour: Carried) -> Carried | None:
        """The optimum at exactly `duration` s, from a neighbour's; None where no trajectory within limits came of it.

        Raises:
            Infeasible: retiming, where `duration` is below the path's minimum time.
        """
        if self.move.mode == "retime":
            return self._retimed(duration)
        work = Solve(self.planner, replace(self.move, duration=duration), ())
        work.timing = None
        task = work._task(duration)
        known = neighbour.outcome
        if known is None:
            t = neighbour.trajectory
            vias = np.array([self._passed(t, via) for via in self.move.via])
            u = (t.time - t.time[0]) / t.duration
            guess = fitted(self._level.shape, u, t.position, task.ends, duration, vias)
        else:
            guess = replace(known.curve, duration=duration)
        outcome = self._level.solve(
            guess,
            task.ends,
            task.limits,
            task.parameters,
            task.durations,
            tolerance=TOLERANCE,
            rows=all_rows(self._level.shape, task.limits) if known is None else known.rows,
            multipliers=None if known is None else known.multipliers,
            offset=task.offset,
            options=OPTIONS,
        )
        if outcome.broken > FEASIBLE:
            return None
        best, trajectory, certificate = work._mended(self._reshaper, outcome, task)
        if not certificate.valid:
            return None
        return Carried(trajectory, self.planner.score(trajectory), best.converged, best)

    def _passed(self, trajectory: Trajectory, via: np.ndarray) -> float:
        """Where, in [0, 1] of its duration, a trajectory comes nearest to a via point."""
        k = int(np.argmin(np.abs(trajectory.position - via).sum(axis=1)))
        share = (trajectory.time[k] - trajectory.time[0]) / trajectory.duration
        return float(np.clip(share, 0.02, 0.98))

    def _retimed(self, duration: float) -> Carried | None:
        planner, shortest = self.planner, self._fastest
        if abs(duration / shortest.duration - 1) < ONLY_ONE:
            trajectory, converged = shortest.trajectory(planner.robot.joints), True
        else:
            work = Solve(planner, replace(self.move, duration=duration), ())
            work.timing = shortest
            found = work._retimed(held=work.move.mode == "retime")
            if found is None:
                return None
            trajectory, converged = found.trajectory, found.converged
        if not planner.certify(trajectory, self.move).valid:
            return None
        return Carried(trajectory, planner.score(trajectory), converged)
