"""Kinks (sign, abs, clamp): one expression serves the exact law (`EXACT`) and the smooth one that a solver needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import casadi as ca

TINY = 1e-12  # keeps the logarithm of nothing finite
MOVING_SPEED = 1e-3  # [rad/s] a joint that is faster than this moves


class Kinks(Protocol):
    """How sign, abs, clamp, sign(x) |x|^exponent and steps are written; `width` is the half-width of the rounding, in
    the unit of x."""

    def sign(self, x: ca.SX, width: float) -> ca.SX: ...
    def magnitude(self, x: ca.SX, width: float) -> ca.SX: ...
    def positive(self, x: ca.SX, width: float) -> ca.SX: ...
    def power(self, x: ca.SX, exponent: ca.SX, width: float) -> ca.SX: ...
    def moving(self, v: ca.SX) -> ca.SX: ...
    def below(self, x: ca.SX, bound: ca.SX, width: float) -> ca.SX: ...


class Exact:
    """The laws as they are."""

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


EXACT = Exact()
