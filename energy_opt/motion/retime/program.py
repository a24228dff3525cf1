"""From a path, a model and limits to a solved timing, with limits added where a solve broke them, and its proof.

The proof that a retiming is optimal: convexity follows from the law's coefficients, a lower bound from weak duality.

With the power in its nine monomials (`drive_law`), a point's share of the energy is, up to terms linear in (a, b),

    [k3 a^2 + k4 a b + k5 b^2 + k1 a + k2 b + k0 - price] / sqrt(b)

where `price` is the credit for a second of the duration. Completing the square in a leaves
R(b) = r0 + r1 b + r2 b^2, and since (square of an affine function) / sqrt(b) is convex, the share is convex on
0 < b <= B if and only if 3 (r0 - price) - r1 b + 3 r2 b^2 >= 0 there
(4 b^(5/2) times the second derivative of (R - price) / sqrt(b)).
"""

from __future__ import annotations

import copy
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from energy_opt.motion.limits.base import Limit
from energy_opt.motion.path import JointPath
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.motion.retime.limits import MARGIN, PathLimits
from energy_opt.motion.retime.nlp import PathConstraints, RetimeProgram
from energy_opt.motion.retime.points import PathLaw
from energy_opt.motion.retime.quadrature import GAUSS, quadrature
from energy_opt.motion.retime.sums import NARROW, WIDE
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.numerics.bspline import greville
from energy_opt.power import PowerModel
from energy_opt.robot import Robot


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


ROUNDS = 12  # most rounds of adding constraints
INFEASIBLE = "Infeasible_Problem_Detected"  # IPOPT's status
# Share of a price above standby power that is used: at the price itself, creeping at one place would cost nothing.
CREDIT = 0.99
FAR_OFF = 5.0  # factor between the durations of start and result from which the program is scaled anew
ROOM = 1.1  # factor of a bound that follows from others, so that it does not bind as well
RESOLVED = 1e-6  # relative: if the grid's duration differs from the true one by more, energy is integrated anew


@dataclass
class Tally:
    """The effort of all solves together; build in seconds."""

    iterations: int = 0
    build: float = 0.0


@dataclass(frozen=True)
class Solved:
    """An optimised timing.

    Attributes:
        bound: proven, below energy - price * duration [J] of all timings on the grid; None if nothing is proven.
        solved: the solver converged and all limits hold. status: its own word for how it ended, or what fails.
    """

    work: Retiming
    timing: Timing
    bound: float | None
    solved: bool
    status: str

    @cached_property
    def energy(self) -> float:
        """Energy [J] by the exact laws."""
        return self.work.energy(self.timing)


def standing_power(robot: Robot, model: PowerModel, path: JointPath) -> float:
    """Power [W] of standing still at the start of a path."""
    d = PathDynamics(robot, model, path, np.zeros(1))
    return float(d.power(np.zeros(1), np.zeros(1))[0])


