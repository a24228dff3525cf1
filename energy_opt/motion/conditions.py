"""Conditions on a tool's pose and on nearness to a path, in the words in which they are asked for."""

from __future__ import annotations

import re
from typing import Literal

import numpy as np

from energy_opt.errors import BadInput

KEEP = {"upright": (5.0, "deg", 180.0), "orientation": (2.0, "deg", 180.0), "line": (1.0, "mm", np.inf)}
"""What can be kept: how nearly where nothing is said, its unit, and what the bound must be below."""


def kept(words: tuple[str, ...]) -> dict[str, float]:
    """What `--keep` words ask for, with the bounds [deg or mm].

    Raises:
        BadInput: words that are none, bounds that cannot be, one thing twice.
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


def tube_of(word: str) -> tuple[float, Literal["rad", "m"]]:
    """Width and unit of a tube, which say of what it is: joints [rad] or the tool [m].

    Raises:
        BadInput: it is not of that form.
    """
    found = re.fullmatch(r"\s*([0-9.eE+-]+)\s*(rad|m)\s*", word)
    try:
        width = float(found[1]) if found else np.nan
    except ValueError:
        width = np.nan
    if found is None or not 0 < width < np.inf:
        raise BadInput(f"--tube {word}: expected a width above 0 with its unit, as in 0.1rad (joints) or 0.02m (tool)")
    return width, "rad" if found[2] == "rad" else "m"
