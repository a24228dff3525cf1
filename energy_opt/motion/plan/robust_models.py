"""The models of a robust plan, and how a motion is compared under each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.result import Result
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.power.known import friction_range
from energy_opt.robot import Robot

SAME = 1e-9  # relative: energies that differ by less are equal


@dataclass(frozen=True)
class Rival:
    """A model with its name; `remarks` on its use are warnings of the answer."""

    name: str
    model: PowerModel
    remarks: tuple[str, ...] = ()


def judges_of(rivals: Sequence[Rival], robot: Robot) -> list[tuple[int, Rival]]:
    """The models, then the corners of their assumed friction, each with the number of its model among `rivals`."""
    corners = [
        (k, Rival(f"{rival.name}, {name}", corner))
        for k, rival in enumerate(rivals)
        for name, corner in friction_range(rival.model, robot)
    ]
    return [*enumerate(rivals), *corners]


def exceeds(total: float, slowed: float) -> bool:
    """Is an energy above that of the evenly slowed motion by more than rounding?"""
    return total > slowed + SAME * abs(slowed)


def record_of(name: str, energy: Energy, slowed: Energy | None) -> dict[str, object]:
    """A record of `Result.models`: a model's energies [J] of a move, and what it saves against the evenly slowed one.

    Args:
        name: of the model. slowed: None if the evenly slowed move is not valid; the savings are then None, too.
    """
    share, joules = None, None
    if slowed is not None:
        joules = slowed.total - energy.total
        share = 100 * (slowed.loss - energy.loss) / slowed.loss if slowed.loss > SAME * abs(slowed.total) else None
    return {
        "name": name,
        "total": energy.total,
        "loss": energy.loss,
        "saving_loss_percent": share,
        "saving_joules": joules,
    }


def slowed_of(result: Result) -> Trajectory | None:
    """The evenly slowed move beside a result, if it is valid."""
    baseline = result.baseline("scaled")
    return None if baseline is None or not baseline.valid else baseline.trajectory


@dataclass(frozen=True)
class UnderJudges:
    """A result with the energies of the move under each judge, and of the evenly slowed move if that is valid.

    Judges are the models of the mean, then the corners of their friction's range. `bound` [J]: a lower bound, over all
    timings of the path, of the minimised value (mean of the planned models' energies, or the largest of all); None if
    unknown.
    """

    result: Result
    energies: list[Energy]
    slowed: list[Energy] | None
    bound: float | None = None

    @property
    def totals(self) -> np.ndarray:
        """(K,) J under each judge."""
        return np.array([energy.total for energy in self.energies])

    def costlier(self) -> np.ndarray:
        """(K,) True if the move costs more than the evenly slowed one."""
        if self.slowed is None:
            return np.zeros(len(self.energies), dtype=bool)
        return np.array([exceeds(e.total, s.total) for e, s in zip(self.energies, self.slowed, strict=True)])

    def excess(self) -> np.ndarray:
        """(K,) J above the evenly slowed move, which must be valid."""
        assert self.slowed is not None
        return self.totals - np.array([energy.total for energy in self.slowed])

    def none_cheaper(self, names: Sequence[str]) -> str:
        """A message beside the evenly slowed move: what this one saves, and costs more, under which of K judges."""
        message = "no other move that was found is cheaper than the evenly slowed one under every model"
        excess = self.excess() if self.costlier().any() else np.zeros(1)
        least, most = int(excess.argmin()), int(excess.argmax())
        if excess[least] >= 0:
            return message
        saves = f"one that saves {-excess[least]:.2g} J under {names[least]!r}"
        return f"{message}; {saves} takes {excess[most]:.2g} J more under {names[most]!r}"
