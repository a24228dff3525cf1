"""Models derived from other models: draws from a model's covariance, models of an arm with locked joints, and mixtures.

A draw has values that fit the data about as well as the model's own. A mixture is the weighted mean of several models'
powers, for plans that hold under more than one model. Its members differ in values (draws from a covariance) or in
effects (rivals). Payload and tilt are the first member's, so that the inverse dynamics are evaluated once. Weights are
parameters, like all values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
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
    if whole == robot.n or not any(_long(effect, whole) for effect in model.effects):
        return model
    kept = [k for k, joint in enumerate(robot.unlocked) if joint in robot.joints]
    effects = tuple(_of(effect, kept, whole) for effect in model.effects)
    return replace(model, effects=effects, uncertainty=_uncertainty(model, kept, whole, robot))


def _long(effect: Effect, whole: int) -> list[str]:
    """Names of its parameters that have an entry for each of `whole` joints."""
    return [p.name for p in effect.parameters if p.per_joint and _axis(effect, p.name, whole) is not None]


def _axis(effect: Effect, name: str, whole: int) -> int | None:
    """Axis of a parameter's values that counts joints; None if one number is for all joints."""
    (p,) = (p for p in effect.parameters if p.name == name)
    value = effect.values[name]
    at = value.ndim - (len(p.dimensions) - p.dimensions.index("joint"))
    return at if at >= 0 and value.shape[at] == whole else None


def _of(effect: Effect, kept: list[int], whole: int) -> Effect:
    """The effect with the values of the joints `kept` only."""
    long = _long(effect, whole)
    if long and effect.bakes:
        raise BadInput(
            f"effect {effect.name}: with locked joints, links are other bodies; leave --lock or the effect out"
        )
    values = {name: np.take(effect.values[name], kept, axis=_axis(effect, name, whole)) for name in long}
    return type(effect)(**{**effect.values, **values}, **effect.choices)


def _uncertainty(model: PowerModel, kept: list[int], whole: int, robot: Robot) -> Uncertainty | None:
    """The covariance of the remaining numbers, under their new names."""
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


@dataclass(frozen=True)
class Mixture(PowerModel):
    """The weighted mean of models; only for planning: files and scores use `members`.

    Attributes:
        effects: those of all members, one after the other.
        members: the models; limits apply to the first one's motor torque.
        weights: (K,) at least 0, adding up to 1.
    """

    members: tuple[PowerModel, ...] = ()
    weights: np.ndarray = field(default_factory=lambda: np.ones(0))

    @classmethod
    def of(cls, members: Sequence[PowerModel], weights: Sequence[float] | np.ndarray | None = None) -> Mixture:
        """The mean of `members` under `weights` (equal ones by default), which are scaled to add up to 1.

        Raises:
            BadInput: no member, or as many weights as members are not given, or they are negative or all zero.
        """
        count = len(members)
        w = np.ones(count) if weights is None else np.asarray(weights, dtype=float)
        if count == 0 or w.shape != (count,) or (w < 0).any() or not w.sum() > 0:
            raise BadInput(f"{count} models with weights {w.tolist()}; expected a weight above 0 for each")
        first = members[0]
        rigid = tuple(effect for effect in first.effects if effect.stage == "rigid")
        same = (first, *(_carrying(member, rigid) for member in members[1:]))
        effects = tuple(effect for member in same for effect in member.effects)
        return cls(first.robot, effects, members=same, weights=w / w.sum())

    def __post_init__(self) -> None:
        """Skip the checks: members were checked when they were built."""

    @property
    def weighted(self) -> tuple[tuple[float, PowerModel], ...]:
        """The members with their weights."""
        return tuple(zip(self.weights.tolist(), self.members, strict=True))

    def replaced(self, effect: Effect) -> Mixture:
        """The mixture of the members with this effect in place of theirs."""
        return Mixture.of([member.replaced(effect) for member in self.members], self.weights)

    def without(self, name: str) -> Mixture:
        """The mixture of the members without the effect of that name."""
        return Mixture.of([member.without(name) for member in self.members], self.weights)

    def kept(self, wanted: Callable[[Effect], bool]) -> Mixture:
        """The mixture of the members with the wanted effects only."""
        return Mixture.of([member.kept(wanted) for member in self.members], self.weights)

    def standing(self, roll: float, pitch: float) -> Mixture:
        """The mean of the members on a tilted base; see `PowerModel.standing`."""
        return Mixture.of([member.standing(roll, pitch) for member in self.members], self.weights)

    def get(self, name: str) -> Effect | None:
        """The first member's effect of that name, or None."""
        return self.members[0].get(name)

    @property
    def structure(self) -> tuple[tuple[str, ...], ...]:
        """The members' structures one after the other, each marked."""
        return tuple(form for member in self.members for form in (("member",), *member.structure))

    def values(self, joints: int) -> np.ndarray:
        """The members' values one after the other, then the weights (K,)."""
        return np.concatenate([*(member.values(joints) for member in self.members), self.weights])

    def symbols(self, joints: int) -> ca.SX:
        """A symbolic column for `values`."""
        return ca.SX.sym("p", len(self.values(joints)))

    def shares(self, joints: int, p: ca.SX) -> list[tuple[ca.SX | float, PowerModel, ca.SX]]:
        """Weight, model and values of each member, taken from the symbols p."""
        out, at = [], 0
        for k, member in enumerate(self.members):
            size = len(member.values(joints))
            out.append((p[p.numel() - len(self.members) + k], member, p[at : at + size]))
            at += size
        return out

    def constant_power(self, joints: int) -> float:
        """The weighted mean of the members' constant powers [W]."""
        return float(sum(weight * member.constant_power(joints) for weight, member in self.weighted))


def _carrying(model: PowerModel, rigid: Sequence[Effect]) -> PowerModel:
    """The model with these rigid effects and none of its own."""
    out = model.kept(lambda effect: effect.stage != "rigid")
    for effect in rigid:
        out = out.replaced(effect)
    return out
