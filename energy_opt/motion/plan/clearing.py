"""Searches of one move from several curves, which keep clear of bodies: short trials, the best of them completed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.motion.plan.candidates import Candidate
from energy_opt.motion.plan.context import Context
from energy_opt.motion.plan.further import alike
from energy_opt.motion.reshape.clear import TRUST, ClearSearch
from energy_opt.motion.reshape.curve import Curve, Outcome
from energy_opt.motion.reshape.sqp import Descent
from energy_opt.motion.reshape.task import Task
from energy_opt.motion.timing.spline_timing import Timing

OPTIMA = 3  # most optima found without bodies to start from
WORTH = 1.25  # an optimum of a larger cost relative to the least is not mixed with the first path
NEARLY = 0.0015  # [m] an optimum whose clearance is short by less is continued first
DEEP = 0.3  # [m] a start is at most this deep in a body; hopeless trials end soon
TOWARDS = (0.9, 0.75, 0.6, 0.45, 0.3)  # shares of the way from the first path to an optimum: mixtures to try
CLOSE = 0.6  # a search from a mixture with the best optimum, of at least this share of it, ends most others
BOLD = 0.25  # [rad, m] first step from such a mixture
# scaled cost with violations: a trial below it came free of bodies; a second step is tried if at most one trial does
FREED = 2.0
# Iterations of a search, and the relative change of cost at which it ends. With 30 and 4e-4, 17 moves in scenes take
# 1.6 % more loss in the mean and 22 % at worst (`benchmarks/unseen.py --scenes 17 --seed 8 --short`).
ITERATIONS, DONE = 100, 1e-4
FINISHED = 2  # most trials to continue
HOPES = (1.3, 1.1)  # largest merit relative to the best after the first and second trial, to be continued
HALF = 0.1  # share of the cost: if the optimum without bodies saves more, a search starts half-way to it
LITTLE = 0.25  # share of the loss of the first path slowed evenly: if less is saved, another initial path is looked for
HAIR = 0.0005  # [m] a mixture of two curves may miss the required clearance by this much


@dataclass(frozen=True)
class Start:
    """A curve to search from, its first step [rad, m], and a scaled cost: about the least that it can lead to, which is
    that of the optimum without bodies near it.
    """

    curve: Curve
    trust: float
    least: float = 0.0


@dataclass
class Clearing:
    """Searches of one task, and the best proven result so far; the last of `curves` is the move's own first path."""

    context: Context
    task: Task
    search: ClearSearch
    curves: Sequence[Curve]
    best: Outcome | None = None

    @classmethod
    def of(cls, context: Context, task: Task, curves: Sequence[Curve]) -> Clearing:
        """A new search, with its cost scaled by that of the first path.

        Args:
            task: the problem. curves: initial curves of the answer's shape, last the first path.
        """
        assert context.cell is not None
        level = context.reshaper(context.settings.objective).fine(task.vias)
        search = ClearSearch.scaled_by(curves[-1], context.cell, context.robot.joints, level, task, context.stopped)
        return cls(context, task, search, curves)

    @property
    def first(self) -> Curve:
        """The move's own first path."""
        return self.curves[-1]

    def search_from(self, free: Candidate) -> None:
        """Find the best result of searches from the first paths and from the optima found without bodies."""
        search, optima = self.search, self._optima(free)
        starts = [Start(curve, TRUST) for curve in self.curves if self.best is None]
        for number, optimum in enumerate(optima):
            least = search.scale * self._cost(optimum)
            if self.best is not None and least > self._scaled(self.best):
                continue
            gap = search.gap(optimum)
            if gap > -NEARLY and self.finish(optimum, TRUST):
                if number == 0:
                    return
                continue
            if gap > -DEEP:
                starts.append(Start(optimum, BOLD, least))
            mix, share = self._mixture(optimum) if self._cost(optimum) <= WORTH * self._cost(optima[0]) else (None, 0.0)
            if mix is None:
                continue
            if number == 0 and share >= CLOSE and self.finish(mix, BOLD):
                self._search_from_other_optima(optima[1:])
                return
            starts.append(Start(mix, BOLD, least))
        self.best_of(starts)
        self._half_way(optima)

    def _mixture(self, optimum: Curve) -> tuple[Curve | None, float]:
        """The curve nearest to an optimum, of mixtures of it with the first path, that keeps clear, and its share."""
        for share in TOWARDS:
            mix = self.task.between(self.first, optimum, share)
            if self.search.gap(mix) > -HAIR:
                return mix, share
        return None, 0.0

    def _search_from_other_optima(self, optima: Sequence[Curve]) -> None:
        """Search from mixtures with optima that cost much less than the best."""
        for optimum in optima:
            assert self.best is not None
            least = self.task.cost(self.best)
            mix, _ = self._mixture(optimum) if self._cost(optimum) < (1 - HALF) * least else (None, 0.0)
            if mix is None or self.context.stopped():
                continue
            trial = self.search.trial(mix, BOLD)
            if self.search.merit(trial) < self._scaled(self.best):
                self.finish(self.search.curve_of(trial), TRUST)

    def _optima(self, free: Candidate) -> list[Curve]:
        """Optima found without bodies that have the answer's shape, the best first."""
        shape, out = self.search.level.shape, list[Curve]()
        for outcome in (free.outcome, *free.optima):
            curve = None if outcome is None else outcome.curve
            if curve is not None and curve.shape is shape and not any(alike(curve, other) for other in out):
                out.append(curve)
        return out if self.task.vias else out[:OPTIMA]  # those that pass via points at other times are other starts

    def best_of(self, starts: Sequence[Start]) -> None:
        """Run a short trial from each start that may be the best, and finish the most promising ones."""
        search = self.search
        if len(starts) == 1:
            self.finish(starts[0].curve, starts[0].trust)
            return
        trials, known = list[Descent](), np.inf if self.best is None else self._scaled(self.best)
        for start in starts:
            if start.least <= known:
                trials.append(search.trial(start.curve, start.trust))
                known = min(known, search.merit(trials[-1]))
        if starts and sum(search.merit(trial) < FREED for trial in trials) < 2:
            trials.append(search.trial(starts[0].curve, BOLD))
        for trial in sorted(trials, key=search.merit)[:FINISHED]:
            if self.best is not None and self.context.stopped():
                break
            curve = self._second_start(trial)
            if curve is not None:
                self.finish(curve, TRUST)
        if self.best is None and not self.context.stopped():
            self.finish(self.first, TRUST / 3)

    def _second_start(self, trial: Descent) -> Curve | None:
        """The curve of a trial after another one where that is needed; None if it is far from the best."""
        for most in HOPES:
            merit = self.search.merit(trial)
            if self.best is None or merit < self._scaled(self.best):
                break
            if merit > most * self._scaled(self.best):
                return None
            if most is HOPES[0]:
                trial = self.search.trial(self.search.curve_of(trial), BOLD)
        return self.search.curve_of(trial)

    def finish(self, curve: Curve, trust: float, known: float | None = None) -> bool:
        """Search from a curve and keep the result if it is the best; True if it led to a proven one.

        Args:
            trust: [rad, m] first step.
            known: scaled cost above which a search is given up; by default that of the best.
        """
        if known is None:
            known = np.inf if self.best is None else self._scaled(self.best)
        found = self.search.finish(curve, ITERATIONS, trust, DONE, known)
        if found is not None and not found.converged and not self.context.stopped():
            # steps failed before it converged; from another first step, others may not
            more = self.search.finish(found.curve, ITERATIONS, TRUST / 3, DONE, self._scaled(found))
            found = found if more is None else more
        if found is not None and (self.best is None or found.cost < self.best.cost):
            self.best = found
        return found is not None

    def _cost(self, curve: Curve) -> float:
        return self.task.path_cost(self.search.level, curve)

    def _half_way(self, optima: Sequence[Curve]) -> None:
        """Search from half-way to the best optimum without bodies: this may lead to another valley."""
        if self.best is None or not optima or self.context.stopped():
            return
        least = self.task.cost(self.best)
        if least - self._cost(optima[0]) < HALF * least:
            return
        middle = self.task.between(self.best.curve, optima[0], 0.5)
        curve = self._second_start(self.search.trial(middle, BOLD))
        if curve is not None:
            self.finish(curve, TRUST)

    def _scaled(self, outcome: Outcome) -> float:
        return self.search.scale * self.task.cost(outcome)

    def is_costly(self, free: Candidate, share: float) -> bool:
        """True if bodies cost more than this share of the loss of the optimum without them (`free`), or of its time."""
        objective, judge = self.context.settings.objective, self.context.judge
        if free.outcome is None or objective not in ("energy", "time"):
            return False
        if self.best is None:
            return True
        alone, best = judge.of(free.outcome.curve).energy, judge.of(self.best.curve).energy
        if objective == "time":
            return self.best.curve.duration > (1 + share) * free.outcome.curve.duration
        return best.total > alone.total + share * alone.loss

    def search_in_full(self, free: Candidate) -> None:
        """Solve the optima without bodies (`free`) in full, and complete a search from the best.

        Trials rank starts badly where bodies are deep in the way, and what is known ends searches that pass them.
        """
        optimum, spent = self.context.reshaper("energy").refined(self.task, free.optima, self.context.stopped)
        self.search.iterations += spent
        if optimum is not None and self.search.gap(optimum.curve) > -DEEP:
            self.finish(self.search.curve_of(self.search.trial(optimum.curve, BOLD)), TRUST, np.inf)

    def little(self, timing: Timing | None) -> bool:
        """True if so little of the first path's loss is saved that another initial path is worth its time."""
        if self.best is None:
            return True
        curve = self.best.curve
        if timing is None or timing.duration > curve.duration:
            return False
        judge = self.context.judge
        return judge.of(curve).energy.loss > (1 - LITTLE) * judge.slowed(timing, curve.duration).energy.loss
