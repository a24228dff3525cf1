"""Parameters of effects, and the two forms of their kinks.

A parameter is a named number, list or table with a unit, bounds, and hints for a fit. Laws contain kinks (sign,
absolute value, clamp). They are written with a `Kinks` object, so that one expression gives the exact law (`EXACT`) for
the judge and a twice differentiable one (`Smooth`) for solvers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from energy_opt.errors import BadInput
from energy_opt.names import labels_of

Size = str | int | tuple[str | int, ...]


def _words(value: Any) -> bool:
    """Whether a value contains text or truth values, at any depth. NumPy would convert these to numbers."""
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
        shapes: True if the parameter only changes the form of the effect and cannot switch it off.
        fit: bounds that a fit keeps to, where they are tighter than the physical ones.
        trials: start values of a search if the effect's size does not determine this parameter.
        steps: the law is discontinuous in it, or it is a grid that is chosen: derivatives by it are useless, so it is
            scanned or given, never fitted by descent.
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
        """True if it has one entry (or row) per joint."""
        return "joint" in self.dimensions

    @property
    def free(self) -> tuple[str, ...]:
        """The dimensions whose length the given values decide."""
        return tuple(d for d in self.dimensions if isinstance(d, str) and d != "joint")

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds in a fit."""
        return self.fit or (self.lower, self.upper)

    def shape(self, joints: int, extents: Mapping[str, int] | None = None) -> tuple[int, ...]:
        """Its shape on an arm of `joints` joints; `extents` are the lengths of the free dimensions."""
        known = {"joint": joints, **(extents or {})}
        return tuple(d if isinstance(d, int) else known[d] for d in self.dimensions)

    def count(self, joints: int, extents: Mapping[str, int] | None = None) -> int:
        """Number of values on an arm of `joints` joints."""
        return int(np.prod(self.shape(joints, extents), dtype=int))

    def checked(self, effect: str, value: Any, extents: dict[str, int]) -> np.ndarray:
        """The value as an array of at least one dimension.

        Args:
            effect: name of the effect, for messages.
            value: a number or nested lists, in SI units.
            extents: lengths of free dimensions by name. A length that this value decides is entered.

        Raises:
            BadInput: not finite numbers, outside the bounds, or of another shape; the message says what would be right.
        """
        if self.per_joint and labels_of(value):
            raise BadInput(
                f"effect {effect}: {self.name} has labels; expected a list in the robot's order [{self.unit}]"
            )
        try:
            number = np.atleast_1d(np.asarray(value, dtype=float))
        except (TypeError, ValueError, OverflowError):
            raise BadInput(f"effect {effect}: {self.name} = {value!r} is not a number [{self.unit}]") from None
        most = max(1, len(self.dimensions))
        if _words(value):
            raise BadInput(f"effect {effect}: {self.name} = {value!r}: expected numbers without quotes [{self.unit}]")
        if number.ndim > most or not number.size or not np.isfinite(number).all():
            given = np.asarray(value, dtype=float).tolist()
            raise BadInput(f"effect {effect}: {self.name} = {given!r} is not a finite number or list [{self.unit}]")
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
            worst = number[(number < self.lower) | (number > self.upper)][0]
            raise BadInput(f"effect {effect}: {self.name} = {worst:g} is outside {bounds}")
        return number

    def full(self, effect: str, value: np.ndarray, joints: int, extents: Mapping[str, int]) -> np.ndarray:
        """The value as one vector with one entry (or row) for each joint, row by row.

        Args:
            effect: name of the effect, for messages.
            value: as `checked` returns it; one number is repeated for all joints.
            joints: number n of joints.
            extents: lengths of the free dimensions.

        Raises:
            BadInput: neither one value nor n values for a per-joint parameter.
        """
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


TINY = 1e-12  # keeps the logarithm of 0 finite
MOVING_SPEED = 1e-3  # [rad/s] a faster joint counts as moving
RESTING_SPEED = 1e-9  # [rad/s] a joint at rest is no faster than this, as numbers are rounded
SLIDING_SPEED = 0.01  # [rad/s] smoothing width about standstill: about a hundredth of a cobot's usual joint speed
LOAD_WIDTH = 0.05  # [N m] smoothing width of the load that friction bears at rest; times `ArmSize.torque`
# [N m], [W] largest torque and power of a cobot; a UR3's are 54 N m and 450 W, a UR10's 330 N m and 2,400 W
USUAL = 150.0, 1000.0


def bearing(load: ca.SX, level: ca.SX) -> ca.SX:
    """Direction and share (-1 to 1) with which friction of up to `level` [N m] holds a `load` [N m] at rest.

    The share is -load / max(|load|, level). The motor bears the rest, load + level * share. The rest is 0 up to the
    level and |load| - level beyond it. This is the least that friction of this size can leave, so creeping is never
    cheaper than resting.
    """
    return -load / ca.fmax(ca.fmax(ca.fabs(load), level), TINY)


class ArmSize(NamedTuple):
    """Powers of ten by which an arm's torque and power exceed a cobot's: factors of the widths of rounded kinks.

    Widths need only the right order of magnitude, and arms of one class keep the same ones.
    """

    torque: float = 1.0
    power: float = 1.0

    @classmethod
    def of(cls, torque: float, power: float) -> ArmSize:
        """From the largest torque [N m, N] and the power [W] that the drives are rated for."""
        return cls(*(10.0 ** round(math.log10(max(x, TINY))) for x in (torque / USUAL[0], power / USUAL[1])))


COBOT = ArmSize()


