"""A model's friction torque over speed, as numbers."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from energy_opt.effects import EXACT, Signals, TorqueEffect
from energy_opt.power import PowerModel


def friction_torque(model: PowerModel, n: int) -> Callable[[np.ndarray, int], np.ndarray]:
    """Torque [N m] of the model's frictions at speeds (N,) [rad/s] of a joint, unloaded and cold."""
    v = ca.SX.sym("v", n)
    zero = ca.SX.zeros(n)
    x = Signals(zero, v, zero, zero, ca.SX(0))
    total = ca.SX.zeros(n)
    for effect in model.effects:
        if isinstance(effect, TorqueEffect) and effect.dissipates:
            total += effect.torque(x, effect.named(ca.SX(ca.DM(effect.full(n))), n), EXACT)
    function = ca.Function("friction", [v], [ca.densify(total)])

    def at(speed: np.ndarray, joint: int) -> np.ndarray:
        return np.array(function(np.tile(speed, (n, 1)))).reshape(n, -1)[joint]

    return at
