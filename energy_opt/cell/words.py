"""A clearance in words, the same on the console, in messages and in reports."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def clearance_words(found: Mapping[str, Any], unit: str = "s") -> str:
    """A certificate's clearance as text: the proven and the measured value. `unit`: of the time of contact.

    >>> clearance_words({"verdict": "proven", "lower_bound": 0.0022, "min_distance": 0.056, "pair": ["A", "B"]})
    'clearance proven ≥ 2.2 mm (nearest measured 56 mm: A–B)'
    """
    pair = "–".join(found.get("pair") or ())
    measured = found.get("min_distance")
    if found["verdict"] == "proven":
        near = "no pair is near" if measured is None else f"nearest measured {length(measured)}: {pair}"
        bound = found.get("lower_bound")
        return f"clearance proven{'' if bound is None else f' ≥ {floored(1e3 * bound)} mm'} ({near})"
    if found["verdict"] == "colliding":
        depth = found.get("depth", 0.0)  # no depth: unknown; null: one is inside the other
        deep = ", one inside the other" if depth is None else f", {length(depth)} deep" if depth else ""
        return f"collision: {pair} at {found['time']:.4g} {unit}{deep}"
    near = "" if measured is None else f": {pair} as near as {length(measured)} at {found['time']:.4g} {unit}"
    return f"clearance not proven{near}"


def length(metres: float) -> str:
    """A length [m] as text, in mm below 1 m.

    >>> length(0.0257), length(1.374)
    ('25.7 mm', '1.37 m')
    """
    return f"{metres:.3g} m" if abs(metres) >= 0.9995 else f"{1e3 * metres:.3g} mm"  # 0.9995: not "1e+03 mm"


def floored(value: float, digits: int = 2) -> str:
    """Rounded down to significant digits: 99.996 is not 100, and a proven bound is not more than it is.

    >>> floored(99.996, 4), floored(2.28)
    ('99.99', '2.2')
    """
    if value <= 0:
        return f"{value:.{digits}g}"
    step = 10.0 ** (digits - 1 - math.floor(math.log10(value)))
    return f"{math.floor(value * step * (1 + 1e-12)) / step:.{digits}g}"
