"""The dry friction up to which a saving remains."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.optimize import brentq

from energy_opt.effects import CoulombFriction
from energy_opt.power.model import PowerModel
from energy_opt.robot import Robot

MOST_FRICTION = 0.2  # largest share of the effort limits at which a break-even is sought; arms have 0.01 to 0.06
TRIALS = 8  # shares that are tried to find the first one without a saving
CLOSE = 1e-5  # tolerance of the break-even, as a share of the effort limits


def break_even(saved: Callable[[PowerModel], float], model: PowerModel, robot: Robot) -> float | None:
    """The share of the effort limits at which dry friction, added to `model`, ends a saving.

    It is sought below the first of TRIALS shares without a saving, to CLOSE.

    Args:
        saved: the saving [J] under a model. model: the model without the added friction. robot: for its effort limits.

    Returns:
        The share; None if the saving lasts up to MOST_FRICTION, or if there is none under `model` itself.
    """
    own = model.get("coulomb_friction")
    held = np.zeros(robot.n) if own is None else np.broadcast_to(own.values["tau_c"], robot.n)

    @cache
    def with_share(share: float) -> float:
        return saved(model.replaced(CoulombFriction(tau_c=held + share * robot.rated.effort)))

    if with_share(0.0) <= 0:
        return None
    low = 0.0
    for high in np.linspace(0, MOST_FRICTION, TRIALS + 1)[1:].tolist():
        if with_share(high) <= 0:
            return float(brentq(with_share, low, high, xtol=CLOSE))
        low = high
    return None


def until(share: float | None) -> str:
    """Sentence on the dry friction up to which a plan saves."""
    if share is None:
        return f"the plan saves at any dry friction up to {100 * MOST_FRICTION:g} % of the effort limits"
    return f"the plan saves as long as dry friction is below {100 * share:.2g} % of the effort limits"
