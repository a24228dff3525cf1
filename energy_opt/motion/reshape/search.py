"""The search for a reshaped move: starts on a coarse problem, the best optima solved in full.

A coarse problem (few control points) is cheap to solve, and already has most local optima (see `starts`). If the
duration is given, the starts are solved at the next larger one of a series of durations with ratio `RUNG`. So nearby
durations share their starts, and a start can be feasible even if the move itself hardly is. If starts of another
duration nearby are known, their optima are continued instead.

But a coarse problem ranks optima badly: its loss is up to twice that of the fine problem, by different amounts, and
another duration changes the order. So the best of every valley is solved at the duration itself with more control
points, which takes hardly longer; the best of these are solved in full.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.motion.reshape.curve import Curve, Outcome, refined
from energy_opt.motion.reshape.layout import Shape
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.motion.reshape.starts import Optima, followed, joined, search, valleys
from energy_opt.motion.reshape.task import FEASIBLE, REPAIRABLE, Level, Line, Task, at_most
from energy_opt.motion.trajectory import Trajectory, row_step, whole
from energy_opt.numerics.bspline import Basis

log = logging.getLogger(__name__)
# control points and packing of starts: with 10, every tenth move's best optimum is lost
COARSE, COARSE_PACKING = 12, 0.5
ITERATIONS, FINE = 60, 1e-6  # iterations and tolerance of the full solves, before IPOPT
TRIAL, TRUST, ROUGH = 5, 0.4, 3e-3  # iterations, first step [rad, m] and tolerance for comparing optima
PER_VIA = 2  # additional control points for every via point
WIDE, MIDDLE = 10.0, 3.0  # factors of the width of kinks on the coarse problem, and for comparing optima
# Most further descents of a search that has not converged. With 3, steadily falling costs of 1 in 70 hanging arms were
# given up; with none for smooth laws, 7 of 32 moves with limits of the tool ended without convergence (tests/motion/
# test_reshape_search.py and test_tool_conditions.py hold one of each).
AGAIN = 20
NEAR_KINKS = 0.02  # [rad, m] first step of descents with kinked laws
WIDTHS, ROUGHLY = (3.0, 1.7), 20  # decreasing factors of that width before the final solve, and most iterations of each
# The same where the descent before did not converge: at kinks of power, steps shrink until a search ends far from an
# optimum (`benchmarks/restarts.py`).
WIDER = (10.0, *WIDTHS)
RUNG = 1.5  # ratio of the durations at which starts are solved
FOLLOWED = 2.3  # largest ratio of durations over which optima are continued: other valleys are the best beyond
# most valleys compared at the move's own duration, and their largest cost relative to the best
KEPT, WORTH_KEEPING = 3, 2.0
KEPT_WITH_VIAS = 8  # of curves that pass via points at different times
REFINED, WORTH_REFINING = 2, 1.03  # most of these solved in full, and their largest cost relative to the best
EXACT = 1e-6  # share of a bound: accepted excess while searching the answer

Kept = dict[float, Optima]  # results of the starts, by the duration at which they were solved


@dataclass(frozen=True)
class Answer:
    """The best outcome of a search (None if no start leads to a feasible curve), and the effort spent.

    `optima`: of different valleys, the best first, as compared. `wanted`: False if they were not worth solving in full.
    """

    best: Outcome | None
    starts: int
    iterations: int
    optima: tuple[Outcome, ...] = ()
    wanted: bool = True


class Reshaper:
    """Searches moves of one robot and model structure; levels are built when first needed.

    Args:
        nodes: the node functions, compiled or not. joints: n.
        controls: control points per joint of the answer.
        free_acceleration: the answer's end accelerations are free; else zero.
        polished: whether IPOPT continues where sequential quadratic programming has not converged.
    """

    def __init__(
        self, nodes: NodeFunctions, joints: int, controls: int, free_acceleration: bool, polished: bool = True
    ) -> None:  # fmt: skip
        self._nodes, self._joints = nodes, joints
        self._controls, self._free = controls, free_acceleration
        self._polished = polished
        self._levels: dict[Shape, Level] = {}

    def _level(self, shape: Shape) -> Level:
        if shape not in self._levels:
            self._levels[shape] = Level(shape, self._nodes)
        return self._levels[shape]

    def coarse(self, vias: int) -> Level:
        """The level on which starts are solved.

        Its end accelerations are free even if those of the fine problem are zero: few control points cannot build them
        up as quickly as many can, and the resulting loss would hide the differences between optima.
        """
        basis = Basis(min(COARSE + PER_VIA * vias, self._controls), COARSE_PACKING)
        return self._level(Shape(self._joints, basis, free_acceleration=True, vias=vias))

    def fine(self, vias: int) -> Level:
        """The level of the answer.

        Raises:
            BadInput: fewer control points than ends and via points need.
        """
        least = COARSE + PER_VIA * vias - 2
        if self._controls < least:
            raise BadInput(f"--controls {self._controls}: too few for {vias} via points; expected {least} or more")
        return self._level(Shape(self._joints, Basis(self._controls), free_acceleration=self._free, vias=vias))

    def search(
        self, task: Task, lines: Sequence[Line], starts: int, seed: int, stopped: Callable[[], bool],
        kept: Kept | None = None, worth: Callable[[Curve], bool] | None = None,
    ) -> Answer:  # fmt: skip
        """The best outcome from at most `starts` starts.

        Args:
            seed: of the bends of the first guess. stopped: True ends the search with what is known.
            lines: first guesses, at least one; the first is bent, the others are solved directly.
            kept: results for other durations of the same move; extended in place.
            worth: returns whether a curve near the best optimum is to be solved in full; if not, only the coarse optima
                are returned. None: always.
        """
        kept = {} if kept is None else kept
        optima, used, spent = self.optima(task, lines, starts, seed, stopped, kept)
        if worth and optima[0].broken <= REPAIRABLE and not worth(optima[0].curve):
            return Answer(None, used, spent, tuple(optima), False)
        best, more = self.refined(task, optima, stopped)
        return Answer(best, used, spent + more, tuple(optima))

    def outline(self, task: Task, line: Line, starts: int, seed: int, stopped: Callable[[], bool]) -> Outcome:
        """The best optimum of the coarse problem from a few starts: a quick guess of the answer; see `search`."""
        there = replace(task, width=WIDE * task.width)
        return min(search(self.coarse(task.vias), there, line, starts, seed, stopped).found, key=there.coarse_rank)

    def optima(
        self,
        task: Task,
        lines: Sequence[Line],
        starts: int,
        seed: int,
        stopped: Callable[[], bool],
        kept: Kept | None = None,
    ) -> tuple[list[Outcome], int, int]:
        """Optima of different valleys, compared on the fine level with a few iterations each.

        Args:
            lines, starts, seed, stopped, kept: see `search`.

        Returns:
            The outcomes, the most promising first, at least one; the starts used; the iterations spent.
        """
        coarse, fine = self.coarse(task.vias), self.fine(task.vias)
        there, used, spent = replace(task, width=WIDE * task.width), 0, 0
        # solve starts at the next duration of the series, so that nearby durations share them
        if task.fixed:
            there = there.lasting(float(RUNG ** np.ceil(np.log(task.durations[0]) / np.log(RUNG) - 1e-9)))
        rung = there.durations[1]
        kept = {} if kept is None else kept
        done = {duration: o for duration, o in kept.items() if o.enough or o.starts >= starts}
        if rung not in done:
            known = kept.get(rung, Optima())
            searched = any(max(d / rung, rung / d) <= FOLLOWED for d, o in done.items() if not o.continued)
            if searched and task.fixed:
                found = followed(coarse, there, done[min(done, key=lambda d: abs(np.log(d / rung)))])
            else:
                found = search(coarse, there, lines[0], starts, seed, stopped, known)
            kept[rung] = found
            used, spent = found.starts - known.starts, found.iterations - known.iterations
        # compare the best of every valley at the task's own duration, with the answer's control points
        best = min(kept[rung].found, key=there.coarse_rank)
        most = at_most(there.cost(best), WORTH_KEEPING)
        near = [o for o in kept[rung].found if o is best or (o.broken <= REPAIRABLE and there.cost(o) <= most)]
        optima = islice(valleys(coarse, there, near), KEPT_WITH_VIAS if task.vias else KEPT)
        guesses = [refined(task.within(o.curve), fine.shape, task.ends) for o in optima]
        guesses += [task.curve(fine.shape, line) for line in lines[1:]]
        compared: list[Outcome] = []
        rough = replace(task, width=MIDDLE * task.width)
        model = rough.model(fine)
        for guess in guesses:
            compared.append(rough.descended(model, guess, TRIAL, trust=TRUST, tolerance=ROUGH, stopped=stopped))
            if stopped():
                break
        iterations = spent + sum(o.iterations for o in compared)
        return sorted(compared, key=task.promise), used + len(lines) - 1, iterations

    def refined(self, task: Task, optima: Sequence[Outcome], stopped: Callable[[], bool]) -> tuple[Outcome | None, int]:
        """Solve some optima in full.

        Args:
            optima: as `optima` gives them, the most promising first.
            stopped: True ends the search with what is known.

        Returns:
            The best outcome, None if none of them leads to a curve within the limits; and the iterations spent.
        """
        best: Outcome | None = None
        level, spent, count = self.fine(task.vias), 0, 0
        for outcome in optima:
            near = task.promise(outcome) <= at_most(task.promise(optima[0]), WORTH_REFINING)
            if best is not None and not (near and count < REFINED):
                break
            if best is not None and joined(level, task, best, outcome):  # it leads to the same optimum
                continue
            log.info("refining optimum %d of %d", count + 1, len(optima), extra={"share": 0.5})
            better = self.solved(outcome.curve, task, stopped)
            spent, count = spent + better.iterations, count + 1
            if better.broken <= FEASIBLE and (best is None or better.cost < best.cost):
                best = better
            if stopped():
                break
        return best, spent

    def solved(
        self, curve: Curve, task: Task, stopped: Callable[[], bool] = lambda: False, near: bool = False
    ) -> Outcome:
        """The optimum near a curve; IPOPT polishes it if sequential quadratic programming did not converge.

        If that converged where a limit is broken, IPOPT is not asked: it found no way out in any of 45 such solves.

        Args:
            near: the curve is an optimum of nearly the same task: neither smoothed laws nor IPOPT are used.
        """
        level, spent = self._level(curve.shape), 0
        kinks = self._nodes.kinked and not near
        trust, wider = (NEAR_KINKS, WIDER) if kinks else (TRUST / 4, ())
        found = self._descended(level, task, curve, WIDTHS if kinks else (), trust, stopped)
        for _ in range(AGAIN):  # repeat until no more is saved
            if found.converged or stopped():
                break
            more = self._descended(level, task, found.curve, wider, trust if wider else trust / 4, stopped)
            spent += more.iterations
            better = min(found, more, key=task.rank)  # if it is the one before, the next descent would be the same
            settled = better is found or task.cost(found) - task.cost(more) < ROUGH * abs(task.cost(found))
            found = replace(better, converged=settled)
        found = replace(found, iterations=spent + found.iterations)
        done = found.converged or (found.broken <= FEASIBLE and (self._nodes.kinked or not self._polished))
        if stopped() or done or found.broken > REPAIRABLE or task.open.any or near:
            return found
        polished = task.polished(level, found)
        best, spent = min(polished, found, key=task.rank), found.iterations + polished.iterations
        return replace(best, iterations=spent, converged=found.converged or polished.converged)

    @staticmethod
    def _descended(
        level: Level, task: Task, curve: Curve, widths: Sequence[float], trust: float, stopped: Callable[[], bool]
    ) -> Outcome:
        """A descent from a curve with a first step `trust` [rad, m], after rough ones with these widths of kinks."""
        spent = 0
        for width in widths:
            there = replace(task, width=width * task.width)
            rough = there.descended(
                there.model(level), curve, ROUGHLY, trust=TRUST / 4, tolerance=ROUGH / 3, stopped=stopped
            )
            curve, spent = rough.curve, spent + rough.iterations
        found = task.descended(
            task.model(level), curve, ITERATIONS, trust=trust, tolerance=FINE, give=EXACT, stopped=stopped
        )
        return replace(found, iterations=spent + found.iterations)


def trajectory_of(curve: Curve, joints: tuple[str, ...]) -> Trajectory:
    """Samples at the spacing of `row_step`, and one at every knot: between samples the curve is exactly the quintic."""
    breaks = curve.shape.basis.breaks
    count = int(np.ceil(curve.duration / row_step(curve.duration)))
    parts = [max(1, int(np.ceil(width * count))) for width in np.diff(breaks)]
    spans = zip(breaks[:-1], breaks[1:], parts, strict=True)
    u = np.append(np.concatenate([np.linspace(a, b, k, endpoint=False) for a, b, k in spans]), 1.0)
    curve = replace(curve, duration=float(whole(curve.duration)))
    time = np.unique(whole(u * curve.duration))
    q, v, a, _ = curve.derivatives(time / curve.duration)
    return Trajectory(joints, time, q, v, a)
