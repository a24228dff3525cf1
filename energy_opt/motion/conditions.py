"""Conditions on a motion, parsed from the options --keep and --tube."""

from __future__ import annotations

import numpy as np

from energy_opt.errors import BadInput

KEEP = {"upright": (5.0, "deg", 180.0), "orientation": (2.0, "deg", 180.0), "line": (1.0, "mm", np.inf)}
"""What can be kept: how nearly where nothing is said, its unit, and what the bound must be below."""

TUBE_BELOW = 100.0  # [rad, m] a wider tube is probably in the wrong unit


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
