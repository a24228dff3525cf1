"""Models derived from other models: draws from a model's covariance, and models of an arm with locked joints.

A draw has values that fit the data about as well as the model's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.effects import Effect
from energy_opt.errors import BadInput
from energy_opt.power.model import PowerModel, Uncertainty
from energy_opt.robot import Robot


def draws_of(model: PowerModel, count: int) -> list[PowerModel]:
    """Models with values drawn from the model's covariance C; none if it has no covariance.

    With the eigenvalues l and eigenvectors V of C, a draw is values + V sqrt(l) z with z standard normal, clipped to
    the physical bounds. Values with zero variance, such as the speeds of a curve, do not change at all.

    Args:
        model: with its covariance. count: number of draws.
    """
    uncertainty = model.uncertainty
    if uncertainty is None or not len(uncertainty.names):
        return []
    rng = np.random.default_rng(0)
    values, vectors = np.linalg.eigh(uncertainty.matrix)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    root[np.diag(uncertainty.matrix) == 0] = 0.0  # given values, e.g. a curve's speeds, stay exactly
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


def of_joints(model: PowerModel, robot: Robot) -> PowerModel:
    """The model for the joints that move, from one that also has values for joints locked by --lock.

    Raises:
        BadInput: an effect changes the links themselves; with locked joints these are other bodies.
    """
    whole = len(robot.unlocked)
    if whole == robot.n or not any(_joint_axes(effect, whole) for effect in model.effects):
        return model
    kept = [k for k, joint in enumerate(robot.unlocked) if joint in robot.joints]
    effects = tuple(of_some_joints(effect, kept, whole) for effect in model.effects)
    return replace(model, effects=effects, uncertainty=_uncertainty(model, kept, whole, robot))


def _joint_axes(effect: Effect, whole: int) -> dict[str, int]:
    """By parameter, the axis of its values that counts `whole` joints; none where one number is for all of them."""
    out = {}
    for p in (p for p in effect.parameters if p.per_joint):
        shape = effect.values[p.name].shape
        axis = len(shape) - (len(p.dimensions) - p.dimensions.index("joint"))
        if axis >= 0 and shape[axis] == whole:
            out[p.name] = axis
    return out


def of_some_joints(effect: Effect, kept: Sequence[int], whole: int) -> Effect:
    """An effect of `whole` joints with the values of the joints `kept` only.

    Raises:
        BadInput: it changes the links themselves.
    """
    axes = _joint_axes(effect, whole)
    if axes and effect.bakes:
        raise BadInput(
            f"effect {effect.name}: with locked joints, links are other bodies; leave --lock or the effect out"
        )
    values = {name: np.take(effect.values[name], kept, axis=axis) for name, axis in axes.items()}
    return type(effect)(**{**effect.values, **values}, **effect.choices)


def _uncertainty(model: PowerModel, kept: list[int], whole: int, robot: Robot) -> Uncertainty | None:
    """The covariance of the remaining numbers, under their new names."""
    uncertainty = model.uncertainty
    if uncertainty is None:
        return None
    names: dict[str, str] = {}  # old to new
    for effect in model.effects:
        axes = _joint_axes(effect, whole)
        for name, value in effect.values.items():
            left = np.arange(value.size).reshape(value.shape)
            left = np.take(left, kept, axis=axes[name]) if name in axes else left
            names |= {f"{effect.name}.{name}.{k}": f"{effect.name}.{name}.{i}" for i, k in enumerate(left.ravel())}
    at = [k for k, name in enumerate(uncertainty.names) if name in names]
    rivals = tuple(of_joints(rival, robot) for rival in uncertainty.rivals)
    return Uncertainty(tuple(names[uncertainty.names[k]] for k in at), uncertainty.matrix[np.ix_(at, at)], rivals)
