"""The cache key of functions that are built from a model's structure and take its values as an argument."""

from __future__ import annotations

from dataclasses import dataclass

from energy_opt.effects import COBOT, ArmSize
from energy_opt.power.model import PowerModel
from energy_opt.robot import Robot


def size_of(robot: Robot) -> ArmSize:
    """The size of a robot's drives."""
    return ArmSize.of(robot.rated.strongest, robot.rated.power)


@dataclass(frozen=True, eq=False)
class SharedByStructure:
    """A model that equals any other of the same structure, for an arm of the same size: the cache key of functions."""

    model: PowerModel
    size: ArmSize = COBOT

    @classmethod
    def on(cls, robot: Robot, model: PowerModel) -> SharedByStructure:
        """The model on a robot."""
        return cls(model, size_of(robot))

    @property
    def _key(self) -> tuple[object, ...]:
        return self.model.structure, self.size

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SharedByStructure) and other._key == self._key
