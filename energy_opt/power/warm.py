"""The model of a warm arm: what changes with the time since switch-on has its final value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.effects import CopperLoss, Effect, Standby, StandbyDrift, ThermalViscous, ViscousFriction
from energy_opt.effects import WindingTemperature as Windings
from energy_opt.power.model import PowerModel, Uncertainty


def warmed(model: PowerModel) -> PowerModel | None:
    """The model, and its rivals, after a long time of work; None if nothing in the model changes as the arm warms.

    1 - exp(-t / time_constant) tends to 1. So `winding_temperature` becomes a factor on `copper_loss`,
    `thermal_viscous` a part of `viscous_friction`, and `standby_drift` a part of `standby`. The covariance is left out.
    """
    passing = {e.name: e.values for e in model.effects if isinstance(e, (StandbyDrift, ThermalViscous, Windings))}
    if not passing:
        return None
    out = model.kept(lambda effect: effect.name not in passing)

    def held(kind: type[Effect], name: str) -> np.ndarray:
        own = out.get(kind.name)
        return np.zeros(1) if own is None else own.values[name]

    if found := passing.get(Windings.name):
        out = out.replaced(CopperLoss(r_over_kt2=held(CopperLoss, "r_over_kt2") * (1 + found["rate"])))
    if found := passing.get(ThermalViscous.name):
        out = out.replaced(ViscousFriction(b=held(ViscousFriction, "b") + found["b"] * (1 - found["share"])))
    if found := passing.get(StandbyDrift.name):
        out = out.replaced(Standby(power=np.maximum(held(Standby, "power") + found["power"], 0.0)))
    rivals = () if model.uncertainty is None else model.uncertainty.rivals
    if not rivals:
        return out
    return replace(out, uncertainty=Uncertainty((), np.zeros((0, 0)), tuple(warmed(r) or r for r in rivals)))
