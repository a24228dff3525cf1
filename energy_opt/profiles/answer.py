"""The answer in standard moves, under one model or several: never costlier than the evenly slowed one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Planner, Result
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.plan.robust_models import SAME
from energy_opt.profiles.plan import MORE, MOST_VIAS, MovesPlanner, StandardMoves, as_result


def robust_moves(
    robust: RobustPlanner, move: Move, reference: Result, vias: int, least: int = 0
) -> tuple[Result, StandardMoves]:
    """The standard moves of `MovesPlanner.solve`, planned under all of a robust planner's models.

    Args:
        robust: the models. move: as asked. reference: the free trajectory.
        vias, least: the largest and the least number of via points.

    Returns:
        The result and the moves with energies under the first model; `kept` is a share under the models' mean. If
        no moves found are cheaper than the evenly slowed move under a model, a warning of the result says so.
    """
    planners: list[MovesPlanner] = []  # one planner: what it has built serves all weights
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


def standard_moves(
    planner: Planner, robust: RobustPlanner | None, move: Move, reference: Result, vias: int
) -> tuple[Result, StandardMoves | None]:
    """The standard moves through at most `vias` via points, in the time of `reference`.

    If they cost more than the evenly slowed move under any of the models, up to two more via points are tried. If that
    is not enough, the answer is the evenly slowed move itself, not converged, and no standard moves.

    Args:
        robust: plans them if there are several models.

    Raises:
        Infeasible: no standard moves take that time.
    """
    plain = MovesPlanner(planner)

    def find(least: int, most: int) -> tuple[Result, StandardMoves]:
        if robust is not None:
            return robust_moves(robust, move, reference, most, least)
        moves = plain.solve(move, reference, most, least)
        return as_result(reference, moves), moves

    result, moves = find(0, vias)
    more = 0 if move.mode == "retime" else min(vias + MORE, MOST_VIAS) - vias
    for count in range(vias + 1, vias + 1 + more):
        if not costlier(result):
            break
        try:
            result, moves = find(count, count)
        except Infeasible:
            continue
    if not costlier(result):
        said = f"--vias {vias}: these moves cost more than the evenly slowed move; --vias {moves.vias} is used"
        return (result if moves.vias <= vias else replace(result, warnings=(*result.warnings, said))), moves
    return _slowed(planner, robust, move, reference, vias + more), None


def costlier(result: Result) -> bool:
    """True if a move costs more than the evenly slowed one, under a model that it was planned with."""
    slowed = result.baseline("scaled")
    if slowed is None or not slowed.valid:
        return False
    joules = [row["saving_joules"] for row in result.models] or [slowed.energy.total - result.energy.total]
    return any(isinstance(saved, float) and saved < -SAME * abs(slowed.energy.total) for saved in joules)


def _slowed(planner: Planner, robust: RobustPlanner | None, move: Move, reference: Result, tried: int) -> Result:
    """The evenly slowed move as the answer, with a message about the moves tried."""
    slowed = reference.baseline("scaled")
    assert slowed is not None
    result = replace(
        reference,
        status="not_converged",
        chosen="scaled",
        trajectory=planner.scorer.filled(slowed.trajectory),
        energy=slowed.energy,
        certificate=planner.certify(slowed.trajectory, move),
        optimality=replace(reference.optimality, kind="local", lower_bound=None, gap_percent=None),
        message=f"no standard moves through up to {tried} via points cost less than the evenly slowed move, which is "
        "written instead",
        models=(),
        robust=None,
    )
    return result if robust is None else robust.solve_by(lambda _: result)
