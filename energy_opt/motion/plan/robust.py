"""Moves planned under more than one model: the mean of their energies is minimised, or the largest of them.

The mean is one program, with the mean of the models' powers as its cost. No answer may cost more than a valid evenly
slowed move under any of the models. If one does, the weight of that model is increased and the move is solved again in
the same duration, until the weight is too large. The answer is then the best mean of these motions that is valid under
all models (`blend`), or a move that is solved with a weight between. If there is none, further motions are tried before
the evenly slowed move: the best timing of the first path, the best moves of single models (first of the one under which
the answer costs too much), and a mean with these. The largest energy is minimised in the same way, by weights that move
towards the models under which the move costs most: at its minimum, a mixture of the models is minimised (the minimax
theorem, where energies are convex).

Where a model's friction is assumed, the corners of its range (`power.known.friction_range`) are held in the same way:
they are not part of the mean, but the answer costs no more than the evenly slowed move under any of them, and the
largest energy includes them. A corner under which a move costs too much takes its model's place in the next solve: it
has the same effects, so that nothing is built again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion.judge.certificate import certify_and_score
from energy_opt.motion.judge.energy import COARSER, DENSER, Scorer
from energy_opt.motion.limits.joint import Effort
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.plan.anytime import Progress
from energy_opt.motion.plan.blend import best_mean
from energy_opt.motion.plan.efforts import EFFORT_ROUNDS, HELD, smaller, used
from energy_opt.motion.plan.planner import Planner, Shares
from energy_opt.motion.plan.retimed import retimed
from energy_opt.motion.plan.robust_models import Rival, UnderJudges, exceeds, judges_of, record_of, slowed_of
from energy_opt.motion.plan.robust_rests import rested
from energy_opt.motion.plan.robust_warnings import effort_warnings, power_warnings, without_overloads
from energy_opt.motion.plan.robust_weights import Kind, next_weights
from energy_opt.motion.plan.sketch import Settled
from energy_opt.motion.reshape.open import FIXED, Open
from energy_opt.motion.result import Baseline, Optimality, Result
from energy_opt.motion.retime.solve import GLOBAL_GAP
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import Mixture, PowerModel
from energy_opt.robot import Robot

Find = Callable[[Planner, list[Trajectory]], Result]  # solves with a planner, from known motions
ROUNDS = {"mean": 4, "worst": 6}  # most solves; "mean" nearly always ends after the first
# Most solves with weights between the last two, where no mean of these motions is valid, as beside bodies: one, if its
# motion costs too much under no model. Without it, a UR5 that picks from a table moves evenly slowed.
BISECTIONS = 3


class RobustPlanner:
    """Plans moves of one robot under several models; results are stated under the first one.

    Args:
        rivals: at least one, each with its own payload, tilt and links.
        kind: "mean" or "worst" of the energies.
        settings, cell, stopped: as for `Planner`.
        planner: an existing planner of the models' mean, with its settings and cell.
    """

    def __init__(
        self,
        robot: Robot,
        rivals: Sequence[Rival],
        kind: Kind = "mean",
        settings: Settings | None = None,
        *,
        cell: Cell | None = None,
        stopped: Callable[[], bool] = bool,  # `bool()` is False, and is pickled
        planner: Planner | None = None,
    ) -> None:
        if kind not in ROUNDS:
            raise BadInput(f"--robust {kind!r}; expected mean or worst")
        self.robot, self.rivals, self.kind = robot, tuple(rivals), kind
        self._mixture = Mixture.of([rival.model for rival in rivals])
        known: dict[str, Any] = {"cell": cell, "stopped": stopped}
        self._planner = planner.under(self._mixture) if planner else Planner(robot, self._mixture, settings, **known)
        judges = judges_of(self.rivals, robot)  # each with its own payload, tilt and links
        self._judges = [judge for _, judge in judges]
        self._places = np.array([place for place, _ in judges])
        self._scorers = [Scorer(robot, judge.model) for judge in self._judges]
        self.first = self._scorers[0]  # of the model under which results are stated
        self._named = [(judge.name, s) for judge, s in zip(self._judges, self._scorers, strict=True)]
        self.stopped = stopped

    @property
    def planner(self) -> Planner:
        """The planner of the models' mean, for solves at many durations; check its answers with `costs_more`."""
        return self._planner

    def within(self, shares: Shares) -> RobustPlanner:
        """See `Planner.within`."""
        out = copy(self)
        out._planner = self._planner.within(shares)
        return out

    def costs_more(self, trajectory: Trajectory, slowed: Trajectory) -> bool:
        """Does a motion cost more than the evenly slowed one under any model, or at a corner of assumed friction?"""
        return any(exceeds(s.energy(trajectory).total, s.energy(slowed).total) for s in self._scorers)

    def compared(self, trajectory: Trajectory, slowed: Trajectory | None) -> list[dict[str, object]]:
        """Each model's energies of a motion and of the evenly slowed one: records as in `Result.models`."""
        return [
            record_of(name, scorer.energy(trajectory), None if slowed is None else scorer.energy(slowed))
            for name, scorer in self._named
        ]

    def solve(
        self, move: Move, warm: Sequence[Trajectory] = (), deadline: float | None = None, confirm: bool = True
    ) -> Result:
        """The best move found; see `Planner.solve`. `Result.models` has its energies under each model.

        Another objective than energy is minimised once, whatever the energies. The torque limits are held under every
        model, if such a move is found; else a warning says which joint exceeds its limit.
        """
        progress = Progress(self._planner.settings.deadline if deadline is None else deadline, self.stopped)
        built = self._planner.workshop.seconds
        first = answer = self._solve(move, warm, progress, confirm)
        share, (own, use) = np.ones(self.robot.n), self._efforts(first.result.trajectory)
        for _ in range(EFFORT_ROUNDS):
            if use.max() <= HELD or progress.ended():
                break
            share = smaller(share, use, own)
            try:
                found = self.within({Effort.name: share})._solve(move, warm, progress, confirm=False).result
            except Infeasible:
                break
            answer = self._beside_held(self._planner.with_trajectory(found, move, found.trajectory))
            even = self._or_evenly_slowed(move, answer)
            answer = answer if self.overloads(even.result.trajectory) else self._beside_held(even.result)
            own, use = self._efforts(answer.result.trajectory)
        best = first if use.max() > HELD else replace(answer, bound=first.bound)
        if best.result.chosen == "reshape":
            given, most = best.result.trajectory, self.totals(slowed_of(best.result))
            motion = rested(self._planner, move, given, most, self.totals, self.value, self.overloads, progress.ended)
            if motion is not given:
                best = self._answer(self._planner.with_trajectory(best.result, move, motion), best.bound)
        found = self._stated(best)
        return replace(found, solver=found.solver.whole(progress.seconds, self._planner.workshop.seconds - built))

    def _beside_held(self, result: Result) -> UnderJudges:
        """A result that holds the torque limits under every model; its baselines are valid only if they hold them."""
        others = self._named[1 : len(self.rivals)]
        return self._answer(without_overloads(self.robot, result, others, self._planner.limits()))

    def overloads(self, trajectory: Trajectory) -> bool:
        """Does a motor's torque exceed its limit under another model than the first?"""
        return bool(self._efforts(trajectory)[1].max() > HELD)

    def _efforts(self, trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray]:
        """The largest share (n,) of each joint's torque limit that a motion uses: under the first model, the others."""
        (bound,) = [limit.bound for limit in self._planner.limits() if isinstance(limit, Effort)]
        own, others = self._scorers[:1], self._scorers[1 : len(self.rivals)]
        return used(trajectory, own, bound), used(trajectory, others, bound)

    def _solve(self, move: Move, warm: Sequence[Trajectory], progress: Progress, confirm: bool) -> UnderJudges:
        if self._planner.settings.objective != "energy":
            return self._answer(self._planner.solve(move, warm, progress.left, confirm))

        def find(planner: Planner, known: list[Trajectory]) -> Result:
            if not known or self.kind == "worst":  # else weights price energy beyond the evenly slowed move's
                return planner.solve(move, [*warm, *known], progress.left, confirm)
            held = replace(move, duration=known[-1].duration, max_duration=None)
            return planner.as_ending(known[-1]).solve(held, [*warm, *known], progress.left, confirm)

        def others(best: UnderJudges) -> list[UnderJudges]:
            timed = retimed(self._planner, move, best.result, lambda m: self._solve(m, (), progress, False).result)
            out = [] if timed is None else [self._answer(timed)]
            most = best.excess() if self.kind == "mean" and best.costlier().any() else np.zeros(0)
            for number, k in enumerate(dict.fromkeys(self._places[np.argsort(-most)])):
                if progress.ended() or (number and not all(answer.costlier().any() for answer in out)):
                    break
                planner = self._planner.under(Mixture.of(self._mixture.members, np.eye(len(self.rivals))[k]))
                own = find(planner, [best.result.trajectory])
                found = self._planner.with_trajectory(best.result, move, own.trajectory)
                out.append(self._answer(replace(found, chosen=own.chosen, message=own.message)))
                blend = self._best_mean(move, [best, *out], closely=True)
                out += [] if blend is None else [blend]
            return sorted(out, key=self._rank)

        return self._or_evenly_slowed(move, self._best_answer(find, progress.ended, move), others)

    def _or_evenly_slowed(
        self, move: Move, best: UnderJudges, others: Callable[[UnderJudges], list[UnderJudges]] = lambda _: []
    ) -> UnderJudges:
        """The answer, or the evenly slowed move if that is better; for a free duration, also the fastest timing.

        Args:
            others: gives other answers, the best first, to try before the evenly slowed move.
        """
        names = ("scaled",) if move.duration is not None else ("scaled", "toppra")
        tried = (b for b in best.result.baselines if b.name in names and b.valid)
        even = ((self.value(self.totals(b.trajectory)), b) for b in tried)
        value, baseline = min(even, key=lambda found: found[0], default=(np.inf, None))
        if baseline is None or not (best.costlier().any() or exceeds(self.value(best.totals), value)):
            return best
        for answer in others(best):
            if not answer.costlier().any() and exceeds(value, self.value(answer.totals)):
                return replace(answer, bound=best.bound)
        message = best.none_cheaper([judge.name for judge in self._judges])
        found = self._planner.with_trajectory(best.result, move, baseline.trajectory)
        return self._answer(replace(found, chosen=baseline.name, message=message), best.bound)

    def sketch(self, move: Move, *, rough: bool = False) -> Trajectory:
        """A guess of the answer under the models' mean; see `Planner.sketch`."""
        return self.planner.sketch(move, rough=rough)

    def settle(self, move: Move, motion: Trajectory, open_: Open = FIXED, clear: bool = True) -> Settled:
        """See `Planner.settle`; under the models' mean."""
        return self.planner.settle(move, motion, open_, clear)

    def solve_by(self, find: Callable[[Planner], Result]) -> Result:
        """As `solve`, with `find` in place of the solve of a move; `find` gets a planner of the models' mean.

        If every motion that it finds costs more than the evenly slowed move under a model, a warning says so.
        """
        best = self._best_answer(lambda planner, _: find(planner), self.stopped)
        result = self._stated(best)
        costly = [judge.name for judge, more in zip(self._judges, best.costlier(), strict=True) if more]
        said = [f"under the model {name!r} this move takes more than the evenly slowed one" for name in costly]
        return replace(result, warnings=(*result.warnings, *said))

    def _best_answer(self, find: Find, stopped: Callable[[], bool], move: Move | None = None) -> UnderJudges:
        weights, members = np.ones(len(self.rivals)) / len(self.rivals), list(self._mixture.members)
        best: UnderJudges | None = None
        answers, weighted, bounds = list[UnderJudges](), list[np.ndarray](), list[float]()
        for number in range(ROUNDS[self.kind]):
            planner = self._planner.under(Mixture.of(members, weights))
            answer = self._answer(find(planner, [] if best is None else [best.result.trajectory]))
            answers.append(answer)
            weighted.append(weights)
            if best is None or self._rank(answer) < self._rank(best):
                best = answer
            bound = answer.result.optimality.lower_bound
            if bound is not None and (number == 0 or self.kind == "worst"):  # the largest energy is at least any mean
                bounds.append(bound)
            costlier = answer.costlier()
            # the costs of this move and the last can balance in a mean
            held = move is not None and number > 0 and (answers[-2].costlier() & ~costlier).any()
            if stopped() or (self.kind == "mean" and (held or not costlier.any())):
                break
            # power is limited under the models that are planned with: no corner takes a model's place
            places = self._places if self._planner.settings.max_power is None else self._places[: len(self.rivals)]
            weights, worst = next_weights(self.kind, weights, answer, places)
            members = [self._judges[k].model for k in worst]
        assert best is not None
        if move is not None and self.kind == "mean" and answers[0].costlier().any():
            blend = self._best_mean(move, answers)
            if blend is not None and self._rank(blend) < self._rank(best):
                best = blend
            elif blend is None and len(answers) > 1:
                best = self._between(find, stopped, best, members, weighted[-2:], answers[-2].costlier())
            if not best.result.interrupted and any(a.result.status == "solved" for a in answers):
                best = replace(best, result=replace(best.result, status="solved"))
        return replace(best, bound=max(bounds, default=None))

    def _between(
        self, find: Find, stopped: Callable[[], bool], best: UnderJudges, members: Sequence[PowerModel],
        weights: Sequence[np.ndarray], costlier: np.ndarray,
    ) -> UnderJudges:  # fmt: skip
        """The best of an answer and of solves with weights between two, found by bisection.

        Args:
            weights: with the first, the move costs too much under the models in `costlier` (K,); with the second not.
        """
        low, high = weights
        for number in range(BISECTIONS):
            if (number and not best.costlier().any()) or stopped():
                break
            middle = np.sqrt(low * high)
            answer = self._answer(find(self._planner.under(Mixture.of(members, middle)), [best.result.trajectory]))
            best = min(best, answer, key=self._rank)
            low, high = (middle, high) if (answer.costlier() & costlier).any() else (low, middle)
        return best

    def _best_mean(self, move: Move, answers: Sequence[UnderJudges], closely: bool = False) -> UnderJudges | None:
        """See `best_mean`: of the evenly slowed move and the answers; None if it is not valid."""
        result, slowed = answers[0].result, slowed_of(answers[0].result)
        if slowed is None:
            return None
        same = [a for a in answers if abs(a.result.trajectory.duration - result.trajectory.duration) <= 1e-9]
        totals = np.stack([self.totals(slowed), *(a.totals for a in same)])
        estimate = (lambda motion: self.totals(motion, COARSER)) if closely else None
        mean = best_mean([slowed, *(a.result.trajectory for a in same)], totals, len(self.rivals), estimate)
        found = None if mean is None else self._planner.with_trajectory(result, move, mean)
        return self._answer(found) if found is not None and found.certificate.valid else None

    def _answer(self, result: Result, bound: float | None = None) -> UnderJudges:
        own, slowed = result.trajectory, slowed_of(result)
        energies = [[s.energy(t) for s in self._scorers] for t in (own, slowed) if t is not None]
        return UnderJudges(result, energies[0], None if slowed is None else energies[1], bound)

    def _rank(self, answer: UnderJudges) -> tuple[bool, float]:
        return bool(answer.costlier().any()), self.value(answer.totals)

    def totals(self, motion: Trajectory | None, factor: int = DENSER) -> np.ndarray:
        """Energies (K,) [J] of a motion under all judges; infinite without a motion. `factor`: as for `Scorer`."""
        return np.array([np.inf if motion is None else scorer.energy(motion, factor).total for scorer in self._scorers])

    def value(self, totals: np.ndarray) -> float:
        """The minimised value [J] of the energies (K,) under all judges."""
        return float(totals[: len(self.rivals)].mean() if self.kind == "mean" else totals.max())

    def _stated(self, answer: UnderJudges) -> Result:
        """The result with the first model's energies, and a record for every model."""
        result, scorer = answer.result, self._scorers[0]
        records = [
            record_of(rival.name, energy, None if answer.slowed is None else answer.slowed[k])
            for k, (rival, energy) in enumerate(zip(self._judges, answer.energies, strict=True))
        ]
        several = len(self.rivals if self.kind == "mean" else self._judges) > 1
        peak, _, filled = certify_and_score(result.trajectory, scorer, ())

        def stated(baseline: Baseline) -> Baseline:
            own, energy, trajectory = certify_and_score(baseline.trajectory, scorer, ())
            return replace(baseline, trajectory=trajectory, energy=energy, peak_power=own.peak_power)

        return replace(
            result,
            trajectory=filled,
            energy=answer.energies[0],
            certificate=replace(result.certificate, peak_power=peak.peak_power),
            baselines=tuple(stated(baseline) for baseline in result.baselines),
            **(self._minimised(answer) if several else {}),
            models=tuple(records),
            warnings=(
                *result.warnings,
                *(baseline.remark for baseline in result.baselines if baseline.remark),
                *effort_warnings(self.robot, result.trajectory, self._named, self._planner.limits()),
                *power_warnings(result.trajectory, self._named, self._planner.settings.max_power),
            ),
        )

    def _minimised(self, answer: UnderJudges) -> dict[str, Any]:
        """The minimised value, that of the baselines, a lower bound and the gap; the energy itself has no bound."""
        value = self.value(answer.totals)
        bound = None if answer.bound is None else min(answer.bound, value)
        gap = None if bound is None else 100 * (value - bound) / max(abs(value), 1e-12)
        kind = "global" if gap is not None and gap <= GLOBAL_GAP else "local"
        baselines = {b.name: self.value(self.totals(b.trajectory)) for b in answer.result.baselines}
        robust = {"kind": self.kind, "total": value, "lower_bound": bound, "baselines": baselines}
        return {"robust": robust, "optimality": Optimality(kind, None, gap)}
