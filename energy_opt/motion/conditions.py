"""Conditions on a motion: bounds of power and of the tool, and those that --keep and --tube state."""

from __future__ import annotations

import numpy as np

from energy_opt.errors import BadInput

KEEP = {"upright": (5.0, "deg", 180.0), "orientation": (2.0, "deg", 180.0), "line": (1.0, "mm", 1e5)}
"""What can be kept: the default bound, its unit, and the value that a bound must be below."""

BOUNDS = {
    "max_power": (0.001, 1e9, "W"), "tool_speed": (1e-6, 50.0, "m/s"), "tool_acceleration": (1e-6, 1000.0, "m/s^2"),
}  # fmt: skip
"""Settings that bound a motion: the least and the largest bound that is accepted, and its unit."""

TUBE_BELOW = 100.0  # [rad, m] a wider tube is probably in the wrong unit


def check_bound(name: str, bound: float | None) -> None:
    """Check the value of one of the settings in `BOUNDS`; None is no bound.

    Raises:
        BadInput: it is outside of the accepted range. A larger one of the tool is probably in millimetres.
    """
    least, most, unit = BOUNDS[name]
    if bound is not None and not least <= bound <= most:
        millimetres = unit != "W" and bound > most
        hint = f" (are these millimetres? {bound / 1000:g} {unit} then)" if millimetres else ""
        raise BadInput(f"--{name.replace('_', '-')} {bound:g}: expected {least:g} to {most:g} {unit}{hint}")


def kept(words: tuple[str, ...]) -> dict[str, float]:
    """The conditions of `--keep` words, with their bounds [deg or mm].

    Raises:
        BadInput: an unknown word, an impossible bound, or one condition twice.
    """
    out: dict[str, float] = {}
    for word in words:
        name, _, number = word.strip().partition(":")
        if name not in KEEP:
            raise BadInput(f"--keep {word}: expected upright[:DEG], orientation[:DEG] or line[:MM]")
        usual, unit, below = KEEP[name]
        try:
            bound = float(number) if number else usual
        except ValueError:
            bound = np.nan
        if not 0 < bound < below:
            most = f", below {below:g}" if np.isfinite(below) else ""
            raise BadInput(f"--keep {word}: {number!r} is no bound; expected {unit} above 0{most}")
        if name in out:
            raise BadInput(f"--keep {name}: given twice")
        out[name] = bound
    return out


def tube_of(word: str) -> tuple[float, str]:
    """The value of `--tube`: a bound above 0, and its unit, rad (of every joint) or m (of the tool).

    Raises:
        BadInput: anything else.
    """
    text = word.strip()
    unit = "rad" if text.endswith("rad") else "m" if text.endswith("m") else ""
    try:
        bound = float(text.removesuffix(unit)) if unit else np.nan
    except ValueError:
        bound = np.nan
    if not 0 < bound < TUBE_BELOW:
        raise BadInput(f"--tube {word}: expected a width above 0 with its unit: 0.1rad (every joint) or 0.02m (tool)")
    return bound, unit
