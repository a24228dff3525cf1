"""A model of an arm, for the same arm with joints locked: per-joint lists lose the entries of joints that stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.effects import Effect
from energy_opt.errors import BadInput
from energy_opt.power.model import PowerModel, Uncertainty
from energy_opt.robot import Robot


def of_joints(model: PowerModel, robot: Robot) -> PowerModel:
    """The model with one entry per joint that moves, where its lists have one for each joint that --lock left out too.

    Raises:
        BadInput: an effect changes the links themselves, which are others where joints are locked.
    """
    whole = len(robot.unlocked)
    if whole == robot.n or not any(_long(effect, whole) for effect in model.effects):
        return model
    kept = [k for k, joint in enumerate(robot.unlocked) if joint in robot.joints]
    effects = tuple(_of(effect, kept, whole) for effect in model.effects)
    return replace(model, effects=effects, uncertainty=_uncertainty(model, kept, whole, robot))


def _long(effect: Effect, whole: int) -> list[str]:
    """Names of its parameters that have an entry for each of `whole` joints."""
    return [p.name for p in effect.parameters if p.per_joint and _axis(effect, p.name, whole) is not None]


def _axis(effect: Effect, name: str, whole: int) -> int | None:
    """Which axis of a parameter's values counts joints; None where one number means all."""
    (p,) = (p for p in effect.parameters if p.name == name)
    value = effect.values[name]
    at = value.ndim - (len(p.dimensions) - p.dimensions.index("joint"))
    return at if at >= 0 and value.shape[at] == whole else None


def _of(effect: Effect, kept: list[int], whole: int) -> Effect:
    long = _long(effect, whole)
    if long and effect.bakes:
        raise BadInput(f"effect {effect.name}: links differ where joints are locked; leave --lock or the effect out")
    values = {name: np.take(effect.values[name], kept, axis=_axis(effect, name, whole)) for name in long}
    return type(effect)(**{**effect.values, **values}, **effect.choices)


def _uncertainty(model: PowerModel, kept: list[int], whole: int, robot: Robot) -> Uncertainty | None:
    """The covariance of the numbers that are left, under their new names."""
    uncertainty = model.uncertainty
    if uncertainty is None:
        return None
    names: dict[str, str] = {}  # old to new
    for effect in model.effects:
        for name, value in effect.values.items():
            left = np.arange(value.size).reshape(value.shape)
            if name in _long(effect, whole):
                left = np.take(left, kept, axis=_axis(effect, name, whole))
            names |= {f"{effect.name}.{name}.{k}": f"{effect.name}.{name}.{i}" for i, k in enumerate(left.ravel())}
    at = [k for k, name in enumerate(uncertainty.names) if name in names]
    rivals = tuple(of_joints(rival, robot) for rival in uncertainty.rivals)
    return Uncertainty(tuple(names[uncertainty.names[k]] for k in at), uncertainty.matrix[np.ix_(at, at)], rivals)
