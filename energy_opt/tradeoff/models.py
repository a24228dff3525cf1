"""What models that a front was not made with make of its minimum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from energy_opt.motion import Move, Planner
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.robust import Rival, row_of
from energy_opt.tradeoff.front import Front


def models_of(planner: Planner, move: Move, front: Front, judges: Sequence[Rival]) -> list[dict[str, Any]]:
    """A row for every judge: name, total and loss [J], and beside the same move slowed evenly what it saves."""
    best = front.minimum
    if best is None or best.trajectory is None:
        return []
    slowed = planner.slowed(move, best.trajectory.duration)
    rows = []
    for judge in judges:
        scorer = Scorer(planner.robot, judge.model)
        beside = None if slowed is None else scorer.energy(slowed)
        rows.append(row_of(judge.name, scorer.energy(best.trajectory), beside))
    return rows
