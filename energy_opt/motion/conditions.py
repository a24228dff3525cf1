"""Conditions on a tool's pose, in the words in which they are asked for."""

from __future__ import annotations

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
