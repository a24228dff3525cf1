"""The plant of a virtual arm: a power model that is true by decree, and specials that no model knows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import read_toml
from energy_opt.power import PowerModel
from energy_opt.power.model import model_from_document
from energy_opt.virtual_arm.specials import Special, special_from_row, special_to_row

# Effects that the forward simulation has laws of its own for; all others it would have to ignore.
PLAYED = frozenset(
    (
        *("armature", "base_tilt", "copper_loss", "coulomb_friction", "gear_efficiency", "gravity_spring"),
        *("inverter_loss", "load_friction", "meter_delay", "meter_filter", "meter_gain", "motion_power", "payload"),
        *("regeneration", "standby", "standby_drift", "stribeck_friction", "supply_efficiency", "viscous_friction"),
        *("asymmetric_friction", "dc_link", "friction_curve", "idle_hold", "iron_loss", "meter_window"),
        *("power_law_friction", "psu_loss", "winding_temperature"),
    )
)


@dataclass(frozen=True)
class Plant:
    """What a virtual arm is made of.

    Attributes:
        model: the effects of CONTRACT.md with their true values.
        specials: effects outside the library.
    """

    model: PowerModel
    specials: tuple[Special, ...] = ()

    def value(self, effect: str, parameter: str, joints: int = 0) -> np.ndarray | None:
        """A parameter's value, per-joint ones expanded to (joints,) where `joints` is given; None if absent."""
        found = self.model.get(effect)
        if found is None:
            return None
        value = found.values[parameter]
        return np.broadcast_to(value, (joints,)) if joints else value

    def number(self, effect: str, parameter: str, default: float) -> float:
        """A scalar parameter, or `default` where the plant lacks the effect."""
        value = self.value(effect, parameter)
        return default if value is None else float(value[0])

    def check(self, joints: int) -> None:
        """Raise BadInput where a per-joint list has the wrong length, or an effect cannot be played."""
        self.model.check(joints)
        for effect in self.model.effects:
            if effect.name not in PLAYED:
                known = ", ".join(sorted(PLAYED))
                raise BadInput(f"the virtual arm has no law for {effect.name}; it plays {known}, and [[special]]")
        for special in self.specials:
            for key, value in special_to_row(special).items():
                if np.ndim(value) and np.size(value) != joints:
                    raise BadInput(
                        f"special {special.name}: {key} has {np.size(value)} values; the robot has {joints} joints"
                    )

    def to_document(self) -> dict[str, Any]:
        """The plant file's content: a model file with [[special]] tables."""
        document = self.model.to_document()
        if self.specials:
            document["special"] = [special_to_row(special) for special in self.specials]
        return document


def load_plant(path: str | Path) -> Plant:
    """Read a plant file: a model file that may also hold [[special]] tables.

    Raises:
        BadInput: names the file, the table and the parameter at fault.
    """
    document = read_toml(Path(path))
    records = document.pop("special", [])
    if not isinstance(records, list):
        raise BadInput(f"{path}: special is not a list of [[special]] tables")
    model = model_from_document(document, str(path))
    specials = tuple(special_from_row(row, f"{path}: [[special]] {k}") for k, row in enumerate(records, start=1))
    return Plant(model, specials)
