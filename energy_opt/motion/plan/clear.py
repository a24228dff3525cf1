"""A reshaped move that keeps clear: the free optimum where its proof holds, else searches from paths that are free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.motion.move import Move
from energy_opt.motion.path import JointPath
from energy_opt.motion.plan.candidates import MENDS, Made, reference_time, task_of
from energy_opt.motion.plan.context import Context, path_of
from energy_opt.motion.reshape.clear import Cleared, ClearSearch, Descent
from energy_opt.motion.reshape.level import Curve, Outcome
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
LITTLE = 0.25  # of the loss of the first path slowed evenly: where no more is saved, another way is looked for
PASSED = 400  # points of a path that a first curve is fitted to
NOTHING = "reshaping found nothing that keeps clear and is better than the path as it is"


def kept_clear(
    context: Context, move: Move, timing: Timing | None, retimed: RetimeSolution | None, free: Made,
    warm: Sequence[Trajectory],
) -> Made:  # fmt: skip
    """The reshaped move of least objective that is proven to keep clear.

    Args:
        free: what reshaping found without regard to what stands around; the answer where its proof holds.
    """
    if context.cell is None or (free.trajectory is not None and _proven(context, free.trajectory)):
        return free
    free_time = context.settings.objective == "time"
    reference = reference_time(context, move, timing)
    task = task_of(context, move, reference, None if free_time else move.duration)
    search = ClearSearch(context.cell, context.robot.joints)
    level = context.reshaper(context.settings.objective).fine(task.vias)
    best, spent = Cleared(), free.iterations
    lines = _lines(context, move, retimed, timing, warm, task, 2 * reference)
    curves = [task.curve(level.shape, line) for line in lines]
    near, least, most = _towards(context, search, task, curves[-1 - len(context.ways)], free.outcome)
    enough = least + NEARLY * (most - least)
    for found in [] if near is None else [search.run(level, task, near, context.stopped, SHORT, enough)]:
        spent += found.iterations
        if found.best is not None:
            best.take(found.best)
    done = not context.ways and best.best is not None and task.cost(best.best) <= least + LEFT * (most - least)
    own = len(curves) - 1 - len(context.ways)
    for found in [] if done else _searched([search.begin(level, task, curve) for curve in curves], own, context):
        spent += found.iterations
        if found.best is not None:
            best.take(found.best)
    if best.best is None and not context.stopped():
        found = search.run(level, task, curves[own], context.stopped, trust=CAREFUL)
        spent += found.iterations
        if found.best is not None:
            best.take(found.best)
    if _little(context, timing, best) and not context.stopped():
        for way in context.further():
            found = search.run(level, task, task.curve(level.shape, _passed(way, lines[own].duration)), context.stopped)
            spent += found.iterations
            if found.best is not None:
                best.take(found.best)
    elif not done and best.best is not None and free.outcome is not None and not context.stopped():
        spent += _again(context, search, task, best, free.outcome)
    if best.best is None:
        return Made(None, spent, True, NOTHING, free.starts)
    made = mended_clear(context, search, task, best.best)
    trajectory = made.trajectory
    if trajectory is not None and free_time and move.duration is not None and trajectory.duration <= move.duration:
        assert made.outcome is not None
        trajectory = trajectory_of(replace(made.outcome.curve, duration=move.duration), context.robot.joints)
    return replace(made, trajectory=trajectory, iterations=spent + made.iterations, starts=free.starts)


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


def _searched(descents: Sequence[Descent], own: int, context: Context) -> list[Cleared]:
    """What searches come to: of several, a few rounds tell which are worth going on with besides the move's own."""
    if len(descents) > 1:
        for descent in descents:
            descent.go(context.stopped, TRIAL)
    least = min(descent.cost for descent in descents)
    good = sorted((d for d in descents if d.cost <= least + PROMISING * abs(least)), key=lambda d: d.cost)
    for descent in dict.fromkeys([descents[own], *good[:FURTHER]]):
        descent.go(context.stopped)
        descent.finish(context.stopped)
    return [descent.found for descent in descents]


def _again(context: Context, search: ClearSearch, task: Task, best: Cleared, free: Outcome) -> int:
    """A search from half-way to the free optimum, where that is much cheaper; the better of both is kept in `best`.

    It may be another valley that the way there leads to; the iterations spent are returned.
    """
    assert best.best is not None
    here, there = best.best, free.curve
    if task.cost(here) - task.cost(free) < WORTH * task.cost(here) or here.curve.shape is not there.shape:
        return 0
    points = (here.curve.points + there.points) / 2
    duration = (here.curve.duration + there.duration) / 2
    level = context.reshaper(context.settings.objective).fine(task.vias)
    start = replace(here.curve, points=points, duration=duration)
    found = search.run(level, task, start, context.stopped, SECOND)
    if found.best is not None:
        best.take(found.best)
    return found.iterations


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
    """First curves: what was handed in where it is proven, the first path in its timing of least energy, other ways."""
    lines = [Line.of(t) for t in (*warm, *([move.input] if move.input else [])) if _proven(context, t)]
    if retimed is not None:
        lines.append(Line.of(retimed.trajectory))
    elif timing is not None:
        duration = float(np.clip(timing.duration, *task.durations))
        lines.append(Line.of(timing.slowed(duration).trajectory(context.robot.joints)))
    else:
        lines.append(_passed(path_of(move), reference))
    return lines + [_passed(way, lines[-1].duration) for way in context.ways]


def _passed(path: JointPath, duration: float) -> Line:
    """A path passed smoothly from rest to rest."""
    u = np.linspace(0, 1, PASSED)
    return Line(u, path(u**3 * (10 - 15 * u + 6 * u**2)), duration)


def _proven(context: Context, trajectory: Trajectory) -> bool:
    clearance = context.judge(trajectory).clearance
    return clearance is None or clearance.proven