class Kinks:
    """Sign, absolute value, clamp, power and step as exact functions.

    In the methods, x, v, load and level are CasADi columns (or scalars). `width` is the half-width of the rounding in
    the unit of x; the exact functions ignore it, `Smooth` uses it. Widths of torque and power are times `size`.
    """

    size = COBOT

    def direction(self, v: ca.SX, load: ca.SX, level: ca.SX) -> ca.SX:
        """Direction of dry friction that holds at rest, (n, 1) from -1 to 1.

            s = v / RESTING_SPEED, clamped to [-1, 1]
            direction = s + (1 - s^2) (share - s share^2)      with share = bearing(load, level)

        It is sign(v) if the joint moves (|s| = 1) and `bearing` if it rests (s = 0). In between it equals s (1 -
        share^2 (1 - s^2)) + (1 - s^2) share, which stays within [-1, 1]: friction never exceeds its level.

        Args:
            v: velocity (n, 1) [rad/s]. load: torque that the joint bears at rest (n, 1) [N m]. level: largest friction
                (n, 1) [N m].
        """
        s = ca.fmax(ca.fmin(v / RESTING_SPEED, 1), -1)
        share = bearing(load, level)
        return s + (1 - s * s) * (share - s * share**2)

    def sign(self, x: ca.SX, width: float) -> ca.SX:
        """sign(x): -1, 0 or 1."""
        return ca.sign(x)

    def magnitude(self, x: ca.SX, width: float) -> ca.SX:
        """|x|."""
        return ca.fabs(x)

    def positive(self, x: ca.SX, width: float) -> ca.SX:
        """max(x, 0)."""
        return ca.fmax(x, 0)

    def power(self, x: ca.SX, exponent: ca.SX, width: float) -> ca.SX:
        """sign(x) |x|^exponent; the logarithm is kept finite at 0."""
        return ca.sign(x) * ca.exp(exponent * ca.log(ca.fmax(ca.fabs(x), TINY)))

    def below(self, x: ca.SX, bound: ca.SX, width: float) -> ca.SX:
        """1 where x < bound, else 0."""
        return ca.if_else(x < bound, 1, 0)

    def moving(self, v: ca.SX) -> ca.SX:
        """1 if any joint of v (n, 1) [rad/s] is faster than MOVING_SPEED, else 0."""
        return ca.if_else(ca.mmax(ca.fabs(v)) > MOVING_SPEED, 1, 0)


@dataclass(frozen=True)
class Smooth(Kinks):
    """Twice differentiable replacements of the kinks, with w = width * scale:

        sign(x)   = x / sqrt(x^2 + w^2)
        |x|       = sqrt(x^2 + w^2) - w
        max(x, 0) = (x + sqrt(x^2 + w^2)) / 2

    |x| is at most w below the exact value. max(x, 0) is at most w / 2 above it, at the kink, and exact far from it.
    If it were below the exact value, a search would gain by slow motions. sign(x) differs by less than (w/x)^2 / 2.

    Attributes:
        scale: factor on every width. 1: as each law states it; below 1: sharper.
        size: the arm's, for widths of torque and power.
    """

    scale: float | ca.SX = 1.0
    size: ArmSize = COBOT

    def direction(self, v: ca.SX, load: ca.SX, level: ca.SX) -> ca.SX:
        """As `Kinks.direction`, with rounded sign and share.

        The exact share is -load / max(|load|, level) = -2 load / (|load + level| + |load - level|). Both absolute
        values are rounded by LOAD_WIDTH * scale * size.torque.
        """
        w = LOAD_WIDTH * self.scale * self.size.torque
        around = (ca.sqrt((load + x) ** 2 + w * w) for x in (level, -level))
        s, share = self.sign(v, SLIDING_SPEED), -2 * load / sum(around)
        return s + (1 - s * s) * (share - s * share**2)

    def sign(self, x: ca.SX, width: float) -> ca.SX:
        """x / sqrt(x^2 + w^2)."""
        w = width * self.scale
        return x / ca.sqrt(x * x + w * w)

    def magnitude(self, x: ca.SX, width: float) -> ca.SX:
        """sqrt(x^2 + w^2) - w."""
        w = width * self.scale
        return ca.sqrt(x * x + w * w) - w

    def positive(self, x: ca.SX, width: float) -> ca.SX:
        """(x + sqrt(x^2 + w^2)) / 2."""
        w = width * self.scale
        return (x + ca.sqrt(x * x + w * w)) / 2

    def power(self, x: ca.SX, exponent: ca.SX, width: float) -> ca.SX:
        """x (x^2 + w^2)^((exponent - 1) / 2): x |x|^(exponent - 1), rounded at 0."""
        w = width * self.scale
        return x * ca.exp((exponent - 1) / 2 * ca.log(x * x + w * w))

    def below(self, x: ca.SX, bound: ca.SX, width: float) -> ca.SX:
        """(1 - sign(x - bound)) / 2: a step of width w."""
        return (1 - self.sign(x - bound, width)) / 2

    def moving(self, v: ca.SX) -> ca.SX:
        """1 - exp(-|v|^2 / w^2) with w = 10 MOVING_SPEED * scale."""
        w = 10 * MOVING_SPEED * self.scale
        return 1 - ca.exp(-ca.dot(v, v) / (w * w))


def along(kinks: Kinks, v: ca.SX, way: ca.SX) -> Kinks:
    """The same kinks, but sign(v) of this expression v is replaced by `way`.

    Args:
        kinks: what the law is written with. v: the velocity (n, 1) that the law takes the sign of. way: replacement
            (n, 1).
    """
    out = copy(kinks)
    object.__setattr__(out, "sign", lambda x, width: way if x is v else kinks.sign(x, width))
    return out


EXACT = Kinks()
