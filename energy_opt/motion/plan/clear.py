"""A reshaped move that keeps clear: the free optimum where its proof holds, else searches from paths that are free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.motion.move import Move
from energy_opt.motion.plan.candidates import MENDS, Made, reference_time, task_of
from energy_opt.motion.plan.context import Context, path_of
from energy_opt.motion.plan.further import LOOKED, alike, further_lines, passed, wider_optima
from energy_opt.motion.reshape.clear import Cleared, ClearSearch
from energy_opt.motion.reshape.level import Curve, Outcome, between
from energy_opt.motion.reshape.search import trajectory_of
from energy_opt.motion.reshape.task import Line, Task
from energy_opt.motion.retime.solve import RetimeSolution
from energy_opt.motion.timing.law import Timing
from energy_opt.motion.trajectory import Trajectory

WORTH = 0.05  # a free optimum that is cheaper by this share is worth a second search
SECOND = 8  # rounds of that
TOWARDS = (0.95, 0.85, 0.7, 0.5)  # shares of the way from the first path to the free optimum
SHORT, NEARLY = 8, 0.05  # rounds from there; they end where no more than this share of what may be won is left
LEFT = 0.12  # and nothing else is tried where no more than this one is
TRIAL = 4  # rounds of each of several searches: they win four fifths of what all rounds do
PROMISING, FURTHER = 0.1, 2  # of the cost: searches so near the best then go on, so many at most
CAREFUL = 0.06  # [rad] that a round goes at most where bolder ones led to nothing
LESSER = 2  # other optima that are begun from
TARGETS = 2  # optima that it is half-way gone to, one after the other
TOUCHED = 0.3  # of the places looked at: an optimum that touches at more is not begun from
ENOUGH = 0.02  # of the cost: where the free optimum is cheaper by no more, further ways have nothing to offer
LITTLE = 0.25  # of the loss of the first path slowed evenly: where no more is saved, another way is looked for
NOTHING = "reshaping found nothing that keeps clear and is better than the path as it is"


def kept_clear(
    context: Context, move: Move, timing: Timing | None, retimed: RetimeSolution | None, free: Made,
    warm: Sequence[Trajectory],
) -> Made:  # fmt: skip
    """The reshaped move of least objective that is proven to keep clear.

    Args:
        free: what reshaping found without regard to what stands around; the answer where its proof holds.
    """
    if context.cell is None:
        return free
    wider = wider_optima(context, move, timing, retimed, free) if context.settings.ways else free
    if wider.trajectory is not None and _proven(context, wider.trajectory):
        return wider
    proven = wider is not free and free.trajectory is not None and _proven(context, free.trajectory)
    free_time = context.settings.objective == "time"
    reference = reference_time(context, move, timing)
    task = task_of(context, move, reference, None if free_time else move.duration)
    search = ClearSearch(context.cell, context.robot.joints)
    level = context.reshaper(context.settings.objective).fine(task.vias)
    best = Cleared(free.outcome if proven else None, wider.iterations)
    curves = [
        task.curve(level.shape, line) for line in _lines(context, move, retimed, timing, warm, task, 2 * reference)
    ]
    near, least, most = _towards(context, search, task, curves[-1], free.outcome)
    if near is not None and not proven:
        best.join(search.run(level, task, near, context.stopped, SHORT, least + NEARLY * (most - least)))
    if best.best is None or task.cost(best.best) > least + LEFT * (most - least):
        _searched(context, search, task, best, curves, free)
    if _little(context, timing, best) and not context.stopped():
        for way in context.further():
            curve = task.curve(level.shape, passed(way, curves[-1].duration))
            best.join(search.run(level, task, curve, context.stopped))
    bound = -np.inf if wider.outcome is None else task.cost(wider.outcome)
    if context.settings.ways and (best.best is None or task.cost(best.best) > (1 + ENOUGH) * bound):
        _further(context, search, task, best, curves[-1], wider)
    if best.best is None:
        return Made(None, best.iterations, True, NOTHING, free.starts)
    made = mended_clear(context, search, task, best.best)
    trajectory = made.trajectory
    if trajectory is not None and free_time and move.duration is not None and trajectory.duration <= move.duration:
        assert made.outcome is not None
        trajectory = trajectory_of(replace(made.outcome.curve, duration=move.duration), context.robot.joints)
    return replace(made, trajectory=trajectory, iterations=best.iterations + made.iterations, starts=free.starts)


def _little(context: Context, timing: Timing | None, best: Cleared) -> bool:
    """Whether so little of the first path's loss is saved that another way is worth its time."""
    if best.best is None:
        return True
    curve = best.best.curve
    if timing is None or timing.duration > curve.duration:
        return False
    joints = context.robot.joints
    scaled, found = timing.slowed(curve.duration).trajectory(joints), trajectory_of(curve, joints)
    return context.scorer.energy(found).loss > (1 - LITTLE) * context.scorer.energy(scaled).loss


