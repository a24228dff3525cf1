"""Units of measured columns: factors to SI, as people and recorders write them."""

from __future__ import annotations

import math
import re

# Factors to SI, by the kind of quantity; the first is SI's own.
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "position": {"rad": 1.0, "deg": math.pi / 180, "rev": 2 * math.pi, "m": 1.0, "mm": 1e-3},
    "velocity": {
        "rad/s": 1.0,
        "deg/s": math.pi / 180,
        "rpm": math.pi / 30,
        "rev/s": 2 * math.pi,
        "m/s": 1.0,
        "mm/s": 1e-3,
    },
    "acceleration": {"rad/s^2": 1.0, "deg/s^2": math.pi / 180, "m/s^2": 1.0, "mm/s^2": 1e-3},
    "effort": {"N m": 1.0, "Nm": 1.0, "mN m": 1e-3, "N": 1.0},
    "current": {"A": 1.0, "mA": 1e-3},
    "temperature": {"degC": 1.0},
    "power": {"W": 1.0, "mW": 1e-3, "kW": 1e3},
    "energy": {"J": 1.0, "kJ": 1e3, "MJ": 1e6, "Ws": 1.0, "mWh": 3.6, "Wh": 3600.0, "kWh": 3.6e6},
}
BY_SIGNAL = {"position": "", "velocity": "/s", "acceleration": "/s^2"}  # what an angle's unit gets
OTHER = {
    "°": "deg", "º": "deg", "degree": "deg", "degrees": "deg", "grad": "deg", "radian": "rad", "radians": "rad",
    "sec": "s", "second": "s", "seconds": "s", "msec": "ms", "µs": "us", "μs": "us", "usec": "us", "turn": "rev",
    "turns": "rev", "1/min": "rpm", "u/min": "rpm", "°c": "degC", "c": "degC", "celsius": "degC", "watt": "W",
    "watts": "W", "ampere": "A", "amps": "A", "amp": "A", "joule": "J", "joules": "J", "n*m": "N m", "n.m": "N m",
    "n-m": "N m", "n·m": "N m", "nm": "N m", "mnm": "mN m",
}  # fmt: skip


def known_unit(kind: str, word: str) -> str | None:
    """The unit of UNITS[kind] that a word of a header or a unit row means, None where it means none.

    >>> known_unit("position", "[°]"), known_unit("velocity", "deg/s"), known_unit("energy", "(kWh)")
    ('deg', 'deg/s', 'kWh')
    """
    word = word.strip().strip("[](){}<> ").strip()
    if not word or kind not in UNITS:
        return None
    lower = {name.lower(): name for name in UNITS[kind]}
    if word in UNITS[kind]:
        return word
    word = word.lower()
    angle = re.fullmatch(r"(\D+?)\s*(/|_per_|\.)\s*s(?:ec)?(?:\^?(-?2)|²)?\s*", word)
    if angle and kind in BY_SIGNAL:
        stem = OTHER.get(angle.group(1), angle.group(1))
        return lower.get(f"{stem}{BY_SIGNAL[kind]}".lower())
    return lower.get(OTHER.get(word, word).lower())
