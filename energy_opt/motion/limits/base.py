"""The interface of a limit: a bound on a motion, and how judge, retiming and reshaping use it.

Everything that checks or holds limits loops over a list of `Limit` objects and calls the methods it can use; a limit
overrides only the methods that apply to it. A new limit is one class and its line in `registry`; `own.OwnLimit` derives
everything from one formula.

    caller                     calls                result
    judge (certificate)        worst(dense)         the worst place of a sampled motion, by the exact laws
    repair                     scaled(share)        the same limit with a smaller bound
    path check                 fixed(d)             excess that no timing of a path can change: position, holding torque
    retiming, minimum time     linear(d, b)         |ra a + rb b + r0| <= 1, a path acceleration, b squared path speed
                               tangent(d, a, b)     the same to first order, for limits that are not linear
                               functions(path, s)   |f(a, b, w)| <= 1 in NumPy, for limits that need w = da/ds
                               expression(x, p)     else: compiled with the power law at the path's points
    reshaping                  box(n)               bounds of control points: a spline lies in their hull
                               order, bound         constraints on the control points of the derivative of that order
                               expression(x, p)     symbolic constraints at nodes, of (q, v, a, effort, power, t)
                               places(curve)        numeric constraints of position (`PlaceConstraints`)
                               excess_at(q)         excess of positions over such constraints
                               via                  points to pass, at times of the solver's choice

Symbolic constraints are compiled and differentiated with the model's node functions: they may depend on the whole state
and need no evaluation in Python. Their numbers (a bound, a reference pose) are either `scale`, by which the constraints
are divided outside, or `values`, which enter as `p`; changing these builds nothing anew, only `structure` does.

Numeric constraints (`PlaceConstraints`) are for values without a short expression graph: distances between bodies. They
depend only on the position at their place, are evaluated for all constraints at once, and enter the banded Hessian
through the B-splines that are not zero there. `places` is called at every linearisation, so what is frozen in one is
renewed in the next.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

import casadi as ca
import numpy as np

from energy_opt.motion.dense import Dense
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path import JointPath
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.robot import Robot

NOTHING = np.zeros(0)


@dataclass(frozen=True)
class Violation:
    """The place where a limit is used most.

    Attributes:
        excess: beyond the bound, as a fraction of it (<= 0 is inside, -1 unused); None if it is unknown.
        where: the joint, or the other limited part.
        time: s; value and bound in the limit's unit.
    """

    limit: str
    excess: float | None
    where: str
    time: float
    value: float
    bound: float


@dataclass(frozen=True)
class State:
    """A motion at one instant as CasADi columns: q, v, a (n, 1); the motors' torque (n, 1); power [W]; time [s].

    `powers` (K, 1) [W]: under each of the models of the plan; None if unknown.
    """

    q: ca.SX
    v: ca.SX
    a: ca.SX
    effort: ca.SX
    power: ca.SX
    t: ca.SX
    powers: ca.SX | None = None


@dataclass(frozen=True)
class Fixed:
    """Excess (M, m) along a path that no timing changes; `text(k, j)` describes the fault at place k in column j.

    `holding`: it is that of standing still, and does not matter where the arm moves through.
    """

    excess: np.ndarray
    text: Callable[[int, int], str]
    holding: bool = False


@dataclass(frozen=True)
class Linear:
    """|ra a + rb b + r0| <= 1 along a path, (M, m) each, in units of the bound."""

    ra: np.ndarray
    rb: np.ndarray
    r0: np.ndarray

    def use(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Used share of the bound (M, m) at path accelerations and squared speeds (M,)."""
        return np.abs(self.ra * a[:, None] + self.rb * b[:, None] + self.r0)

    @property
    def of_speed(self) -> bool:
        """True if it bounds only the speed."""
        return not (self.ra.any() or self.r0.any())

    @property
    def fastest(self) -> np.ndarray:
        """The largest squared speed (M,) within a limit of only the speed."""
        return 1 / np.maximum(self.rb.max(axis=1), 1e-24)


