"""Starts on the coarse problem, one after the other, until no better optimum is to be expected.

The first is the line that is given, the others are randomly bent lines. The k-th start depends on the seed and on k
alone, so that more starts go on where fewer ended.

The search ends after `FEWEST` starts if `OFTEN` of them led to the best optimum, or when the budget of starts is spent.
A better optimum that a share s of all starts leads to is missed by N starts with (1 - s)^N. A start that would stay
above the best one is given up, and one that reaches the valley of a known optimum ends there. On 60 moves of two robots
this misses the best of 32 starts by 0.3 % at most (`benchmarks/starts.py`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator

from energy_opt.motion.limits.base import box_of
from energy_opt.motion.reshape.curve import Curve, Outcome, fitted
from energy_opt.motion.reshape.task import REPAIRABLE, Level, Line, Task, at_most

log = logging.getLogger(__name__)
FEWEST, OFTEN = 10, 3  # fewest starts, and how many of them must have found the best optimum
NEAR = 0.005  # relative: coarse costs that differ by less count as equal; of free durations they include standby
BETWEEN = (0.25, 0.5, 0.75)  # shares of the way between two optima at which a ridge is looked for
# [rad] a search that is nearer to an optimum, in its valley and at nearly its cost, ends there. Without this bound, 1
# of 55 moves beside the own body takes 1.8 % more loss: a flat valley has other ends, which are clear of bodies.
ARRIVED = 1.5
SAME = 0.5  # [rad] coarse curves of equal cost that differ by less everywhere are one optimum
# Kinds of bends, used in turns: share of joints that bend, standard deviation of their amplitudes as a share of half
# a joint's range, and number of draws, of which the cheapest is the start. Some moves' best optima are found from
# bends of all joints, others' from bends of a few; about every third start of the right kind finds them.
BENDS = ((1.0, 0.8, 16), (0.4, 1.1, 4))
# The same between via points, and the standard deviation of the logarithms by which the shares of the time between them
# change: large bends there cost much, but at each other passing time the path is another one.
BENDS_WITH_VIAS, SHIFTS = ((1.0, 0.16, 4), (0.4, 0.22, 4)), 0.8
HOPELESS = 20.0  # times a bound: a bend that exceeds a limit by more, as on a tiny move, is halved
LOOKED = 100  # points of a curve that is fitted with other passing times
SMALLEST = 1e-9  # [rad] smallest bend
TOLERANCE = 2e-3  # of a coarse solve: enough to tell optima apart
ITERATIONS, TRUST = 60, 0.6  # iterations of a coarse solve, and its first step [rad, m]


@dataclass(frozen=True)
class Optima:
    """Different optima of a coarse problem, in the order found, with the starts and iterations spent.

    `enough`: no better one is to be expected. `continued`: from another duration, not from starts.
    """

    found: tuple[Outcome, ...] = ()
    starts: int = 0
    iterations: int = 0
    costs: tuple[float, ...] = ()  # of all outcomes whose excess can be repaired
    enough: bool = False
    continued: bool = False


def search(
    level: Level, task: Task, line: Line, starts: int, seed: int, stopped: Callable[[], bool],
    known: Optima = Optima(),
) -> Optima:  # fmt: skip
    """Solve from a line and from bends of it.

    Args:
        level: the coarse problem. line: the first start, of which the others are bends.
        starts: most starts in all, those of `known` included.
        seed: of the bends. stopped: True ends the search after the present start.
        known: the result of fewer starts with the same seed, which is continued.
    """
    straight, model = task.curve(level.shape, line), task.model(level)
    found, costs = list(known.found), list(known.costs)
    used, iterations, enough = known.starts, known.iterations, False
    ends: dict[bytes, Outcome] = {}  # of searches, by their first guess
    end: Outcome | None = None

    def arrived(now: Outcome) -> bool:
        nonlocal end
        end = next((optimum for optimum in found if _leads_to(level, task, now, optimum)), None)
        return end is not None

    while used < starts and not enough:
        guess = _bent(level, straight, task, seed, used - 1) if used else straight
        # with via points, most descents that end at a lower cost are above it for long, while passing times change
        rival = np.inf if task.vias else min(costs, default=np.inf)
        key, end = guess.points.tobytes() + guess.via_u.tobytes(), None
        if key in ends:  # no joint is bent in the cheapest draw
            outcome = replace(ends[key], iterations=0)
        else:
            outcome = task.descended(
                model, guess, ITERATIONS, trust=TRUST, tolerance=TOLERANCE, rival=rival, arrived=arrived
            )
            outcome = ends[key] = outcome if end is None else replace(end, iterations=outcome.iterations)
        used, iterations = used + 1, iterations + outcome.iterations
        text = "start %d of at most %d: cost %.6g, %d iterations"
        log.info(text, used, starts, task.cost(outcome), outcome.iterations, extra={"share": 0.1 + 0.4 * used / starts})
        if not any(_same(known, outcome, task) for known in found):
            found.append(outcome)
        if outcome.broken <= REPAIRABLE:
            costs.append(task.cost(outcome))
        enough = _enough(np.sort(costs), used)
        if stopped():
            break
    return Optima(tuple(found), used, iterations, tuple(costs), enough)


def followed(level: Level, task: Task, known: Optima) -> Optima:
    """Continue the optima of another duration (`known`) in the task's duration, in place of new starts."""
    model, spent = task.model(level), 0
    found: list[Outcome] = []
    for optimum in known.found:
        guess = task.within(optimum.curve)
        outcome = task.descended(model, guess, ITERATIONS, trust=TRUST, tolerance=TOLERANCE)
        spent += outcome.iterations
        if not any(_same(other, outcome, task) for other in found):
            found.append(outcome)
    costs = tuple(task.cost(outcome) for outcome in found if outcome.broken <= REPAIRABLE)
    return Optima(tuple(found), len(known.found), spent, costs, enough=True, continued=True)


