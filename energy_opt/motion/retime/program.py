"""From a path, a model and limits to a solved timing, with limits added where a solve broke them, and its proof."""

from __future__ import annotations

import copy
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from energy_opt.motion.limits.base import Limit
from energy_opt.motion.path import JointPath
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.motion.retime.bound import largest_price, least_cost, lower_bound
from energy_opt.motion.retime.limits import MARGIN, PathLimits
from energy_opt.motion.retime.nlp import PathConstraints, RetimeProgram
from energy_opt.motion.retime.points import PathLaw
from energy_opt.motion.retime.quadrature import GAUSS, quadrature
from energy_opt.motion.retime.sums import NARROW, WIDE
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.numerics.bspline import greville
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

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
        # limits that the shortest timing, or a solve's start, uses nearly in full will probably bind
        self.limits.add_broken(shortest.control, always=True)
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
        bounded: bool = False,
    ) -> Solved:
        """Minimise energy - price * duration from a timing on the grid.

        Args:
            price: credit [W] for a second of the duration.
            longest: [s] most, or exactly, the duration.
            floor: no control value falls below this share of the start's largest; near the ends the share is smaller.
            exactly: in exactly `longest` seconds.
            energy: False leaves the energy out, so that only time counts.
            bounded: the longest duration probably binds; else it is left out first.
        """
        drifts = energy and any(effect.drifts for effect in self.model.effects)

        def attempt(start: Timing) -> Solved:
            for timed in (False, True)[exactly or bounded :]:
                found = self._optimise(start, price, longest, floor, timed, exactly, energy)
                if found.solved and found.timing.duration <= longest:
                    break
            return found

        found = attempt(start)
        # time-dependent effects use the times of the previous timing, and the program is scaled by its start
        far = abs(np.log(found.timing.duration / start.duration)) > np.log(FAR_OFF)
        return attempt(found.timing) if drifts or (found.solved and far) else found

    def _scaled(self, start: Timing, price: float, floor: float, energy: bool = True) -> _Scaled:
        """The program of energy - price * duration near a timing, in its own units; see `optimise`."""
        unit, law = float(start.control.max()), self.law(start)
        upper, g = self._upper() / unit, greville(start.knots)[1:-1]
        box = np.minimum(floor * np.minimum(1.0, 4 * g * (1 - g)), 0.5 * upper), upper
        x = np.clip(start.control[1:-1] / unit, *box)
        self.limits.add_broken(start.control, always=True)
        scaled = _Scaled(self, unit, law, box, x, 1.0, float(energy), price)
        cost = scaled.program(PathConstraints(), start.duration).cost(x)
        return replace(scaled, size=max(abs(cost), 1e-3 * abs(price) * start.duration, 1e-12))

    def _optimise(
        self, start: Timing, price: float, longest: float, floor: float, timed: bool, exactly: bool, energy: bool
    ) -> Solved:
        """One solve and its corrections; without `timed`, `longest` is ignored."""
        scaled = self._scaled(start, price, floor, energy)
        x, unit, law = scaled.x, scaled.unit, scaled.law
        width, widened = NARROW, law.coefficients is not None  # True if wide kinks were tried, or there are no kinks
        wide: np.ndarray | None = None  # the answer with wide kinks
        rounds, rough = 0, False
        while True:
            before = time.perf_counter()
            constraints = self.limits.constraints(unit)
            whole = scaled.program(constraints, longest, timed, width)
            self.tally.build += time.perf_counter() - before
            near = wide is not None and width == NARROW
            answer = whole.solve(x, scaled.box, exactly=exactly, near=near)
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
            if not self.limits.add_broken(control) and not self.limits.refine(control):
                break
        timing = Timing(start.path, start.knots, control)
        bound = scaled.bound(whole, x, answer.row_multipliers) if answer.success and not rough else None
        if answer.success and self.limits.worst(control).excess > 1e-6:
            return Solved(self, timing, bound, False, f"limits not held after {ROUNDS} rounds")
        return Solved(self, timing, bound, answer.success, answer.status)

    def relax(self, start: Timing, *, price: float, longest: float, floor: float) -> Solved:
        """The least energy - price * duration in at most `longest` seconds, by Newton steps; see `optimise`.

        If the answer takes less, limits between the grid's points are not checked; the bound remains valid.
        """
        scaled = self._scaled(start, price, floor)
        x = scaled.x
        for _ in range(ROUNDS):
            whole = scaled.program(self.limits.constraints(scaled.unit), longest)
            found = least_cost(whole, x, scaled.box, scaled.allowed)
            x, control = found.x, scaled.unit * whole.control(found.x)
            self.tally.iterations += found.steps
            broken = self.limits.add_broken(control) or (found.multipliers[0] > 0 and self.limits.refine(control))
            if not (broken and found.converged):
                break
        bound = scaled.bound(whole, x, found.multipliers)
        return Solved(self, Timing(start.path, start.knots, control), bound, found.converged and not broken, "")


@dataclass(frozen=True)
class _Scaled:
    """The program of energy - price * duration in units of a timing of its path.

    Attributes:
        unit: of squared speed [1/s^2]. size: of the cost [J].
        box: lowest and highest free control values, (N,) each. x: (N,) those of the timing, within the box.
        energy: 1, or 0 where only time counts. price: [W].
    """

    work: Retiming
    unit: float
    law: PathLaw
    box: tuple[np.ndarray, np.ndarray]
    x: np.ndarray
    size: float
    energy: float
    price: float

    @property
    def allowed(self) -> np.ndarray:
        """(N,) bounds of the free control values from the true velocity limits."""
        return self.box[1] / (1 - MARGIN) ** 2

    def program(
        self, constraints: PathConstraints, longest: float, timed: bool = False, width: float = NARROW
    ) -> RetimeProgram:
        """Args: `longest` duration [s], which holds where `timed`; `width`: factor of the widths of kinks."""
        weight, clock = self.work.grid.weight, 1 / np.sqrt(self.unit)  # [s] the program's unit of time
        factors = self.energy * clock / self.size, -self.price * clock / self.size
        cost = self.law.cost(weight, self.unit, *factors, width)
        lift, ends = self.work.limits.lift, self.work.ends / self.unit
        return RetimeProgram(lift, weight, cost, ends, longest / clock, constraints, timed)

    def bound(self, program: RetimeProgram, x: np.ndarray, multipliers: np.ndarray) -> float | None:
        """A lower bound [J]; None unless cost and limits are convex, as weak duality needs."""
        if not self.work.convex or program.held_constraints.curved:
            return None
        bound = lower_bound(program, x, multipliers, self.allowed) * self.size
        if self.law.coefficients is None:
            bound += self.law.smoothing(program.lift.values(program.control(x)), self.unit, self.work.grid.weight)
        return bound
