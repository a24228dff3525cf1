"""A named number, list or table of an effect: its unit, its bounds, and what a fit of it needs to know.

Laws are written with kinks (sign, abs, clamp): one expression serves the exact law (`EXACT`) and the smooth one that a
solver needs.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from energy_opt.errors import BadInput

Size = str | int | tuple[str | int, ...]


def _words(value: Any) -> bool:
    """Are there words or truth values among the numbers? NumPy would take them for numbers."""
    if isinstance(value, (list, tuple)):
        return any(map(_words, value))
    return isinstance(value, (str, bytes, bool, np.bool_)) or getattr(value, "dtype", np.dtype(float)).kind in "bSU"


@dataclass(frozen=True)
class Parameter:
    """A named number (or one per joint, or a fixed-size vector, or a table) of an effect.

    Attributes:
        unit: SI unit as text.
        neutral: the value at which the effect changes nothing (for a parameter that only shapes the effect, such as a
            time constant, any sensible value).
        lower, upper: physical bounds.
        size: "scalar", "joint" (one number for all joints or one per joint), the length of a vector, or several such
            dimensions, as ("joint", 3); any other word is a dimension whose length the given values decide, the same
            for all parameters of the effect that name it, as ("joint", "points").
        shapes: True where the parameter only shapes the effect and cannot switch it off by itself.
        fit: bounds that a fit keeps to, where they are tighter than the physical ones.
        trials: values at which a search begins where the effect's size says nothing of this parameter.
        steps: the law jumps with it, or it is a grid that is chosen: derivatives by it say nothing, so it is scanned or
            given, never descended.
    """

    name: str
    unit: str
    neutral: float
    lower: float
    upper: float
    size: Size = "scalar"
    shapes: bool = False
    fit: tuple[float, float] | None = None
    trials: tuple[float, ...] = ()
    steps: bool = False

    @property
    def dimensions(self) -> tuple[str | int, ...]:
        """`size` as a tuple: () for a number, ("joint",) for one per joint."""
        if isinstance(self.size, tuple):
            return self.size
        return () if self.size == "scalar" else (self.size,)

    @property
    def per_joint(self) -> bool:
        """One entry (or row) per joint?"""
        return "joint" in self.dimensions

    @property
    def free(self) -> tuple[str, ...]:
        """The dimensions whose length the given values decide."""
        return tuple(d for d in self.dimensions if isinstance(d, str) and d != "joint")

    @property
    def bounds(self) -> tuple[float, float]:
        """What a fit keeps to."""
        return self.fit or (self.lower, self.upper)

    def shape(self, joints: int, extents: Mapping[str, int] | None = None) -> tuple[int, ...]:
        """Its shape on an arm of `joints` joints; `extents` are the lengths of the free dimensions."""
        known = {"joint": joints, **(extents or {})}
        return tuple(d if isinstance(d, int) else known[d] for d in self.dimensions)

    def count(self, joints: int, extents: Mapping[str, int] | None = None) -> int:
        """How many numbers it has on an arm of `joints` joints."""
        return int(np.prod(self.shape(joints, extents), dtype=int))

    def checked(self, effect: str, value: Any, extents: dict[str, int]) -> np.ndarray:
        """`value` as an array of at least one dimension; lengths of free dimensions are entered into `extents`.

        Raises:
            BadInput: not finite numbers, outside the bounds, of another shape; says what would be right.
        """
        try:
            number = np.atleast_1d(np.asarray(value, dtype=float))
        except (TypeError, ValueError, OverflowError):
            raise BadInput(f"effect {effect}: {self.name} = {value!r} is not a number [{self.unit}]") from None
        most = max(1, len(self.dimensions))
        if _words(value):
            raise BadInput(f"effect {effect}: {self.name} = {value!r}: numbers stand without quotes [{self.unit}]")
        if number.ndim > most or not number.size or not np.isfinite(number).all():
            raise BadInput(f"effect {effect}: {self.name} = {value!r} is not a finite number or list [{self.unit}]")
        if not self.per_joint and not self.free and number.size != self.count(1):
            raise BadInput(f"effect {effect}: {self.name} has {number.size} values; expected {self.count(1)}")
        for back, dimension in enumerate(reversed(self.dimensions), start=1):
            length = number.shape[-back] if back <= number.ndim else 1
            wanted = extents.get(dimension) if isinstance(dimension, str) else dimension
            if dimension in self.free and wanted is None:
                extents[str(dimension)] = length
            elif wanted is not None and dimension != "joint" and length != wanted:
                what = f"{length} values along {dimension!r}" if isinstance(dimension, str) else f"{length} values"
                raise BadInput(f"effect {effect}: {self.name} has {what}; expected {wanted}")
        if (number < self.lower).any() or (number > self.upper).any():
            bounds = f"[{self.lower:g}, {self.upper:g}] {self.unit}"
            raise BadInput(f"effect {effect}: {self.name} = {value!r} is outside {bounds}")
        return number

    def full(self, effect: str, value: np.ndarray, joints: int, extents: Mapping[str, int]) -> np.ndarray:
        """`value` with one entry (or row) per joint, as one vector, row by row."""
        shape = self.shape(joints, extents)
        if self.per_joint:
            at = value.ndim - (len(shape) - self.dimensions.index("joint"))
            given = value.shape[at] if at >= 0 else 1
            if given not in (1, joints):
                raise BadInput(
                    f"effect {effect}: {self.name} has {given} values; the robot has {joints} joints "
                    f"(give one number or {joints})"
                )
        return np.broadcast_to(value, shape or (1,)).ravel()


TINY = 1e-12  # keeps the logarithm of nothing finite
MOVING_SPEED = 1e-3  # [rad/s] a joint that is faster than this moves
SLIDING_SPEED = 0.01  # [rad/s] smoothing width about standstill: about a hundredth of a cobot's usual joint speed
LOAD_WIDTH = 0.05  # [N m] smoothing width of what friction bears at rest


def bearing(load: ca.SX, level: ca.SX) -> ca.SX:
    """Direction and share (-1 to 1) in which friction of up to `level` [N m] bears `load` [N m] at rest.

    -load / max(|load|, level): what is left to the motor, load + level * share, is 0 up to the level, |load| - level
    beyond it: the least that any friction of that size leaves, so that no creeping is cheaper than standing still.
    """
    return -load / ca.fmax(ca.fmax(ca.fabs(load), level), TINY)


class Kinks:
    """How sign, abs, clamp, sign(x) |x|^exponent and steps are written: here as they are, exactly.

    `width` is the half-width of the rounding, in the unit of x, where they are rounded (`Smooth`). `direction` is that
    of dry friction where it holds at rest: sign(v) of a joint that moves; `bearing` of one that rests;
    s^3 + (1 - s^2) bearing between, with s from -1 to 1, so that friction nowhere exceeds its level.
    """

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
class Smooth(Kinks):
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


def along(kinks: Kinks, v: ca.SX, way: ca.SX) -> Kinks:
    """Kinks with `way` (n, 1) as the sign of the joints' velocity v (n, 1)."""
    out = copy(kinks)
    object.__setattr__(out, "sign", lambda x, width: way if x is v else kinks.sign(x, width))
    return out


EXACT = Kinks()
