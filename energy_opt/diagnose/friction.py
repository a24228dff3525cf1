"""A model's friction torque over speed, as numbers, and draws of it from the model's doubt."""

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


def draws_of(model: PowerModel, n: int, count: int, seed: int = 0) -> list[PowerModel]:
    """Models with values drawn from the model's covariance; none where it has none."""
    doubt = model.doubt
    if doubt is None or not len(doubt.names):
        return []
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(doubt.matrix)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    out = []
    for _ in range(count):
        moved = dict(zip(doubt.names, root @ rng.normal(size=len(doubt.names)), strict=True))
        drawn = model
        for effect in model.effects:
            given = {}
            for p in effect.parameters:
                value = effect.values[p.name].astype(float).copy()
                flat = value.ravel()
                flat += [moved.get(f"{effect.name}.{p.name}.{k}", 0.0) for k in range(flat.size)]
                given[p.name] = np.clip(value, p.lower, p.upper)
            drawn = drawn.replaced(type(effect)(**given, **effect.choices))
        out.append(drawn)
    return out
