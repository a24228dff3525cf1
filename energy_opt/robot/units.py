"""Units of joints: what is rad and N m for a joint that turns is m and N for one that slides."""

from __future__ import annotations

TURNING = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3", "effort": "N m"}
OTHERS = {"power": "W", "tool_speed": "m/s", "tool_acceleration": "m/s^2"}  # of what is no joint's


def sliding(unit: str) -> str:
    """The unit of a sliding joint in place of a turning one's.

    >>> sliding("N m s/rad"), sliding("rad/s^2"), sliding("W/(N m)^2")
    ('N s/m', 'm/s^2', 'W/N^2')
    """
    return unit.replace("(N m)", "N").replace("N m", "N").replace("rad", "m")


def unit_of(kind: str, slides: bool = False) -> str:
    """Unit of a joint's position, velocity, ..., or of another bounded quantity; empty where it is not known."""
    unit = TURNING.get(kind)
    if unit is None:
        return OTHERS.get(kind, "")
    return sliding(unit) if slides else unit
