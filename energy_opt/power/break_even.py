"""Up to which dry friction a motion saves energy beside another one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from energy_opt.effects import CoulombFriction
from energy_opt.power.model import PowerModel
from energy_opt.robot import Robot

MOST_FRICTION = 0.2  # share of the effort limits up to which a break-even is looked for; arms have 0.01 to 0.06
TRIALS = 8  # shares that are tried before the first one that breaks even is narrowed down
CLOSE = 1e-5  # of the effort limits: how closely


def break_even(saved: Callable[[PowerModel], float], model: PowerModel, robot: Robot) -> float | None:
    """The share of the effort limits at which dry friction, added to `model`, ends a saving.

    Args:
        saved: what is saved under a model [J].

    Returns:
        None where no share below 0.2 does, or where nothing is saved under `model` itself.
    """
    own = model.get("coulomb_friction")
    held = np.zeros(robot.n) if own is None else np.broadcast_to(own.values["tau_c"], robot.n)

    def with_share(share: float) -> float:
        return saved(model.replaced(CoulombFriction(tau_c=held + share * robot.rated.effort)))

    if with_share(0.0) <= 0:
        return None
    low = 0.0
    for high in np.linspace(0, MOST_FRICTION, TRIALS + 1)[1:].tolist():
        if with_share(high) <= 0:
            while high - low > CLOSE:
                middle = (low + high) / 2
                low, high = (middle, high) if with_share(middle) > 0 else (low, middle)
            return float(low)
        low = high
    return None


def until(share: float | None) -> str:
    """Up to what dry friction a plan saves, in words."""
    if share is None:
        return f"the plan saves at any dry friction up to {100 * MOST_FRICTION:g} % of the effort limits"
    return f"the plan saves as long as dry friction is below {100 * share:.2g} % of the effort limits"
