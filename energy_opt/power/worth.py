"""Value of a saving: the dry friction up to which it remains; energy, money and carbon dioxide per year."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.optimize import brentq

from energy_opt.effects import CoulombFriction
from energy_opt.errors import BadInput
from energy_opt.power.model import PowerModel
from energy_opt.robot import Robot

MOST_FRICTION = 0.2  # largest share of the effort limits at which a break-even is sought; arms have 0.01 to 0.06
TRIALS = 8  # shares that are tried to find the first one without a saving
CLOSE = 1e-5  # tolerance of the break-even, as a share of the effort limits


def break_even(saved: Callable[[PowerModel], float], model: PowerModel, robot: Robot) -> float | None:
    """The share of the effort limits at which dry friction, added to `model`, ends a saving.

    It is sought below the first of TRIALS shares without a saving, to CLOSE.

    Args:
        saved: the saving [J] under a model. model: the model without the added friction. robot: for its effort limits.

    Returns:
        The share; None if the saving lasts up to MOST_FRICTION, or if there is none under `model` itself.
    """
    own = model.get("coulomb_friction")
    held = np.zeros(robot.n) if own is None else np.broadcast_to(own.values["tau_c"], robot.n)

    @cache
    def with_share(share: float) -> float:
        return saved(model.replaced(CoulombFriction(tau_c=held + share * robot.rated.effort)))

    if with_share(0.0) <= 0:
        return None
    low = 0.0
    for high in np.linspace(0, MOST_FRICTION, TRIALS + 1)[1:].tolist():
        if with_share(high) <= 0:
            return float(brentq(with_share, low, high, xtol=CLOSE))
        low = high
    return None


def until(share: float | None) -> str:
    """Sentence on the dry friction up to which a plan saves."""
    if share is None:
        return f"the plan saves at any dry friction up to {100 * MOST_FRICTION:g} % of the effort limits"
    return f"the plan saves as long as dry friction is below {100 * share:.2g} % of the effort limits"


J_PER_KWH = 3.6e6
MOST = 1e12  # larger numbers count as typing errors


@dataclass(frozen=True)
class PerYear:
    """How often a cycle is run, and what a kilowatt-hour costs.

    Attributes:
        cycles_per_year: how often a year.
        price: money for a kWh, in the user's currency; None where it does not matter.
        co2: kg of carbon dioxide for a kWh; None where it does not matter.
    """

    cycles_per_year: float
    price: float | None = None
    co2: float | None = None

    def __post_init__(self) -> None:
        known = {"--cycles-per-year": self.cycles_per_year, "--price": self.price, "--co2": self.co2}
        for option, value in known.items():
            if value is not None and not 0 <= value <= MOST:
                raise BadInput(f"{option} {value:g}: expected a number from 0 to {MOST:g}")

    def of(self, joules: float | None) -> dict[str, float | None]:
        """`kwh`, `money` and `co2_kg` per year for a saving [J] per cycle; None if unknown."""
        kwh = None if joules is None else joules * self.cycles_per_year / J_PER_KWH
        return {
            "kwh": kwh,
            "money": None if kwh is None or self.price is None else kwh * self.price,
            "co2_kg": None if kwh is None or self.co2 is None else kwh * self.co2,
        }

    def document(self) -> dict[str, float | None]:
        """Content of a request's document."""
        return {"cycles_per_year": self.cycles_per_year, "price": self.price, "co2": self.co2}


def per_year_of(cycles: float | None, price: float | None, co2: float | None) -> PerYear | None:
    """`PerYear` from the options; None if none is given.

    Raises:
        BadInput: a price or carbon dioxide of a kWh without the number of cycles, or a number below 0.
    """
    if cycles is None:
        for option, value in (("--price", price), ("--co2", co2)):
            if value is not None:
                raise BadInput(f"{option} {value:g}: belongs to --cycles-per-year; give it, too")
        return None
    return PerYear(cycles, price, co2)


def per_year_words(found: Mapping[str, Any], cycles: float) -> str:
    """One sentence for the console and the report."""
    if found["kwh"] is None:
        return f"in a year of {cycles:,.12g} cycles: no saving is stated"
    parts = [f"{found['kwh']:.4g} kWh"]
    parts += [] if found["money"] is None else [f"{found['money']:.2f} in money"]
    parts += [] if found["co2_kg"] is None else [f"{found['co2_kg']:.4g} kg of CO2"]
    return f"saves in a year of {cycles:,.12g} cycles: {', '.join(parts)}"