def _towards(
    context: Context, search: ClearSearch, task: Task, first: Curve, free: Outcome | None
) -> tuple[Curve | None, float, float]:
    """The curve that lies farthest from `first` on the way to the free optimum and is proven; and the costs of both.

    Where an arm's own body alone is in the way, the free optimum is touched by little, and nearly all of what it saves
    is had without a search from afar.
    """
    if free is None or free.curve.shape is not first.shape:
        return None, 0.0, 0.0
    level = context.reshaper(context.settings.objective).fine(task.vias)
    cost, _ = level.excess(first, task.parameters, task.limits)
    least = task.cost(free)
    most = max(cost - task.offset * first.duration, least)
    wanted = context.cell.wanted(np.stack([task.ends.start, task.ends.goal])) if context.cell is not None else None
    for share in TOWARDS:
        points = (1 - share) * first.points + share * free.curve.points
        curve = replace(first, points=points, duration=(1 - share) * first.duration + share * free.curve.duration)
        if wanted is not None and search.proof(curve, wanted).proven:
            return curve, least, most
    return None, least, most


def _searched(
    context: Context, search: ClearSearch, task: Task, best: Cleared, curves: Sequence[Curve], free: Made
) -> None:
    """What searches come to: from the move's own first path, the last of `curves`, from others, and from near optima.

    Of several curves, a few rounds tell which are worth going on with besides the move's own.
    """
    level, stopped = context.reshaper(context.settings.objective).fine(task.vias), context.stopped
    descents = [search.begin(level, task, curve) for curve in curves]
    if len(descents) > 1:
        for descent in descents:
            descent.go(stopped, TRIAL)
    cheapest = min(descent.cost for descent in descents)
    good = sorted((d for d in descents if d.cost <= cheapest + PROMISING * abs(cheapest)), key=lambda d: d.cost)
    for descent in dict.fromkeys([descents[-1], *good[:FURTHER]]):
        descent.go(stopped)
        descent.finish(stopped)
    for descent in descents:
        best.join(descent.found)
    if best.best is None and not stopped():
        best.join(search.run(level, task, curves[-1], stopped, trust=CAREFUL))
    others = [] if context.looked_for else _lesser(context, search, task, best, free)  # enough time was spent by then
    _again(context, search, task, best, [free.outcome, *others])


def _lesser(context: Context, search: ClearSearch, task: Task, best: Cleared, free: Made) -> list[Outcome]:
    """Searches from the other optima without regard to anything: one may be free as it is, or touch by little only.

    Those that touch by more are returned.
    """
    left: list[Outcome] = []
    reshaper, stopped = context.reshaper(context.settings.objective), context.stopped
    level = reshaper.fine(task.vias)
    wanted = search.cell.wanted(np.stack([task.ends.start, task.ends.goal]))
    u = np.linspace(0, 1, LOOKED)
    for optimum in free.optima[: LESSER + 1]:
        most = np.inf if best.best is None else task.cost(best.best)
        if stopped() or task.cost(optimum) > (1 - WORTH) * most:
            break
        if free.outcome is not None and alike(optimum.curve, free.outcome.curve):
            continue
        outcome, spent = reshaper.refined(task, [optimum], stopped)
        best.iterations += spent
        if outcome is None:
            continue
        if search.proof(outcome.curve, wanted).proven:
            best.take(outcome)
            continue
        if sum(search.cell.touching(q) is not None for q in outcome.curve.position(u)) > TOUCHED * LOOKED:
            left.append(outcome)
            continue
        descent = search.begin(level, task, outcome.curve)
        descent.go(stopped, TRIAL)
        if descent.cost <= (1 + PROMISING) * most and descent.found.best is not None:
            descent.go(stopped)
            descent.finish(stopped)
        best.join(descent.found)
    return left


