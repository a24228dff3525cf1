"""Rest of single joints in a plan under several models: it must not cost too much under any of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from energy_opt.effects.parameter import RESTING_SPEED
from energy_opt.motion.move import Move
from energy_opt.motion.plan.planner import Planner
from energy_opt.motion.plan.robust_models import exceeds
from energy_opt.motion.plan.standing import holds, let_rest
from energy_opt.motion.trajectory import Trajectory


def rested(
    planner: Planner, move: Move, motion: Trajectory, most: np.ndarray,
    totals: Callable[[Trajectory], np.ndarray], value: Callable[[np.ndarray], float],
    overloads: Callable[[Trajectory], bool], stopped: Callable[[], bool],
) -> Trajectory:  # fmt: skip
    """A reshaped motion, or a better one in which single joints rest before and after their moves.

    Args:
        planner: of the models' mean, whose energies estimate where rest pays.
        most: energies (K,) [J] under all models, as of the evenly slowed move; a changed motion takes no more than
            these, or than the given one.
        totals: energies (K,) [J] of a motion under all models. value: of these, what is minimised [J].
        overloads: whether a motion breaks a torque limit under another model.
    """
    moves = np.abs(motion.velocity[[0, -1]]).max() > RESTING_SPEED
    if planner.settings.objective != "energy" or move.mode == "retime" or moves or not holds(planner.model):
        return motion
    own, judge = totals(motion), planner.single(move).context.judge
    best, least, most = motion, value(own), np.maximum(own, most)

    def accepted(changed: Trajectory) -> bool:
        nonlocal best, least
        found = totals(changed)
        more = any(map(exceeds, found.tolist(), most.tolist()))
        if value(found) >= least or more or overloads(changed) or not judge(changed).certificate.valid:
            return False
        best, least = changed, value(found)
        return True

    let_rest(planner.scorer, planner.limits(move), motion, planner.score(motion).loss, accepted, stopped)
    return best