class Retiming:
    """The retiming of one path: its grid, limits and model, and the data that its solves share."""

    def __init__(self, robot: Robot, model: PowerModel, shortest: Timing, limits: Sequence[Limit]) -> None:
        self.robot, self.model, self.shortest = robot, model, shortest
        self.ends = shortest.control[[0, -1]]
        self.rest = (bool(self.ends[0] == 0), bool(self.ends[1] == 0))
        self.grid = quadrature(shortest.knots, self.rest)
        self.dynamics = PathDynamics(robot, model, shortest.path, self.grid.s)
        self.limits = PathLimits(self.dynamics, shortest.knots, limits, float(shortest.control.max()))
        self.speed_bound = self.limits.speed_bound
        self.tally = Tally()
        self._law: PathLaw | None = None

    def with_model(self, model: PowerModel) -> Retiming:
        """The same for another model with the same payload and tilt; the limits found and the tally are shared."""
        other = copy.copy(self)
        other.model, other.dynamics, other._law = model, self.dynamics.under(model), None
        return other

    @property
    def convex(self) -> bool:
        """Do the model's effects keep retiming convex (without jerk limits)?"""
        return all(effect.convex_in_retiming for effect in self.model.effects)

    def convex_price(self) -> float:
        """The largest credit [W] for a second of the duration at which the cost is known to be convex."""
        least = self.model.constant_power(self.robot.n)
        law = self.law(self.shortest)
        if law.coefficients is None:
            return least
        return least + CREDIT * max(0.0, largest_price(law.coefficients, self.speed_bound / law.unit) - least)

    def energy(self, timing: Timing) -> float:
        """Energy [J] by the exact laws: by the grid's quadrature if its duration is accurate, else integrated anew."""
        a, b = z = self.limits.lift.values(timing.control)
        pace = self.grid.weight / np.sqrt(b)
        if abs(pace.sum() / timing.duration - 1) > RESOLVED:
            return self._integrated(timing)
        law = self.law(timing)
        if law.coefficients is not None and self.convex:  # no kinks for which the program assumes a sign
            return law.cost(self.grid.weight, 1.0, 1.0, 0.0, 0.0).value(z)[0]
        return float(pace @ self.dynamics.power(a, b, timing.time_at(self.grid.s)))

    def _integrated(self, timing: Timing) -> float:
        """Energy [J] by the exact laws, by Gauss quadrature in time within every piece of timing and path."""
        edges = np.unique(np.concatenate([timing.times, timing.time_at(timing.path.knots[1:-1])]))
        step = np.diff(edges)
        time = (edges[:-1, None] + step[:, None] * GAUSS[0]).ravel()
        s, rate, a = timing.at(time)
        return float((step[:, None] * GAUSS[1]).ravel() @ self.dynamics.at(s).power(a, rate**2, time))

    def law(self, timing: Timing) -> PathLaw:
        """The law at the grid's points; if it depends on time, at the times of `timing` there."""
        drifts = any(effect.drifts for effect in self.model.effects)
        if self._law is None or drifts:
            at = timing.time_at(self.grid.s) if drifts else np.zeros(len(self.grid.s))
            self._law = PathLaw.of(self.model, self.dynamics, float(self.shortest.control.max()), at)
        return self._law

    def _upper(self) -> np.ndarray:
        """Bounds of the free control values: the largest that the velocity limits allow nearby.

        On a straight path these are the velocity limits, which then need no constraints; on others they are looser, and
        constraints hold the limits. On a straight path, the control polygon's slope is also twice the path acceleration
        at a knot, so control values rise from either end no faster than the acceleration limits allow; a little more is
        allowed, so that this never binds.
        """
        first = self.limits.lift.first
        count = len(self.shortest.control)
        most, least = np.zeros(count), np.full(count, np.inf)
        for k in range(3):
            np.maximum.at(most, first + k, self.speed_bound)
            np.minimum.at(least, first + k, self.speed_bound)
        upper = np.minimum(2 * most - least, self.limits.even_bound)
        if np.isfinite(self.limits.steepest):
            g = greville(self.shortest.knots)
            for end, away in zip(self.ends, (g, 1 - g), strict=True):
                upper = np.minimum(upper, ROOM * (end + 2 * self.limits.steepest * away))
        return upper[1:-1]

    def optimise(
        self,
        start: Timing,
        *,
        price: float,
        longest: float,
        floor: float,
        exactly: bool = False,
        energy: bool = True,
        only_bound: bool = False,
        bounded: bool = False,
    ) -> Solved:
        """Minimise energy - price * duration from a timing on the grid.

        Args:
            price: credit [W] for a second of the duration.
            longest: [s] most, or exactly, the duration.
            floor: no control value falls below this share of the start's largest; near the ends the share is smaller.
            exactly: in exactly `longest` seconds.
            energy: False leaves the energy out, so that only time counts.
            only_bound: limits between the grid's points are not checked and the solver stops early: the bound remains
                valid.
            bounded: the longest duration probably binds; else it is left out first.
        """
        drifts = energy and any(effect.drifts for effect in self.model.effects)

        def attempt(start: Timing) -> Solved:
            for timed in (False, True)[exactly or only_bound or bounded :]:
                found = self._optimise(start, price, longest, floor, timed, exactly, energy, only_bound)
                if found.solved and found.timing.duration <= longest:
                    break
            return found

        found = attempt(start)
        # time-dependent effects use the times of the previous timing, and the program is scaled by its start
        far = abs(np.log(found.timing.duration / start.duration)) > np.log(FAR_OFF)
        return attempt(found.timing) if drifts or (found.solved and far) else found

    def _optimise(
        self,
        start: Timing,
        price: float,
        longest: float,
        floor: float,
        timed: bool,
        exactly: bool,
        energy: bool,
        only_bound: bool,
    ) -> Solved:
        """One solve and its corrections; without `timed`, `longest` is ignored."""
        unit = float(start.control.max())
        clock = 1 / np.sqrt(unit)  # [s] the program's unit of time
        weight, points = self.grid.weight, self.limits.lift
        law = self.law(start)
        ends, upper = self.ends / unit, self._upper() / unit
        g = greville(start.knots)[1:-1]
        lower = np.minimum(floor * np.minimum(1.0, 4 * g * (1 - g)), 0.5 * upper)
        x = np.clip(start.control[1:-1] / unit, lower, upper)
        size = 1.0

        def program(constraints: PathConstraints, width: float) -> RetimeProgram:
            cost = law.cost(weight, unit, clock * energy / size, -price * clock / size, width)
            return RetimeProgram(points, weight, cost, ends, longest / clock, constraints, timed)

        whole = program(PathConstraints(), NARROW)
        size = max(abs(whole.cost(x)), 1e-3 * abs(price) * start.duration, 1e-12)
        # limits that the shortest timing or the start uses nearly in full will probably bind
        self.limits.add_broken(self.shortest.control, always=True)
        self.limits.add_broken(start.control, always=True)
        width, widened = NARROW, law.coefficients is not None  # True if wide kinks were tried, or there are no kinks
        wide: np.ndarray | None = None  # the answer with wide kinks
        rounds, rough = 0, False
        while True:
            before = time.perf_counter()
            constraints = self.limits.constraints(unit)
            whole = program(constraints, width)
            self.tally.build += time.perf_counter() - before
            near = wide is not None and width == NARROW
            answer = whole.solve(
                x, (lower, upper), exactly=exactly, near=near, loosely=only_bound and law.coefficients is not None
            )
            self.tally.iterations += answer.iterations
            if not (answer.success or widened or answer.status == INFEASIBLE):
                width, widened = WIDE, True
                continue
            if width == WIDE and answer.success and not rough:
                width, x, wide = NARROW, answer.x, answer.x
                continue
            if not answer.success and wide is not None and not rough:  # keep the answer with wide kinks
                width, x, rough = WIDE, wide, True
                continue
            x = answer.x
            control = unit * whole.control(x)
            rounds += 1
            if not answer.success or rounds == ROUNDS:
                break
            if not self.limits.add_broken(control) and (only_bound or not self.limits.refine(control)):
                break
        timing = Timing(start.path, start.knots, control)
        # weak duality needs a convex cost and linear constraints
        bound = None
        if answer.success and self.convex and not constraints.curved and not rough:
            allowed = upper / (1 - MARGIN) ** 2
            bound = lower_bound(whole, x, answer.row_multipliers, allowed) * size
            if law.coefficients is None:
                bound += law.smoothing(points.values(whole.control(x)), unit, weight)
        if answer.success and self.limits.worst(control).excess > 1e-6:
            return Solved(self, timing, bound, False, f"limits not held after {ROUNDS} rounds")
        return Solved(self, timing, bound, answer.success, answer.status)
