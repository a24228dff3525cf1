"""Standard moves that hold under several models: of least mean (or largest) energy, as free trajectories are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.motion.move import Move
from energy_opt.motion.plan.planner import Planner
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.result import Result
from energy_opt.profiles.plan import MovesPlanner, StandardMoves, as_result


def robust_moves(
    robust: RobustPlanner, move: Move, reference: Result, vias: int, least: int = 0
) -> tuple[Result, StandardMoves]:
    """The standard moves of `MovesPlanner.solve`, planned under all of a robust planner's models.

    Returns:
        The result and the moves with energies under the first model; `kept` is a share under the models' mean. Where
        no moves that are found are cheaper than the evenly slowed move under a model, a warning of the result says so.
    """
    planners: list[MovesPlanner] = []  # one: what it has built serves all weights
    found: list[StandardMoves] = []

    def find(planner: Planner) -> Result:
        if not planners:
            planners.append(MovesPlanner(planner))
        found.append(planners[0].solve(move, reference, vias, least))
        return as_result(reference, found[-1])

    result = robust.solve_by(find)
    chosen = next(m for m in found if np.array_equal(m.trajectory.position, result.trajectory.position))
    moves = replace(chosen, trajectory=result.trajectory, energy=result.energy)
    return replace(result, moves=moves.document()), moves
