"""User-defined limits: a name, a unit, what it binds, and one formula; everything else is derived from it.

    |value(x)| <= bound, or value(x) <= bound if it is `one_sided`

`value` is an expression in the state (q, v, a, the motors' torque, the arm's power, time). The judge evaluates it over
a dense grid, a reshaping compiles it with its nodes, and a retiming uses it along the path, where the state is a
function of path acceleration and squared path speed. A value that depends on time can be held only by reshaping.
"""

from __future__ import annotations

import copy
from collections.abc import Hashable, Sequence
from functools import cached_property
from typing import ClassVar, Self

import casadi as ca
import numpy as np

from energy_opt.errors import BadInput, one_line_of
from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Fixed, Limit, Linear, State, Violation, worst_of
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.numerics.batch import Batch
from energy_opt.robot import Robot

STEP = 1e-5  # relative step of difference quotients
ONE_SIDED = 20.0  # in a retiming, a one-sided value (e.g. power) is also at least minus this multiple of its bound


class OwnLimit(Limit):
    """Base of limits that users write.

    Attributes:
        name, unit: as in messages and in `max_violation`.
        binds: "joint" for a value of each joint (n, 1), or "arm" for one number.
        bound: one number, or one for each joint, in the limit's unit.
        one_sided: values below -bound are allowed.
    """

    binds: ClassVar[str] = "joint"
    bound: float | Sequence[float] | np.ndarray  # type: ignore[assignment]  # as the user writes it
    local = True
    _joints = 0

    def __init__(self, bound: float | Sequence[float] | np.ndarray | None = None) -> None:
        if bound is not None:
            self.bound = bound

    def value(self, x: State) -> ca.SX:
        """The limited value at a state, (n, 1) or (1, 1)."""
        raise NotImplementedError

    def for_robot(self, robot: Robot) -> Self:
        """The limit of a robot's joints.

        Raises:
            BadInput: it has no name, unit or bound, or a bound of another number of joints.
        """
        for attribute in ("name", "unit"):
            if not isinstance(getattr(self, attribute, None), str):
                raise BadInput(f"{type(self).__name__}: {attribute} is missing; expected text")
        if not self.name.isidentifier():
            raise BadInput(f"{type(self).__name__}: name = {self.name!r}; expected letters, digits and _")
        if self.binds not in ("joint", "arm"):
            raise BadInput(f"{self.name}: binds {self.binds!r}; expected 'joint' or 'arm'")
        count = robot.n if self.binds == "joint" else 1
        try:
            bound = np.asarray(self.bound)
        except (TypeError, ValueError):
            bound = np.zeros(0)
        bound = bound.astype(float) if bound.dtype.kind in "iuf" else np.zeros(0)  # text is no number
        if bound.shape not in ((), (count,)) or not ((bound > 0) & np.isfinite(bound)).all():
            raise BadInput(f"{self.name}: bound {self.bound!r}; expected one number above 0, or {count} of them")
        out = copy.copy(self)
        out.scale, out._joints = np.broadcast_to(bound, (count,)).copy(), robot.n
        return out

    @property
    def structure(self) -> Hashable:
        """The class and all other values of the limit that its formula may use."""
        derived = ("bound", "scale", "_law", "_of_position", "_of_time")
        own = {key: value for key, value in vars(self).items() if key not in derived}
        return type(self), repr(sorted(own.items()))

    def where(self, joints: Sequence[str], column: int) -> str:
        """The joint, or "the arm"."""
        return joints[column] if self.binds == "joint" else "the arm"

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        """The formula itself."""
        return self.value(x)

    @cached_property
    def _law(self) -> ca.Function:
        """(q, v, a, effort, power, t) -> value."""
        n = self._joints
        columns = [ca.SX.sym(name, size) for name, size in zip("qvaept", (n, n, n, n, 1, 1), strict=True)]
        try:
            found = ca.SX(self.value(State(*columns)))
            law = ca.Function("law", columns, [ca.densify(found)])
        except (Exception, SystemExit) as fault:
            raise BadInput(f"{self.name}: value: {one_line_of(fault, self.value.__code__.co_filename)}") from None
        if found.shape != (len(self.scale), 1):
            raise BadInput(f"{self.name}: its value has shape {found.shape}; expected ({len(self.scale)}, 1)")
        return law

    @cached_property
    def _of_position(self) -> bool:
        """True if the value depends only on position."""
        inputs = self._law.sx_in()
        return not any(ca.which_depends(self._law(*inputs), ca.vertcat(*inputs[1:]), 1, True))

    @cached_property
    def _of_time(self) -> bool:
        """True if the value depends on time, so that a retiming cannot hold it."""
        inputs = self._law.sx_in()
        return any(ca.which_depends(self._law(*inputs), inputs[-1], 1, True))

    @property
    def along(self) -> bool:
        """True if a retiming can hold it, which needs a value independent of time."""
        return not self._of_time

    def _shares(self, *columns: np.ndarray, signed: bool) -> np.ndarray:
        """The value over the bound (M, m), at states (M, …) in the order of `State`; its magnitude unless `signed`."""
        found = Batch(self._law, len(columns[0]))(*columns)[0] / self.scale
        return np.asarray(found if signed else np.abs(found))

    def _numbers(self, shares: np.ndarray) -> np.ndarray:
        """The shares themselves; BadInput if one is no number, which would count as kept."""
        if np.isnan(shares).any():
            raise BadInput(f"{self.name}: its value is not a number (nan) on the motion")
        return shares

    def worst(self, x: Dense) -> Violation:
        """The largest value over its bound."""
        used = self._numbers(self.peaked(x))
        return worst_of(self, x, used * self.scale, self.scale, used - 1)

    def peaked(self, x: Dense) -> np.ndarray:
        """Values over bounds, (N, m)."""
        state = x.q, x.v, x.a, x.effort, x.power[:, None], x.time[:, None]
        return self._shares(*state, signed=self.one_sided)

    def scaled(self, share: float) -> Self:
        """The limit with bounds times `share`."""
        out = copy.copy(self)
        out.bound, out.scale = np.asarray(self.bound) * share, self.scale * share
        return out

    def use(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> np.ndarray | None:
        """Values over bounds along a path, (M, m)."""
        return None if self._of_time else self._along(d, a, b, self.one_sided)

    def _along(self, d: PathDynamics, a: np.ndarray, b: np.ndarray, signed: bool) -> np.ndarray:
        """The value over the bound (M, m) along a path; its magnitude unless `signed`."""
        speed, power = np.sqrt(b)[:, None], d.power(a, b)[:, None]
        motion = (d.q, d.q1 * speed, d.q1 * a[:, None] + d.q2 * b[:, None], d.motor_torque(a, b), power)
        return self._shares(*motion, np.zeros_like(power), signed=signed)

    def fixed(self, d: PathDynamics) -> Fixed | None:
        """The value at rest along the path, which no timing changes."""
        if self._of_time:
            return None
        none = np.zeros(len(d.s))
        held = self._numbers(self._along(d, none, none, self.one_sided))

        def text(k: int, j: int) -> str:
            value = f"{held[k, j] * self.scale[j]:.4g} {self.unit}"
            bound = f"{self.scale[j]:.4g} {self.unit}"
            if self._of_position:
                return f"{self.name} is {value}, above its limit of {bound}"
            return f"holding still needs {value}, the limit is {bound}"

        return Fixed(held - 1, text, holding=not self._of_position)

    def tangent(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> Linear | None:
        """The value to first order about (a, b), by central differences.

        A one-sided limit f <= 1 becomes |f + r - 1| <= r with r = ONE_SIDED, so that values far below are free.
        """
        if self._of_time:
            return None
        step_a, step_b = STEP * (1.0 + np.abs(a)), STEP * np.maximum(b, 1e-3)
        b = np.maximum(b, 2 * step_b)

        def at(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            return self._along(d, a, b, signed=True)

        by_a = (at(a + step_a, b) - at(a - step_a, b)) / (2 * step_a)[:, None]
        by_b = (at(a, b + step_b) - at(a, b - step_b)) / (2 * step_b)[:, None]
        rest = at(a, b) - by_a * a[:, None] - by_b * b[:, None]
        if not self.one_sided:
            return Linear(by_a, by_b, rest)
        # f <= 1 as |f + r - 1| <= r: values far below are free
        return Linear(by_a / ONE_SIDED, by_b / ONE_SIDED, (rest + ONE_SIDED - 1) / ONE_SIDED)


class Power(OwnLimit):
    """A bound [W] on the arm's electrical power at the meter, without the meter's errors; above it a controller may
    trip.

    Negative power is always allowed. A plan under several models holds the bound under each.
    """

    name, unit, binds = "power", "W", "arm"
    one_sided = True

    def __init__(self, bound: float) -> None:
        super().__init__(bound)
        self.scale = np.array([float(bound)])

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None, gravity: np.ndarray) -> Self | None:
        """The limit of the setting `max_power`; None if it is not set."""
        return None if settings.max_power is None else cls(settings.max_power).for_robot(robot)

    def for_models(self, count: int) -> Self:
        """The limit for plans under `count` models at once: the bound holds under each."""
        out = copy.copy(self)
        out.scale = np.repeat(self.scale[:1], count)
        return out

    def value(self, x: State) -> ca.SX:
        """The arm's power [W] under each model of the plan: (K, 1)."""
        return ca.repmat(x.power, len(self.scale)) if x.powers is None else x.powers

    def worst(self, x: Dense) -> Violation:
        """The place of a sampled motion with the highest power under any model."""
        return worst_of(self, x, x.powers, np.resize(self.scale, x.powers.shape[1]), self.peaked(x) - 1)

    def peaked(self, x: Dense) -> np.ndarray:
        """Power over bound, (M, K)."""
        return np.asarray(x.powers / self.scale[0])

    def _along(self, d: PathDynamics, a: np.ndarray, b: np.ndarray, signed: bool) -> np.ndarray:
        """Power over bound, (M, K), without a compiled formula."""
        return d.powers(a, b) / self.scale