def _enough(costs: np.ndarray, starts: int) -> bool:
    """True if enough starts found the least cost; `costs` (N,) of feasible outcomes, ascending."""
    found = int((costs <= costs[0] + NEAR * abs(costs[0])).sum()) if len(costs) else 0
    return starts >= FEWEST and found >= OFTEN


def _bent(level: Level, straight: Curve, task: Task, seed: int, k: int) -> Curve:
    """The cheapest of some randomly bent copies of a curve; a broken limit increases a copy's cost.

    Two successive starts bend to opposite sides. Copies pass via points, each at other times (`SHIFTS`).
    """
    side, shape = 1 - 2 * (k % 2), level.shape
    lower, upper = box_of(task.limits, shape.joints)
    kinds = BENDS_WITH_VIAS if task.vias else BENDS
    share, deviation, drawn = kinds[k // 2 % len(kinds)]
    size = side * deviation * np.clip((upper - lower) / 2, 0, np.pi)
    u = np.linspace(0, 1, shape.basis.controls)

    def bent(amplitudes: np.ndarray, shifts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Control points (C, controls, n) of copies bent by amplitudes (C, 2, n): to one side, and to both in turn.

        Also the times (C, vias) at which they pass the via points, shifted by `shifts` (C, vias + 1).
        """
        waves = np.stack([np.sin(np.pi * u) ** 2, np.sin(2 * np.pi * u) ** 3])
        before, times = _shifted(straight, task, shifts)
        points = before + np.einsum("wu,cwj->cuj", waves, amplitudes)
        if task.vias:
            points = shape.passing(points, times, task.ends.via)
        points = np.clip(points, lower, upper)
        points[:, : shape.pinned] = straight.points[: shape.pinned]
        points[:, -shape.pinned :] = straight.points[-shape.pinned :]
        return points, times

    sharp = replace(task, width=1.0)  # costs with kinks as narrow as the model has them

    def rated(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Costs of copies, more by their excess, and by how many times they exceed a limit."""
        costs, excess = level.excess(points, straight.duration, sharp)
        excess = np.maximum(0.0, excess)
        costs = costs - task.offset * straight.duration
        return costs + np.abs(costs) * excess, excess

    sizes, even, logarithms = _drawn(seed, k // 2, drawn, shape.joints, task.vias)
    amplitudes, shifts = sizes * [[1.0], [0.5]] * size * (even < share), side * SHIFTS * logarithms
    points, times = bent(amplitudes, shifts)
    costs, excess = rated(points)
    least = int(np.argmin(costs))
    chosen = slice(least, least + 1)
    best, shift, points, times, excess = (x[chosen] for x in (amplitudes, shifts, points, times, excess))
    while excess[0] > HOPELESS and np.abs(best).max() >= SMALLEST:
        best, shift = best / 2, shift / 2
        points, times = bent(best, shift)
        excess = rated(points)[1]
    return replace(straight, points=points[0], via_u=times[0])


def _shifted(curve: Curve, task: Task, shifts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Control points (C or 1, controls, n) of a curve that passes its via points at other times, and these (C, vias).

    Args:
        shifts: (C, vias + 1) logarithms by which the shares of the time before, between and after them change.
    """
    if not task.vias:
        return curve.points[None], np.zeros((len(shifts), 0))
    u, now = np.linspace(0, 1, LOOKED), np.concatenate([[0.0], curve.via_u, [1.0]])
    spans = np.diff(now) * np.exp(shifts)
    after = np.cumsum(np.pad(spans, ((0, 0), (1, 0))), axis=1) / spans.sum(axis=1, keepdims=True)
    curves = (fitted(curve.shape, u, curve.position(PchipInterpolator(x, now)(u)), task.ends, curve.duration)
              for x in after)  # fmt: skip
    return np.stack([x.points for x in curves]), after[:, 1:-1]


@lru_cache(maxsize=64)
def _drawn(seed: int, number: int, count: int, joints: int, vias: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random numbers of a pair of starts.

    Normal (count, 2, joints) and even in [0, 1) (count, 1, joints) ones of bends, normal (count, vias + 1) of shifts.
    """
    rng = np.random.default_rng([seed, number])
    pairs = [(rng.normal(size=(2, joints)), rng.random((1, joints))) for _ in range(count)]
    normal, even = (np.stack(part) for part in zip(*pairs, strict=True))
    return normal, even, rng.normal(size=(count, vias + 1))


def _same(a: Outcome, b: Outcome, task: Task) -> bool:
    """True if two coarse outcomes are one optimum."""
    if (a.broken <= REPAIRABLE) != (b.broken <= REPAIRABLE):
        return False
    near = abs(task.cost(a) - task.cost(b)) <= NEAR * abs(task.cost(a))
    return bool(near and np.abs(a.curve.points - b.curve.points).max() <= SAME)


def _leads_to(level: Level, task: Task, now: Outcome, optimum: Outcome) -> bool:
    """True if a search that is at `now` goes on to a known optimum: it costs hardly more, without a ridge between."""
    if not optimum.converged or (now.broken <= REPAIRABLE) != (optimum.broken <= REPAIRABLE):
        return False
    more, apart = task.cost(now) - task.cost(optimum), np.abs(now.curve.points - optimum.curve.points).max()
    near = 0 <= more <= NEAR * abs(task.cost(optimum)) and apart <= ARRIVED
    return bool(near and joined(level, task, now, optimum))


def valleys(level: Level, task: Task, outcomes: Iterable[Outcome]) -> Iterator[Outcome]:
    """The best outcome of every valley, the best first.

    Two outcomes are in one valley if `joined` finds no ridge between them; one that is too far outside the limits to be
    repaired is never in one valley with another that is not.

    Args:
        level, task: the problem that the outcomes (in any order) belong to.
    """
    found: list[Outcome] = []
    for outcome in sorted(outcomes, key=task.coarse_rank):
        alike = (o for o in found if (o.broken <= REPAIRABLE) == (outcome.broken <= REPAIRABLE))
        if not any(joined(level, task, known, outcome) for known in alike):
            found.append(outcome)
            yield outcome


def joined(level: Level, task: Task, a: Outcome, b: Outcome) -> bool:
    """True if the curves of two outcomes of a task lie in one valley: between them the cost is nowhere above both.

    If T is free, a bound that is exceeded by the share e raises the cost by the share e / 2: about what the longer T
    costs with which the curve keeps the bound.
    """
    ridge = max(task.cost(a), task.cost(b))
    for share in BETWEEN:
        curve = task.between(a.curve, b.curve, share)
        costs, shares = level.shares(curve.points[None], curve.duration, task)
        excess = 0.0 if task.fixed else max((float(np.max(x, initial=0.0)) - 1 for x in shares.values()), default=0.0)
        cost = float(costs[0]) - task.offset * curve.duration
        if at_most(cost, 1 + max(excess, 0.0) / 2) > ridge + NEAR * abs(ridge):
            return False
    return True
