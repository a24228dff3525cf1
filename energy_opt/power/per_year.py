"""What a saving is worth in a year: energy, money and carbon dioxide."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from energy_opt.errors import BadInput

J_PER_KWH = 3.6e6
MOST = 1e12  # larger numbers count as typing errors


@dataclass(frozen=True)
class PerYear:
    """How often a cycle is run, and what a kilowatt-hour costs.

    Attributes:
        cycles_per_year: how often a year.
        price: price of one kWh, in the user's currency; None if not asked for.
        co2: carbon dioxide of one kWh [kg]; None if not asked for.
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
    """One sentence for the console and the report; `found`: as `PerYear.of` gives it, `cycles`: per year."""
    if found["kwh"] is None:
        return f"in a year of {cycles:,.12g} cycles: no saving is stated"
    parts = [f"{found['kwh']:.4g} kWh"]
    parts += [] if found["money"] is None else [f"{found['money']:.2f} in money"]
    parts += [] if found["co2_kg"] is None else [f"{found['co2_kg']:.4g} kg of CO2"]
    return f"saves in a year of {cycles:,.12g} cycles: {', '.join(parts)}"