class Functions(Protocol):
    """Functions of z (d, K) at K points, r of them at each, in units of their bounds; Hessians as upper triangles.

    z is (a, b), or (a, b, w). A triangle is listed column by column: (aa, ab, bb) or (aa, ab, bb, aw, bw, ww).
    """

    def value(self, z: np.ndarray) -> np.ndarray:
        """(K, r)."""

    def slope(self, z: np.ndarray) -> np.ndarray:
        """(K, r, d)."""

    def curvature(self, z: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """Sum of the functions' Hessians times multipliers (K, r), (d (d + 1) / 2, K)."""


class PlaceConstraints(Protocol):
    """R numeric constraints lower <= f <= upper on the positions at K places of a curve.

    The same array q is passed to `value`, `gradient` and `hessian` of one iterate: cache shared results by `q is …`.

    Attributes:
        u: (K,) the places, in [0, 1] of the duration, anywhere and in any order.
        place: (R,) the place of each constraint.
        lower, upper: (R,) bounds; constraints should be of order one near them (divide distances by a length).
        keys: (R,) integers that identify constraints (body pair and place), so that multipliers carry over to the
            next round.
    """

    u: np.ndarray
    place: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    keys: np.ndarray

    def value(self, q: np.ndarray) -> np.ndarray:
        """(R,) at positions q (K, n)."""

    def gradient(self, q: np.ndarray) -> np.ndarray:
        """(R, n) with respect to the position at each constraint's place."""

    def hessian(self, q: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """(K, n, n), at each place the sum of its constraints' Hessians times multipliers (R,)."""


class Limit:
    """Base of all limits; an instance holds its bounds and is never changed.

    Attributes:
        name: as in messages and `max_violation`; unit: of value and bound.
        order: of the derivative of position whose control points `bound` (n,) bounds, with both signs; 0: none.
        scale: (m,) divisors of symbolic constraints, which bring them to [-1, 1]; inf: no bound. Empty: no such
            constraints.
        one_sided: symbolic constraints have no lower bound.
        squared: `linear` and `use` refer to the square of the limited value.
        everywhere: a reshaping holds symbolic constraints at all nodes from the beginning, not only where they
            were broken.
        local: `tangent` is useful only about a timing that is inside the limit.
        inner: `tangent` allows less than the limit, so a fastest timing within it is not the fastest.
        values: numbers that `expression` gets as its p.
        via: (vias, n) points to pass, in order.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    order: ClassVar[int] = 0
    one_sided: ClassVar[bool] = False
    squared: ClassVar[bool] = False
    local: ClassVar[bool] = False
    inner: ClassVar[bool] = False
    everywhere: ClassVar[bool] = False
    bound: np.ndarray = NOTHING
    scale: np.ndarray = NOTHING
    values: np.ndarray = NOTHING
    via: np.ndarray = np.zeros((0, 0))

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None, gravity: np.ndarray) -> Self | None:
        """The limit that settings or move ask for, with gravity (3,) [m/s^2] in the base frame; None for none.

        Without a move, a limit of the same structure, used to build expressions.
        """
        return None

    @property
    def structure(self) -> Hashable:
        """Key of everything that built expressions depend on, except `values` and `scale`."""
        return type(self).__name__

    @property
    def along(self) -> bool:
        """True if a retiming can hold it; limits with only symbolic constraints need reshaping."""
        own = type(self)
        none = Limit.use, Limit.linear, Limit.functions, Limit.fixed
        seen = (own.use, own.linear, own.functions, own.fixed) != none
        return seen or own.expression is Limit.expression

    def where(self, joints: Sequence[str], column: int) -> str:
        """The name of the joint, or other part, that a column of values belongs to."""
        return joints[column]

    def worst(self, x: Dense) -> Violation:
        """The place where a sampled motion uses the limit most, by the exact laws."""
        raise NotImplementedError

    def peaked(self, x: Dense) -> np.ndarray | None:
        """Used shares (N, m) at places (N,) of a limit whose peaks may be narrower than their spacing; 1 at the
        bound.
        """
        return None

    def scaled(self, share: float) -> Self:
        """The limit with `share` of its bound, if its bound can be reduced."""
        return self

    def least_duration(self, poses: np.ndarray, resting: bool) -> float:
        """A duration [s] that every motion through poses (K, n), in order, exceeds; 0 if none is known.

        `resting`: the motion begins and ends at rest.
        """
        return 0.0

    def for_models(self, count: int) -> Self:
        """The limit for plans under `count` models at once."""
        return self

    def fixed(self, d: PathDynamics) -> Fixed | None:
        """The excess that no timing of a path can repair."""
        return None

    def linear(self, d: PathDynamics, b: float) -> Linear | None:
        """The limit along a path if it is linear in a and b; `b` is a typical squared speed there."""
        return None

    def tangent(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> Linear | None:
        """The limit to first order about (a, b), (M,) each; None if that is not useful."""
        return self.linear(d, float(np.max(b)))

    def functions(self, path: JointPath, s: np.ndarray) -> Callable[[np.ndarray, np.ndarray, float], Functions] | None:
        """The limit as a function of (a, b, w) at s (M,): from places k and columns j (K,), and the unit of a, b and w
        [1/s^2], to the functions there.
        """
        return None

    def use(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> np.ndarray | None:
        """Used share of the bound (M, m) along a path, by the exact laws; None if (a, b) do not determine it."""
        line = self.linear(d, float(np.max(b)))
        return None if line is None else line.use(a, b)

    def box(self, n: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Bounds (n,) of all control points."""
        return None

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        """Symbolic constraints (m, 1) at a node, in the unit of `scale`."""
        raise NotImplementedError

    def excess_at(self, q: np.ndarray) -> float:
        """The largest excess at positions (M, n), for limits with numeric constraints; else -inf."""
        return -np.inf

    def places(self, curve: Callable[[np.ndarray], np.ndarray]) -> PlaceConstraints | None:
        """Numeric constraints near a curve, which gives positions (K, n) at u (K,); called at every linearisation."""
        return None


def worst_of(limit: Limit, x: Dense, value: np.ndarray, bound: np.ndarray, excess: np.ndarray) -> Violation:
    """The place of the largest excess (N, m) of values (N, m) over bounds (m,)."""
    k, j = np.unravel_index(int(np.argmax(excess)), excess.shape)
    where, at = limit.where(x.joints, int(j)), (float(x.time[k]), float(value[k, j]), float(bound[j]))
    return Violation(limit.name, float(excess[k, j]), where, *at)


def box_of(limits: Sequence[Limit], n: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds (n,) of control points under all limits."""
    boxes = [box for limit in limits if (box := limit.box(n)) is not None]
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    for low, high in boxes:
        lower, upper = np.maximum(lower, low), np.minimum(upper, high)
    return lower, upper


def values_of(limits: Sequence[Limit], width: float = 1.0) -> np.ndarray:
    """The input (V + 1,) of node functions after the model's values: the limits' numbers, and the width of kinks.

    Args:
        width: factor of the widths over which kinks of laws are smoothed.
    """
    return np.concatenate([NOTHING, *(limit.values for limit in limits), [width]])


def scaled(limits: Sequence[Limit], share: float) -> tuple[Limit, ...]:
    """All limits with `share` of their bounds."""
    return tuple(limit.scaled(share) for limit in limits)
