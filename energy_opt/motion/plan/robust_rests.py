"""Rest of single joints in a plan under several models: it must not cost too much under any of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from energy_opt.effects.parameter import RESTING_SPEED
from energy_opt.motion.move import Move
from energy_opt.motion.plan.planner import Planner
from energy_opt.motion.plan.robust_models import UnderJudges
from energy_opt.motion.plan.standing import holds, let_rest
from energy_opt.motion.result import Result
from energy_opt.motion.trajectory import Trajectory


def rested(
    planner: Planner, move: Move, best: UnderJudges, judged: Callable[[Result], UnderJudges],
    rank: Callable[[UnderJudges], tuple[bool, float]], overloads: Callable[[Trajectory], bool],
    stopped: Callable[[], bool],
) -> UnderJudges:  # fmt: skip
    """The answer, or a better one in which single joints rest before and after their moves.

    Args:
        planner: of the models' mean, whose energies estimate where rest pays.
        judged: gives a result under all models. rank: orders these; the least is the best.
        overloads: whether a motion breaks a torque limit under another model.
    """
    motion, energy = best.result.trajectory, planner.settings.objective == "energy"
    moves = np.abs(motion.velocity[[0, -1]]).max() > RESTING_SPEED
    if not energy or best.result.chosen != "reshape" or move.mode == "retime" or moves or not holds(planner.model):
        return best

    def accepted(changed: Trajectory) -> bool:
        nonlocal best
        found = judged(planner.with_trajectory(best.result, move, changed))
        better = found.result.certificate.valid and rank(found) < rank(best) and not overloads(changed)
        best = replace(found, bound=best.bound) if better else best
        return better

    loss = planner.score(motion).loss
    let_rest(planner.scorer, planner.limits(move), motion, loss, accepted, stopped)
    return best
