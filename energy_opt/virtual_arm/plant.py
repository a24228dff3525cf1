"""The plant of a virtual arm: a power model that defines the true effects, and specials that the library does not know.

Specials test that `diagnose` reports unknown effects. A plant file lists them in [[special]] tables. Per-joint
parameters take one number or one per joint.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import read_toml
from energy_opt.power import PowerModel
from energy_opt.power.model import model_from_document
from energy_opt.schema import Number, Table, parse, reads


def _per_joint(value: Any) -> Any:
    """One number, or one for each joint as an array."""
    numbers = np.asarray(value, dtype=float) if np.asarray(value).dtype.kind in "if" else np.array(np.nan)
    if not np.isfinite(numbers).all():
        raise BadInput("expected a finite number or a list of them")
    return numbers if numbers.ndim else float(numbers)


PerJoint = Annotated[Any, reads(_per_joint)]


class Special(Table):
    """Base of the specials; each adds to the motor torque of joints or to the arm's power."""

    name: ClassVar[str] = ""

    def added_torque(self, q: np.ndarray, v: np.ndarray, travel: np.ndarray) -> np.ndarray | float:
        """Added motor torque, N m; q, v (n,), `travel` (n,) is the travel since each joint last reversed, rad."""
        return 0.0

    def added_power(self, t: np.ndarray) -> np.ndarray | float:
        """Added power (N,) [W] at the set times t (N,) [s]."""
        return 0.0


class Cogging(Special):
    """A torque amplitude * sin(periods * q + phase) on the joint, which the motor must hold; [N m], [1], [rad]."""

    amplitude: PerJoint
    periods: PerJoint = 9.0
    phase: PerJoint = 0.2
    name: ClassVar[str] = "cogging"

    def added_torque(self, q: np.ndarray, v: np.ndarray, travel: np.ndarray) -> np.ndarray:
        """-A sin(k q + phase), (n,) [N m]."""
        return -self.amplitude * np.sin(self.periods * q + self.phase)


class SpeedRipple(Special):
    """amplitude * sin(2 pi v / period): torque that oscillates with speed, as resonances do; [N m], [rad/s]."""

    amplitude: PerJoint
    period: PerJoint = 0.35
    name: ClassVar[str] = "speed_ripple"

    def added_torque(self, q: np.ndarray, v: np.ndarray, travel: np.ndarray) -> np.ndarray:
        """A sin(2 pi v / period), (n,) [N m]."""
        return self.amplitude * np.sin(2 * np.pi * v / self.period)


class Backlash(Special):
    """After a joint has reversed, the drive closes its play: extra torque that fades over `gap` rad of travel.

    amplitude * exp(-travel / gap) * tanh(v / 0.01 rad/s), per joint [N m], [rad].
    """

    amplitude: PerJoint
    gap: PerJoint = 0.05
    name: ClassVar[str] = "backlash"

    def added_torque(self, q: np.ndarray, v: np.ndarray, travel: np.ndarray) -> np.ndarray:
        """A exp(-travel / gap) tanh(v / 0.01), (n,) [N m]; travel (n,) [rad] since the last reversal."""
        return self.amplitude * np.exp(-travel / self.gap) * np.tanh(v / 0.01)


class Fan(Special):
    """A fan that draws `power` [W] for the first `duty` of every `period` s."""

    power: Number
    period: Number = 7.0
    duty: Number = 0.5
    offset: Number = 0.0
    name: ClassVar[str] = "fan"

    def added_power(self, t: np.ndarray) -> np.ndarray:
        """The fan's power (N,) [W] at times t (N,) [s] while it is on; it is periodic in time."""
        return np.where(np.mod(t + self.offset, self.period) < self.duty * self.period, float(self.power), 0.0)


class StandbyStep(Special):
    """From set time `time` [s] on, overhead is `power` [W] higher."""

    power: Number
    time: Number = 100.0
    name: ClassVar[str] = "standby_step"

    def added_power(self, t: np.ndarray) -> np.ndarray:
        """The step's power (N,) [W] at times t (N,) [s], 0 before its time."""
        return np.where(t >= self.time, float(self.power), 0.0)


SPECIALS: dict[str, type[Special]] = {s.name: s for s in (Cogging, SpeedRipple, Backlash, Fan, StandbyStep)}


def special_from_row(row: Any, where: str) -> Special:
    """A special from a [[special]] table.

    Raises:
        BadInput: names the table and every parameter at fault.
    """
    name = row.get("name") if isinstance(row, dict) else row
    if not isinstance(name, str) or name not in SPECIALS:
        raise BadInput(f"{where}: unknown name {name!r}; known: {', '.join(SPECIALS)}")
    return parse(SPECIALS[name], {key: value for key, value in row.items() if key != "name"}, f"{where}: {name}")


def special_to_row(special: Special) -> dict[str, Any]:
    """The [[special]] table of a special."""
    return {"name": special.name, **special.model_dump()}


# Effects for which the forward simulation has laws of its own; others are refused.
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
    """The true drives of a virtual arm.

    Attributes:
        model: effects of the library with their true values.
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
                raise BadInput(
                    f"the virtual arm has no law for {effect.name}; it has one for {known}, and for [[special]] tables"
                )
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
    document = read_toml(Path(path), "model")
    records = document.pop("special", [])
    if not isinstance(records, list):
        raise BadInput(f"{path}: special is not a list of [[special]] tables")
    model = model_from_document(document, str(path))
    specials = tuple(special_from_row(row, f"{path}: [[special]] {k}") for k, row in enumerate(records, start=1))
    return Plant(model, specials)
