"""Kinks (sign, abs, clamp): one expression serves the exact law (`EXACT`) and the smooth one that a solver needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import casadi as ca

TINY = 1e-12  # keeps the logarithm of nothing finite
MOVING_SPEED = 1e-3  # [rad/s] a joint that is faster than this moves
SLIDING_SPEED = 0.01  # [rad/s] smoothing width about standstill: about a hundredth of a cobot's usual joint speed
LOAD_WIDTH = 0.05  # [N m] smoothing width of what friction bears at rest


class Kinks(Protocol):
    """How sign, abs, clamp, sign(x) |x|^exponent and steps are written; `width` is the half-width of the rounding, in
    the unit of x.

    `direction` is that of dry friction where it holds at rest: sign(v) of a joint that moves; `bearing` of one that
    rests; s^3 + (1 - s^2) bearing between, with s from -1 to 1, so that friction nowhere exceeds its level.
    """

    def sign(self, x: ca.SX, width: float) -> ca.SX: ...
    def magnitude(self, x: ca.SX, width: float) -> ca.SX: ...
    def positive(self, x: ca.SX, width: float) -> ca.SX: ...
    def power(self, x: ca.SX, exponent: ca.SX, width: float) -> ca.SX: ...
    def moving(self, v: ca.SX) -> ca.SX: ...
    def below(self, x: ca.SX, bound: ca.SX, width: float) -> ca.SX: ...
    def direction(self, v: ca.SX, load: ca.SX, level: ca.SX) -> ca.SX: ...


def bearing(load: ca.SX, level: ca.SX) -> ca.SX:
    """Direction and share (-1 to 1) in which friction of up to `level` [N m] bears `load` [N m] at rest.

    -load / max(|load|, level): what is left to the motor, load + level * share, is 0 up to the level, |load| - level
    beyond it: the least that any friction of that size leaves, so that no creeping is cheaper than standing still.
    """
    return -load / ca.fmax(ca.fmax(ca.fabs(load), level), TINY)


class Exact:
    """The laws as they are."""

    def direction(self, v: ca.SX, load: ca.SX, level: ca.SX) -> ca.SX:
        s = ca.fmax(ca.fmin(v / MOVING_SPEED, 1), -1)
        share = bearing(load, level)
        return s + (1 - s * s) * (share - s * share**2)

    def sign(self, x: ca.SX, width: float) -> ca.SX:
        return ca.sign(x)

    def magnitude(self, x: ca.SX, width: float) -> ca.SX:
        return ca.fabs(x)

    def positive(self, x: ca.SX, width: float) -> ca.SX:
        return ca.fmax(x, 0)

    def power(self, x: ca.SX, exponent: ca.SX, width: float) -> ca.SX:
        return ca.sign(x) * ca.exp(exponent * ca.log(ca.fmax(ca.fabs(x), TINY)))

    def below(self, x: ca.SX, bound: ca.SX, width: float) -> ca.SX:
        return ca.if_else(x < bound, 1, 0)

    def moving(self, v: ca.SX) -> ca.SX:
        return ca.if_else(ca.mmax(ca.fabs(v)) > MOVING_SPEED, 1, 0)


@dataclass(frozen=True)
class Smooth:
    """Twice differentiable stand-ins; `scale` multiplies every width (1 = as stated at each law, smaller = sharper).

    sign(x) = x / sqrt(x^2 + w^2), |x| = sqrt(x^2 + w^2) - w, max(x, 0) = (x + sqrt(x^2 + w^2)) / 2 - w / 2.
    All three vanish at 0, and differ from the exact law by at most w (sign: by less than (w/x)^2 / 2).
    """

    scale: float | ca.SX = 1.0

    def direction(self, v: ca.SX, load: ca.SX, level: ca.SX) -> ca.SX:
        w = LOAD_WIDTH * self.scale
        around = (ca.sqrt((load + x) ** 2 + w * w) for x in (level, -level))
        s, share = self.sign(v, SLIDING_SPEED), -2 * load / sum(around)
        return s + (1 - s * s) * (share - s * share**2)

    def sign(self, x: ca.SX, width: float) -> ca.SX:
        w = width * self.scale
        return x / ca.sqrt(x * x + w * w)

    def magnitude(self, x: ca.SX, width: float) -> ca.SX:
        w = width * self.scale
        return ca.sqrt(x * x + w * w) - w

    def positive(self, x: ca.SX, width: float) -> ca.SX:
        return (x + self.magnitude(x, width)) / 2

    def power(self, x: ca.SX, exponent: ca.SX, width: float) -> ca.SX:
        w = width * self.scale
        return x * ca.exp((exponent - 1) / 2 * ca.log(x * x + w * w))

    def below(self, x: ca.SX, bound: ca.SX, width: float) -> ca.SX:
        return (1 - self.sign(x - bound, width)) / 2

    def moving(self, v: ca.SX) -> ca.SX:
        w = 10 * MOVING_SPEED * self.scale
        return 1 - ca.exp(-ca.dot(v, v) / (w * w))


@dataclass(frozen=True)
class Along:
    """Other kinks, but the sign of the joints' velocity `v` is `way`."""

    kinks: Kinks
    v: ca.SX
    way: ca.SX

    def sign(self, x: ca.SX, width: float) -> ca.SX:
        return self.way if x is self.v else self.kinks.sign(x, width)

    def magnitude(self, x: ca.SX, width: float) -> ca.SX:
        return self.kinks.magnitude(x, width)

    def positive(self, x: ca.SX, width: float) -> ca.SX:
        return self.kinks.positive(x, width)

    def power(self, x: ca.SX, exponent: ca.SX, width: float) -> ca.SX:
        return self.kinks.power(x, exponent, width)

    def below(self, x: ca.SX, bound: ca.SX, width: float) -> ca.SX:
        return self.kinks.below(x, bound, width)

    def moving(self, v: ca.SX) -> ca.SX:
        return self.kinks.moving(v)

    def direction(self, v: ca.SX, load: ca.SX, level: ca.SX) -> ca.SX:
        return self.kinks.direction(v, load, level)


EXACT = Exact()
