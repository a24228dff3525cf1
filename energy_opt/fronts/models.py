"""A front under several models: stated under the first, and at no point more costly than the evenly slowed move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from energy_opt.fronts.cycle import Cycle
from energy_opt.fronts.front import Front, Point
from energy_opt.motion import Move, Planner
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.context import path_of
from energy_opt.motion.plan.neighbour import Optimum
from energy_opt.motion.plan.robust import Rival, RobustPlanner, row_of


def models_of(planner: Planner, move: Move, front: Front, judges: Sequence[Rival]) -> list[dict[str, Any]]:
    """A record for every judge: name, total and loss [J], and the saving over the same move slowed evenly."""
    best = front.minimum
    if best is None or best.trajectory is None:
        return []
    slowed = planner.slowed(move, best.trajectory.duration)
    records = []
    for judge in judges:
        scorer = Scorer(planner.robot, judge.model)
        beside = None if slowed is None else scorer.energy(slowed)
        records.append(row_of(judge.name, scorer.energy(best.trajectory), beside))
    return records


def stated(robust: RobustPlanner, move: Move, front: Front, cycle: Cycle | None) -> Front:
    """A front computed for the mean of several models, stated under the first of them.

    A point that costs more than the evenly slowed move under any model, or at a corner of assumed friction, is solved
    again as in `optimize`.

    Args:
        robust: its `planner` computed the front.
        cycle: the cycle under the first model, if any.
    """
    planner = robust.planner
    timed, _, _ = planner.first_path(replace(move, duration=None, max_duration=None))
    fastest = planner.context(timed).fastest(path_of(timed))
    known: dict[int, Optimum] = {}

    def held(optimum: Optimum) -> Optimum:
        trajectory = optimum.trajectory
        if trajectory.duration >= fastest.duration:
            slowed = fastest.slowed(trajectory.duration).trajectory(planner.robot.joints)
            if robust.costs_more(trajectory, slowed) and robust.planner.certify(slowed, timed).valid:
                result = robust.solve(replace(move, duration=trajectory.duration, max_duration=None), [trajectory])
                return Optimum(result.trajectory, result.energy, result.status == "solved")
        return replace(optimum, trajectory=robust.first.filled(trajectory), energy=robust.first.energy(trajectory))

    def under_first(point: Point | None) -> Point | None:
        if point is None or point.optimum is None:
            return point
        if id(point.optimum) not in known:  # several points may share one optimum
            known[id(point.optimum)] = held(point.optimum)
        waiting = None if cycle is None or point.waiting is None else cycle.waiting(point.duration)
        return replace(point, optimum=known[id(point.optimum)], waiting=waiting)

    points = [found for point in front.points if (found := under_first(point)) is not None]
    minimum, quickest, in_cycle = map(under_first, (front.minimum, front.fastest, front.cycle_minimum))
    # the minimum of the mean may not be that under the first model: report the least stated energy as the minimum
    solved = [p for p in (*points, minimum, quickest) if p is not None and p.status == "solved"]
    if minimum is not None and minimum.status == "solved":
        minimum = min(solved, key=lambda point: point.total)
    if in_cycle is not None and in_cycle.status == "solved":
        known_in_cycle = [in_cycle, *(point for point in solved if point.waiting is not None)]
        in_cycle = min(known_in_cycle, key=lambda point: point.cycle_total)
    return replace(front, points=points, minimum=minimum, fastest=quickest, cycle_minimum=in_cycle)


def models_of_front(robust: RobustPlanner, move: Move, front: Front) -> list[dict[str, Any]]:
    """Each model's energies of a front's minimum and of the same move slowed evenly."""
    best = front.minimum
    if best is None or best.trajectory is None:
        return []
    return robust.compared(best.trajectory, robust.planner.slowed(move, best.trajectory.duration))
