"""The fastest standard move of one joint from rest to rest: trapezoid or seven-segment S-curve, in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

from energy_opt.errors import BadInput


@dataclass(frozen=True)
class Profile:
    """Cruising speed v [rad/s], the ramps' duration [s], their rise of acceleration [s], and the cruise [s]."""

    speed: float
    ramp: float
    rise: float
    cruise: float

    @property
    def acceleration(self) -> float:
        """Peak, rad/s^2."""
        return self.speed / (self.ramp - self.rise)

    @property
    def duration(self) -> float:
        """Seconds."""
        return 2 * self.ramp + self.cruise


def fastest(distance: float, velocity: float, acceleration: float, jerk: float = math.inf) -> Profile:
    """The shortest move over `distance` within limits on speed, acceleration and jerk (inf: the trapezoid).

    A ramp to speed v takes a / j + v / a where the acceleration limit a is reached (v >= a^2 / j), else 2 sqrt(v / j),
    and covers half of that times v. What is left of the distance is run at v; where nothing is left, v is the speed at
    which two ramps cover the distance.

    Raises:
        BadInput: a distance or limit is not above zero.
    """
    if not (distance > 0 and velocity > 0 and acceleration > 0 and jerk > 0):
        raise BadInput("a standard move needs a distance and limits above zero")
    v = velocity
    ramp = _ramp(v, acceleration, jerk)
    if v * ramp > distance:
        # two ramps and no cruise: v ramp(v) = distance
        step = acceleration / jerk
        if acceleration * step * 2 * step < distance:  # v >= a^2 / j: v^2 / a + v a / j = distance
            v = acceleration * (math.sqrt(step * step + 4 * distance / acceleration) - step) / 2
        else:  # 2 v sqrt(v / j) = distance
            v = (distance * math.sqrt(jerk) / 2) ** (2 / 3)
        ramp = _ramp(v, acceleration, jerk)
    rise = min(acceleration / jerk, ramp / 2)
    return Profile(v, ramp, rise, max(distance / v - ramp, 0.0))


def _ramp(v: float, a: float, j: float) -> float:
    """Shortest time from rest to speed v, s."""
    return a / j + v / a if v * j >= a * a else 2 * math.sqrt(v / j)