def _further(context: Context, search: ClearSearch, task: Task, best: Cleared, first: Curve, free: Made) -> None:
    """Searches from further ways, which are asked for; what is there already is gone on with, so that it only gains."""
    level, stopped = context.reshaper(context.settings.objective).fine(task.vias), context.stopped
    before = best.best
    optima = [free.outcome, *_lesser(context, search, task, best, free)]
    known = [first, *(outcome.curve for outcome in (free.outcome, before, *free.optima) if outcome is not None)]
    for line in further_lines(context, search.cell, task, level, known):
        if stopped():
            break
        descent = search.begin(level, task, task.curve(level.shape, line))
        descent.go(stopped, SECOND)
        if best.best is None or descent.found.best is None or descent.cost <= (1 + PROMISING) * task.cost(best.best):
            descent.go(stopped)
            descent.finish(stopped)
        best.join(descent.found)
    if best.best is not before:
        _again(context, search, task, best, optima)


def _again(
    context: Context, search: ClearSearch, task: Task, best: Cleared, optima: Sequence[Outcome | None]
) -> None:  # fmt: skip
    """Searches from half-way to optima without regard to anything, where they are much cheaper, until one wins.

    It may be another valley that the way there leads to.
    """
    level, stopped, here = context.reshaper(context.settings.objective).fine(task.vias), context.stopped, best.best
    for free in [optimum for optimum in optima if optimum is not None][:TARGETS]:
        if here is None or here is not best.best or stopped() or here.curve.shape is not free.curve.shape:
            return
        if task.cost(here) - task.cost(free) < WORTH * task.cost(here):
            continue
        descent = search.begin(level, task, between(here.curve, free.curve, 0.5))
        descent.go(stopped, SECOND)
        if descent.cost < task.cost(here):
            descent.go(stopped)
        descent.finish(stopped)
        best.join(descent.found)


def mended_clear(context: Context, search: ClearSearch, task: Task, outcome: Outcome) -> Made:
    """A curve that keeps clear, within limits by the judge too: polished under tighter ones where it breaks one."""
    limits, spent = task.limits, 0
    level = context.reshaper(context.settings.objective).fine(task.vias)
    for _ in range(MENDS):
        trajectory = trajectory_of(outcome.curve, context.robot.joints)
        certificate = context.judge(trajectory).within
        if certificate.valid:
            return Made(trajectory, spent, outcome=outcome)
        limits = certificate.tightened(limits)
        again = search.polished(level, replace(task, limits=limits), outcome)
        spent += again.iterations
        if again.best is None:
            break
        outcome = again.best
    return Made(None, spent, True, NOTHING)


def _lines(
    context: Context, move: Move, retimed: RetimeSolution | None, timing: Timing | None,
    warm: Sequence[Trajectory], task: Task, reference: float,
) -> list[Line]:  # fmt: skip
    """First curves: what was handed in where it is proven, and, last, the first path in its timing of least energy."""
    lines = [Line.of(t) for t in (*warm, *([move.input] if move.input else [])) if _proven(context, t)]
    if retimed is not None:
        lines.append(Line.of(retimed.trajectory))
    elif timing is not None:
        duration = float(np.clip(timing.duration, *task.durations))
        lines.append(Line.of(timing.slowed(duration).trajectory(context.robot.joints)))
    else:
        lines.append(passed(path_of(move), reference))
    return lines


def _proven(context: Context, trajectory: Trajectory) -> bool:
    clearance = context.judge(trajectory).clearance
    return clearance is None or clearance.proven
