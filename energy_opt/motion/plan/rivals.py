"""The models of a robust plan, and how a motion is compared under each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from energy_opt.motion.judge.energy import Energy
from energy_opt.power import PowerModel
from energy_opt.power.known import friction_range
from energy_opt.robot import Robot

SAME = 1e-9  # relative: energies that differ by less are equal


@dataclass(frozen=True)
class Rival:
    """A model with its name."""

    name: str
    model: PowerModel


def judges_of(rivals: Sequence[Rival], robot: Robot) -> list[tuple[int, Rival]]:
    """The models, then the corners of their assumed friction, each with the number of its model."""
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
    """A record of `Result.models`: a model's energies of a move and of the evenly slowed one."""
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
