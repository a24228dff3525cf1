"""What an effect is: named parameters with units, and one CasADi expression.

The power of an arm is built in stages, and every effect belongs to exactly one of them:

    rigid      changes the rigid body itself            tau = RNEA(q, v, a; payload, gravity)
    torque     adds to the motor's torque               tau_m = tau + sum of torque effects
    copper     heat in a joint's winding                c_j = r_j * tau_m,j^2 (times a factor that grows as it warms)
    drive      what becomes of negative drive power     d_j = tau_m,j * v_j + c_j  ->  p
    power      adds to the power of the whole arm       p + ...
    supply     between the drives and the meter         p / eta
    meter      what the meter makes of the true power   reading(t), never part of an energy

Kinks (sign, abs, clamp) are written through `Kinks`, so that one expression serves both the exact law (`EXACT`) and
the smooth one that a solver needs (`Smooth`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, Literal, Protocol

import casadi as ca
import numpy as np

from energy_opt.errors import BadInput

Stage = Literal["rigid", "torque", "copper", "drive", "power", "supply", "meter"]
Size = Literal["scalar", "joint"] | int

MOVING_SPEED = 1e-3  # [rad/s] a joint that is faster than this moves


@dataclass(frozen=True)
class Parameter:
    """A named number (or one per joint, or a fixed-size vector) of an effect.

    Attributes:
        unit: SI unit as text.
        neutral: the value at which the effect changes nothing (for a parameter that only shapes the effect, such as a
            time constant, any sensible value).
        lower, upper: physical bounds.
        size: "scalar", "joint" (one number for all joints or one per joint) or the length of a vector.
        shapes: True where the parameter only shapes the effect and cannot switch it off by itself.
    """

    name: str
    unit: str
    neutral: float
    lower: float
    upper: float
    size: Size = "scalar"
    shapes: bool = False

    def count(self, joints: int) -> int:
        """How many numbers it has on an arm of `joints` joints."""
        if self.size == "joint":
            return joints
        return 1 if self.size == "scalar" else int(self.size)


class Kinks(Protocol):
    """How sign, abs and clamp are written; `width` is the half-width of the rounding, in the unit of x."""

    def sign(self, x: ca.SX, width: float) -> ca.SX: ...
    def magnitude(self, x: ca.SX, width: float) -> ca.SX: ...
    def positive(self, x: ca.SX, width: float) -> ca.SX: ...
    def moving(self, v: ca.SX) -> ca.SX: ...


class Exact:
    """The laws as they are."""

    def sign(self, x: ca.SX, width: float) -> ca.SX:
        return ca.sign(x)

    def magnitude(self, x: ca.SX, width: float) -> ca.SX:
        return ca.fabs(x)

    def positive(self, x: ca.SX, width: float) -> ca.SX:
        return ca.fmax(x, 0)

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

    def moving(self, v: ca.SX) -> ca.SX:
        w = 10 * MOVING_SPEED * self.scale
        return 1 - ca.exp(-ca.dot(v, v) / (w * w))


EXACT = Exact()


@dataclass(frozen=True)
class Signals:
    """The state at one instant, as CasADi columns: q [rad], v [rad/s], a [rad/s^2], tau [N m] (rigid body), t [s]."""

    q: ca.SX
    v: ca.SX
    a: ca.SX
    tau: ca.SX
    t: ca.SX


class Effect:
    """Base of all effects; an instance holds its parameters' values.

    Subclasses set `name`, `stage`, `parameters` and write their law; `p` in a law holds the parameters by name, as
    CasADi columns of full length (a per-joint parameter always has one entry per joint there).
    """

    name: ClassVar[str]
    stage: ClassVar[Stage]
    parameters: ClassVar[tuple[Parameter, ...]]
    convex_in_retiming: ClassVar[bool] = True  # does retiming stay convex with it (see FIELD of each effect)?
    dissipates: ClassVar[bool] = False  # is its share of the energy never negative?
    options: ClassVar[Mapping[str, tuple[str, ...]]] = {}  # words beside numbers, the first is the default

    def __init__(self, **values: Any) -> None:
        self.values: dict[str, np.ndarray] = {}
        self.choices: dict[str, str] = {}
        known = {p.name: p for p in self.parameters}
        for key in values:
            if key not in known and key not in self.options:
                expected = ", ".join([*known, *self.options])
                raise BadInput(f"effect {self.name}: unknown parameter {key!r}; it has {expected}")
        for key, p in known.items():
            if key not in values:
                raise BadInput(f"effect {self.name}: parameter {key!r} is missing [{p.unit}]")
            self.values[key] = self._checked(p, values[key])
        for key, words in self.options.items():
            word = values.get(key, words[0])
            if word not in words:
                raise BadInput(f"effect {self.name}: {key} = {word!r}; expected one of {', '.join(words)}")
            self.choices[key] = word

    def _checked(self, p: Parameter, value: Any) -> np.ndarray:
        try:
            number = np.atleast_1d(np.asarray(value, dtype=float))
        except (TypeError, ValueError):
            raise BadInput(f"effect {self.name}: {p.name} = {value!r} is not a number [{p.unit}]") from None
        if isinstance(value, bool) or number.ndim != 1 or not np.isfinite(number).all():
            raise BadInput(f"effect {self.name}: {p.name} = {value!r} is not a finite number or list [{p.unit}]")
        if p.size != "joint" and number.size != p.count(1):
            raise BadInput(f"effect {self.name}: {p.name} has {number.size} values; expected {p.count(1)}")
        if (number < p.lower).any() or (number > p.upper).any():
            raise BadInput(f"effect {self.name}: {p.name} = {value!r} is outside [{p.lower:g}, {p.upper:g}] {p.unit}")
        return number

    def full(self, joints: int) -> np.ndarray:
        """All parameters as one vector, per-joint ones expanded; shape (sum of counts,)."""
        parts = []
        for p in self.parameters:
            value = self.values[p.name]
            if p.size == "joint" and value.size not in (1, joints):
                raise BadInput(
                    f"effect {self.name}: {p.name} has {value.size} values; the robot has {joints} joints "
                    f"(give one number or {joints})"
                )
            parts.append(np.broadcast_to(value, (p.count(joints),)) if p.size == "joint" else value)
        return np.concatenate(parts) if parts else np.zeros(0)

    @classmethod
    def size(cls, joints: int) -> int:
        """Length of `full`."""
        return sum(p.count(joints) for p in cls.parameters)

    @classmethod
    def split(cls, vector: ca.SX, joints: int) -> SimpleNamespace:
        """The parameters by name, cut out of a column laid out as `full`."""
        out, at = SimpleNamespace(), 0
        for p in cls.parameters:
            count = p.count(joints)
            setattr(out, p.name, vector[at : at + count])
            at += count
        return out

    @classmethod
    def from_full(cls, vector: Sequence[float] | np.ndarray, joints: int, **choices: str) -> Effect:
        """The effect with the values of `vector`, laid out as `full`."""
        values, at = {}, 0
        for p in cls.parameters:
            count = p.count(joints)
            values[p.name] = np.asarray(vector[at : at + count], dtype=float)
            at += count
        return cls(**values, **choices)

    @classmethod
    def neutral(cls, joints: int) -> Effect:
        """The effect at its neutral value: it changes nothing."""
        return cls(**{p.name: np.full(p.count(joints), p.neutral) for p in cls.parameters})

    def __repr__(self) -> str:
        given = {**{k: v.tolist() for k, v in self.values.items()}, **self.choices}
        return f"{type(self).__name__}({', '.join(f'{k}={v}' for k, v in given.items())})"


class TorqueEffect(Effect):
    """Adds to the motor's torque at the joint side."""

    stage = "torque"

    @classmethod
    def torque(cls, x: Signals, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Added torque, N m, shape (n, 1)."""
        raise NotImplementedError


class PowerEffect(Effect):
    """Adds to the power of the whole arm."""

    stage = "power"

    @classmethod
    def power(cls, x: Signals, tau_m: ca.SX, p: SimpleNamespace, k: Kinks) -> ca.SX:
        """Added power, W, a scalar."""
        raise NotImplementedError
