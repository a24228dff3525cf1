"""`--cycles-per-year`, `--price`, `--co2`: what a saving is worth in a year."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from energy_opt.power.per_year import PerYear


def add_per_year(parser: argparse.ArgumentParser) -> None:
    """The options."""
    group = parser.add_argument_group("what it is worth")
    group.add_argument("--cycles-per-year", type=float, metavar="N", help="also state the saving of a year")
    group.add_argument("--price", type=float, metavar="EUR_PER_KWH", help="of a kWh, in any currency")
    group.add_argument("--co2", type=float, metavar="KG_PER_KWH", help="kg of carbon dioxide for a kWh")


def per_year_from(args: argparse.Namespace) -> PerYear | None:
    """What the options ask for; None where nothing."""
    from energy_opt.power.per_year import per_year_of

    return per_year_of(args.cycles_per_year, args.price, args.co2)
