"""Numbers out of words of the command line."""

from __future__ import annotations

from energy_opt.errors import BadInput
from energy_opt.files import finite_number


def numbers_of(text: str, count: int, option: str, expected: str) -> tuple[float, ...]:
    """`count` finite numbers from a comma-separated word."""
    numbers = tuple(finite_number(part, f"{option} {text}", expected) for part in text.split(","))
    if len(numbers) != count:
        raise BadInput(f"{option} {text}: {len(numbers)} numbers; expected {expected}")
    return numbers
