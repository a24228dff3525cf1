"""Models drawn from a model's own uncertainty: what its data leave open, as values that might as well be true."""

from __future__ import annotations

import numpy as np

from energy_opt.power.model import PowerModel


def draws_of(model: PowerModel, count: int, seed: int = 0) -> list[PowerModel]:
    """Models with values drawn from the model's covariance; none where it has none."""
    uncertainty = model.uncertainty
    if uncertainty is None or not len(uncertainty.names):
        return []
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(uncertainty.matrix)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    root[np.diag(uncertainty.matrix) == 0] = 0.0  # what is given, as a curve's speeds, stays to the last digit
    out = []
    for _ in range(count):
        moved = dict(zip(uncertainty.names, root @ rng.normal(size=len(uncertainty.names)), strict=True))
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
