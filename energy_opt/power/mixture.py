"""The weighted mean of the powers of several models, for plans under more than one model.

The members differ in values (draws from a covariance) or in effects (rivals). Members with the same payload, tilt and
links share one evaluation of the inverse dynamics. Weights are parameters, like all values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from energy_opt.effects import Effect
from energy_opt.errors import BadInput
from energy_opt.power.model import PowerModel


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
        effects = tuple(effect for member in members for effect in member.effects)
        return cls(members[0].robot, effects, members=tuple(members), weights=w / w.sum())

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
        """The mean of the members on a base tilted by `roll` and `pitch` [rad]; see `PowerModel.standing`."""
        return Mixture.of([member.standing(roll, pitch) for member in self.members], self.weights)

    def get(self, name: str) -> Effect | None:
        """The first member's effect of that name, or None."""
        return self.members[0].get(name)

    @cached_property
    def _numbers(self) -> list[int]:
        """The place of each member's rigid body in `bodies`."""
        rigid = [tuple(effect for effect in member.effects if effect.stage == "rigid") for member in self.members]
        distinct = list(dict.fromkeys(rigid))
        return [distinct.index(own) for own in rigid]

    @property
    def bodies(self) -> tuple[PowerModel, ...]:
        """The first member with each payload, tilt and links."""
        return tuple(self.members[self._numbers.index(k)] for k in range(max(self._numbers) + 1))

    @property
    def structure(self) -> tuple[tuple[str, ...], ...]:
        """The members' structures one after the other, each marked with the place of its rigid body."""
        pairs = zip(self._numbers, self.members, strict=True)
        return tuple(form for k, member in pairs for form in (("member", str(k)), *member.structure))

    def values(self, joints: int) -> np.ndarray:
        """The members' values one after the other, then the weights (K,)."""
        return np.concatenate([*(member.values(joints) for member in self.members), self.weights])

    def symbols(self, joints: int) -> ca.SX:
        """A symbolic column for `values`."""
        return ca.SX.sym("p", len(self.values(joints)))

    def shares(self, joints: int, p: ca.SX) -> list[tuple[ca.SX | float, PowerModel, int, ca.SX]]:
        """Weight, model, place of the rigid body and values of each member, taken from the symbols p."""
        out, at = [], 0
        for k, member in enumerate(self.members):
            size = len(member.values(joints))
            out.append((p[p.numel() - len(self.members) + k], member, self._numbers[k], p[at : at + size]))
            at += size
        return out

    def constant_power(self, joints: int) -> float:
        """The weighted mean of the members' constant powers [W]."""
        return float(sum(weight * member.constant_power(joints) for weight, member in self.weighted))
