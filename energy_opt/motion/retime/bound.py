"""The proof that a retiming is optimal: convexity follows from the law's coefficients, a lower bound from weak duality.

With the power in its nine monomials (`drive_law`), a point's share of the energy is, up to terms linear in (a, b),

    [k3 a^2 + k4 a b + k5 b^2 + k1 a + k2 b + k0 - price] / sqrt(b)

where `price` is the credit for a second of the duration. Completing the square in a leaves
R(b) = r0 + r1 b + r2 b^2, and since (square of an affine function) / sqrt(b) is convex, the share is convex on
0 < b <= B if and only if 3 (r0 - price) - r1 b + 3 r2 b^2 >= 0 there
(4 b^(5/2) times the second derivative of (R - price) / sqrt(b)).

The convex program is solved by Newton steps, each of which is a quadratic program with the linearised limits. The
constraint T <= T_ref touches all control values, so it is held by the price of T in the cost, which is found by
secant steps. A quadratic program takes 0.2 ms, a solve by IPOPT ten.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from energy_opt.motion.retime.nlp import RetimeProgram, Values
from energy_opt.numerics.native import LOCAL
from energy_opt.numerics.quadratic import Banded, Constraints, minimise

STEPS = 20  # most Newton steps
SHRINK, GROW = (
    -0.6,
    1.5,
)  # a step changes control values by these shares of them at most: 1 / sqrt(b) is far from square
CLOSE = 1e-4  # relative distance of cost and bound at which the steps end
SETTLED = 1e-7  # share of the cost: the steps end where the next one is expected to save less
ON_TIME = 1e-8  # relative: an excess of the duration that counts as none
FIRST = 0.05  # change of the price, for a cost of order one, where it is not known how T depends on it
PRICES = 4  # most prices of T tried in a step
TOLERANCE = 1e-9  # barrier parameter at which a quadratic program ends, for a cost of order one
EXCESS_PRICE = 1e3  # cost of exceeding a limit by itself, for a cost of order one: far above the limits' multipliers


def largest_price(k: np.ndarray, upper: np.ndarray) -> float:
    """The largest price [W] at which every point's cost is convex on 0 < b <= upper; -inf if there is none.

    Args:
        k: (9, M) coefficients of the power's monomials.
        upper: (M,) bounds of b, in the unit of the coefficients.
    """
    k0, k1, k2, k3, k4, k5 = k[:6]
    size = np.abs(k[:6]).max()
    flat = k3 <= 1e-12 * size
    if (np.abs(np.stack([k1, k4]))[:, flat] > 1e-9 * size).any():
        return -np.inf
    safe = np.where(flat, 1.0, k3)
    r0 = k0 - np.where(flat, 0, k1**2 / (4 * safe))
    r1 = k2 - np.where(flat, 0, k1 * k4 / (2 * safe))
    r2 = k5 - np.where(flat, 0, k4**2 / (4 * safe))
    # least value of r2 b^2 - r1 b / 3 on [0, upper]: at the vertex if it is inside, else at an end
    vertex = np.clip(np.divide(r1, 6 * r2, out=np.zeros_like(r1), where=np.abs(r2) > 1e-300), 0, upper)
    at = np.stack([np.zeros_like(upper), vertex, upper])
    return float((r0 + (r2 * at**2 - r1 * at / 3).min(axis=0)).min())


def lower_bound(program: RetimeProgram, x: np.ndarray, multipliers: np.ndarray, allowed: np.ndarray) -> float:
    """A lower bound of the cost of all feasible timings on the grid, for a convex cost and linear constraints.

    The Lagrangian at the multipliers found (of the right signs) is convex, hence nowhere below its tangent at x; the
    tangent's least value over 0 <= control <= allowed is the bound. Only the signs of the multipliers are assumed:
    inaccurate x and multipliers give a lower, still valid bound.

    Args:
        x: (N,) free control values.
        multipliers: of T / T_ref and of the constraints.
        allowed: (N,) bounds from the true velocity limits, instead of the program's bounds.
    """
    here = program.at(x)
    of_time, of_constraints = max(float(multipliers[0]), 0.0), multipliers[1:]
    value = here.cost + of_time * (here.time - 1)
    slope = here.slope + of_time * here.time_slope
    linear = program.held_constraints.linear
    if linear is not None:
        value += float(of_constraints @ here.constraints - np.abs(of_constraints) @ linear.allowed)
        slope = slope + linear.adjoint(of_constraints)
    return value + float(np.minimum(-slope * x, slope * (allowed - x)).sum())


@dataclass(frozen=True)
class Minimum:
    """The least cost of a program with T <= T_ref.

    Attributes:
        x: (N,) free control values. multipliers: (1 + R,) of T / T_ref and of the constraints.
        converged: whether the steps ended by themselves. steps: their number.
    """

    x: np.ndarray
    multipliers: np.ndarray
    converged: bool
    steps: int


def least_cost(
    program: RetimeProgram, x: np.ndarray, box: tuple[np.ndarray, np.ndarray], allowed: np.ndarray
) -> Minimum:
    """The least cost with T <= T_ref by Newton steps from x (N,), with control values within `box`, (N,) each.

    Args:
        allowed: (N,) see `lower_bound`, which ends the steps where it applies and T has no price.
    """
    held, n = program.held_constraints, len(x)
    count, none = held.count, np.zeros((n, 0))
    index = np.arange(count)
    coefficient, at_joint, border = np.zeros((count, LOCAL)), np.zeros(count, dtype=int), np.zeros((count, 0))
    metric = Banded(np.pad(np.ones((n, 1)), ((0, 0), (0, LOCAL - 1))), none, np.zeros((0, 0)))
    multipliers, slope = np.zeros(1 + count), 0.0
    for steps in range(STEPS):
        here = program.at(x)
        free = multipliers[0] == 0 and here.time <= 1 and not held.curved
        if free and here.cost - lower_bound(program, x, multipliers, allowed) < CLOSE * abs(here.cost):
            return Minimum(x, multipliers, True, steps)
        upper = program.banded_hessian(x, 1.0, multipliers).reshape(n, 3)
        band = np.zeros((n, LOCAL))  # from columns of the upper triangle to columns of the lower one
        band[:, 0], band[:-1, 1], band[:-2, 2] = upper[:, 2], upper[1:, 1], upper[2:, 0]
        coefficient[:, :3] = held.slopes(program.control(x))
        floor, ceiling = held.lower - here.constraints, 1.0 - here.constraints
        linear = Constraints.of(
            1, 0, first=held.first - 1, joint=at_joint, coefficient=coefficient, border=border, floor=floor,
            ceiling=ceiling, keys=index,
        )  # fmt: skip
        reach = np.maximum(box[0] - x, SHRINK * x), np.minimum(box[1] - x, GROW * x)
        hessian = Banded(band, none, np.zeros((0, 0)))
        step = _Linearised(here, hessian, reach, linear, metric).step
        try:
            taken, slope = _in_time(step, float(multipliers[0]), slope)
        except np.linalg.LinAlgError:  # no damping makes the program convex, because numbers overflowed
            return Minimum(x, multipliers, False, steps)
        x, multipliers = x + taken.d, np.append(taken.price, taken.multipliers)
        if abs(taken.saved) < SETTLED * abs(here.cost) and (taken.price == 0 or abs(here.time - 1) < ON_TIME):
            return Minimum(x, multipliers, True, steps + 1)
    return Minimum(x, multipliers, False, STEPS)


@dataclass(frozen=True)
class _Linearised:
    """The quadratic program of a Newton step; see `quadratic.minimise`.

    `here`: of the program, where it is linearised.
    """

    here: Values
    hessian: Banded
    reach: tuple[np.ndarray, np.ndarray]
    constraints: Constraints
    metric: Banded

    def step(self, price: float) -> _Step:
        """The step at a price of T / T_ref."""
        here, limits = self.here, self.constraints
        gradient = here.slope + price * here.time_slope
        found = minimise(self.hessian, gradient, self.reach, limits, EXCESS_PRICE, self.metric, tolerance=TOLERANCE)
        late = here.time - 1 + float(here.time_slope @ found.d)
        return _Step(price, late, found.d, found.multipliers, found.saved)


@dataclass(frozen=True)
class _Step:
    """A Newton step d (N,) at a price of T / T_ref: T / T_ref - 1 after it (linearised), and what it saves."""

    price: float
    late: float
    d: np.ndarray
    multipliers: np.ndarray
    saved: float

    def mixed(self, other: _Step) -> _Step:
        """The mean of two steps, of which one is too long and one too short, that takes T_ref."""
        share = self.late / (self.late - other.late)
        mean = [(1 - share) * x + share * y for x, y in zip(self._parts, other._parts, strict=True)]
        return _Step(mean[0], 0.0, *mean[1:])

    @property
    def _parts(self) -> tuple[Any, ...]:
        return self.price, self.d, self.multipliers, self.saved


def _in_time(step: Callable[[float], _Step], price: float, slope: float) -> tuple[_Step, float]:
    """The step of the least price of at least 0 that takes T_ref at most, by secants from `price`.

    T falls with its price.

    Args:
        slope: of T / T_ref by its price, negative; 0 if it is not known.

    Returns:
        the step and the slope found.
    """
    last = step(price)
    before, after = (last, None) if last.late > 0 else (None, last)  # too long, short enough
    for _ in range(PRICES):
        if abs(last.late) < ON_TIME or (last.price == 0 and last.late <= 0):
            break
        far = np.copysign(max(last.price, FIRST), last.late)
        guess = last.price + (-last.late / slope if slope < 0 else far)
        tried = step(max(float(guess), 0.0))
        if tried.price != last.price:
            slope = min((tried.late - last.late) / (tried.price - last.price), 0.0)
        last = tried
        before, after = (last, after) if last.late > 0 else (before, last)
    if before is not None and after is not None and min(before.late, -after.late) > ON_TIME:
        return before.mixed(after), slope
    return last, slope
