"""From a path, a model and limits to a solved timing: a move's numbers, and limits added where a solve broke them."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.motion.path import JointPath
from energy_opt.motion.path_dynamics import PathDynamics, SharedByStructure
from energy_opt.motion.retime_bound import largest_price, lower_bound
from energy_opt.motion.retime_grid import GAUSS, quadrature
from energy_opt.motion.retime_limits import MARGIN, PathLimits, point_numbers
from energy_opt.motion.retime_problem import Answer, Move, program
from energy_opt.motion.retime_terms import (
    BLURS,
    Terms,
    compressed,
    compressed_terms,
    exact_power,
    general_terms,
    law_function,
)
from energy_opt.motion.timing_law import Timing, greville
from energy_opt.power import PowerModel
from energy_opt.robot import Limits, Robot

ROUNDS = 12  # of adding constraints
# Share of a price above standby that is used: at the price itself, creeping at one place would cost nothing.
CREDIT = 0.99
RESOLVED = 1e-6  # relative: where the grid's duration is farther from the true one, energy is integrated anew
DRIFTING = ("standby_drift", "winding_temperature")  # effects that depend on time itself


@dataclass
class Tally:
    """What all solves together took."""

    iterations: int = 0
    build: float = 0.0
    solve: float = 0.0

    def add(self, answer: Answer) -> None:
        """Count one solve."""
        self.iterations += answer.iterations
        self.build += answer.build_seconds
        self.solve += answer.solve_seconds


@dataclass(frozen=True)
class Solved:
    """An optimised timing, its energy [J] by the exact laws, and a proven bound of energy - price * duration [J]."""

    timing: Timing
    energy: float
    bound: float | None
    solved: bool
    status: str


def standing_power(robot: Robot, model: PowerModel, path: JointPath) -> float:
    """Power [W] of standing still at the start."""
    d = PathDynamics(robot, model, path, np.zeros(1))
    return float(_power(d, np.zeros(1), np.zeros(1), np.zeros(1))[0])


def _power(d: PathDynamics, a: np.ndarray, b: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Power (M,) [W] by the exact laws, at path acceleration a, squared speed b and time (M,)."""
    a, b = a[:, None], b[:, None]
    columns = (d.q, d.q1 * np.sqrt(b), d.q1 * a + d.q2 * b, d.M * a + d.C * b + d.G, time[:, None])
    n = d.robot.n
    values = np.repeat(d.model.values(n)[:, None], len(d.s), axis=1)
    return np.array(exact_power(SharedByStructure(d.model), n)(*(x.T for x in columns), values)).ravel()


class Retiming:
    """The retiming of one path: its grid, limits and model, and all that its solves share."""

    def __init__(self, robot: Robot, model: PowerModel, shortest: Timing, limits: Limits, jerk: bool) -> None:
        self.robot, self.model, self.shortest = robot, model, shortest
        self.ends = shortest.control[[0, -1]]
        self.rest = (bool(self.ends[0] == 0), bool(self.ends[1] == 0))
        self.grid = quadrature(shortest.knots, self.rest)
        self.dynamics = PathDynamics(robot, model, shortest.path, self.grid.s)
        self.limits = PathLimits(self.dynamics, shortest.knots, limits, jerk)
        self.speed_bound = self.dynamics.speed_bound(self.limits.limits.velocity)
        self.tally = Tally()

    def with_model(self, model: PowerModel) -> Retiming:
        """The same for another model with the same payload and tilt; limits found and tallies are shared."""
        other = copy.copy(self)
        other.model, other.dynamics = model, self.dynamics.under(model)
        return other

    @property
    def convex(self) -> bool:
        """Do the model's effects keep retiming convex (jerk limits aside)?"""
        return all(effect.convex_in_retiming for effect in self.model.effects)

    def convex_price(self) -> float:
        """The largest credit [W] for a second of the duration with which the cost is known to be convex."""
        standby, supply = self.model.get("standby"), self.model.get("supply_efficiency")
        least = 0.0 if standby is None else float(standby.values["power"][0])
        if supply is not None:
            least /= float(supply.values["eta"][0])
        unit = float(self.shortest.control.max())
        terms, numbers, _ = self._law(unit, self.shortest)
        if terms is not compressed_terms():
            return least
        return least + CREDIT * max(0.0, largest_price(numbers, self.speed_bound / unit) - least)

    def energy(self, timing: Timing) -> float:
        """J by the exact laws, by Gauss quadrature in time within every piece of timing and path."""
        edges = np.unique(np.concatenate([timing.times, timing.time_at(timing.path.knots[1:-1])]))
        step = np.diff(edges)
        time = (edges[:-1, None] + step[:, None] * GAUSS[0]).ravel()
        s, rate, a = timing.at(time)
        d = PathDynamics(self.robot, self.model, timing.path, s)
        return float((step[:, None] * GAUSS[1]).ravel() @ _power(d, a, rate**2, time))

    def _grid_energy(self, timing: Timing) -> float:
        """J by the exact laws, by the program's own quadrature."""
        a, b = self.limits.grid.lift.values(timing.control)
        power = _power(self.dynamics, a, b, timing.time_at(self.grid.s))
        return float((self.grid.weight / np.sqrt(b)) @ power)

    def _law(self, unit: float, start: Timing) -> tuple[Terms, np.ndarray, np.ndarray]:
        """The law at the grid's points: terms, their numbers (size - 1, M) and shared numbers less both factors."""
        n, d = self.robot.n, self.dynamics
        drifts = any(self.model.get(name) is not None for name in DRIFTING)
        numbers = point_numbers(d, start.time_at(d.s) if drifts else np.zeros(len(d.s)))
        shared_by, shared = SharedByStructure(self.model), np.append(self.model.values(n), [unit, BLURS[0]])
        coefficients = compressed(shared_by, n, numbers, shared)
        if coefficients is not None:
            return compressed_terms(), coefficients, np.zeros(0)
        return general_terms(shared_by, n), numbers, shared

    def _smoothing(self, numbers: np.ndarray, shared: np.ndarray, control: np.ndarray, unit: float) -> float:
        """What the smoothed kinks leave out of a bound [J]: supporting lines of the exact ones in their place."""
        z = self.limits.grid.lift.values(control) / unit
        values = np.repeat(shared[:, None], z.shape[1], axis=1)
        shared_by, n = SharedByStructure(self.model), self.robot.n
        lines, smooth = (np.array(law_function(shared_by, n, k)(z, numbers, values)[0]) for k in (True, False))
        return float((self.grid.weight / np.sqrt(unit * z[1])) @ (lines - smooth).ravel())

    def _upper(self) -> np.ndarray:
        """Bounds of the free control values: the largest that the velocity limits allow anywhere near.

        On a straight path these are the velocity limits; elsewhere they leave room, and constraints do the rest.
        """
        first = self.limits.grid.lift.first
        count = len(self.shortest.control)
        most, least = np.zeros(count), np.full(count, np.inf)
        for k in range(3):
            np.maximum.at(most, first + k, self.speed_bound)
            np.minimum.at(least, first + k, self.speed_bound)
        return (2 * most - least)[1:-1]

    def optimise(
        self,
        start: Timing,
        *,
        price: float,
        longest: float,
        floor: float,
        exactly: bool = False,
        energy: bool = True,
    ) -> Solved:
        """Minimise energy - price * duration from `start`, in at most (`exactly`: in) `longest` seconds.

        No control value falls below `floor` times the start's largest, less towards the ends. With `energy` False,
        energy counts nothing.
        """
        passes = 2 if energy and any(self.model.get(name) is not None for name in DRIFTING) else 1
        for _ in range(passes):  # what drifts with time takes the time of the timing before
            found = self._optimise(start, price, longest, floor, exactly, energy)
            start = found.timing
        return found

    def _optimise(
        self, start: Timing, price: float, longest: float, floor: float, exactly: bool, energy: bool
    ) -> Solved:
        unit = float(start.control.max())
        clock = 1 / np.sqrt(unit)  # seconds in the program's unit of time
        terms, numbers, shared = self._law(unit, start)
        whole = program(self.grid, terms)
        ends, upper = self.ends / unit, self._upper() / unit
        g = greville(start.knots)[1:-1]
        lower = np.minimum(floor * np.minimum(1.0, 4 * g * (1 - g)), 0.5 * upper)
        x = np.clip(start.control[1:-1] / unit, lower, upper)
        factors = np.array([clock * energy, -price * clock])
        allowed = upper / (1 - MARGIN) ** 2
        move = Move(numbers, np.append(shared, factors), ends, lower, upper, allowed, longest / clock)
        size = max(abs(whole.evaluate(move, x)[0]), 1e-3 * abs(price) * start.duration, 1e-12)
        move = replace(move, shared=np.append(shared, factors / size))
        self.limits.hold(start.control, always=True)
        kinked = terms is not compressed_terms()
        for blur in BLURS[:-1] if kinked else ():
            move.shared[-3] = blur
            answer = whole.solve(move, x, self.limits.rows(unit), exactly=exactly, near=blur < BLURS[0])
            self.tally.add(answer)
            x = answer.x if answer.solved else x
        if kinked:
            move.shared[-3] = BLURS[-1]
        for _ in range(ROUNDS):
            rows = self.limits.rows(unit)
            answer = whole.solve(move, x, rows, exactly=exactly, near=kinked)
            self.tally.add(answer)
            x = answer.x
            control = unit * np.concatenate([ends[:1], x, ends[1:]])
            if not answer.solved:
                break
            if self.limits.hold(control):
                self.limits.hold(self.shortest.control, always=True)  # what binds the fastest may bind this one next
            elif not self.limits.refine(control):
                break
        timing = Timing(start.path, start.knots, control)
        bound = None
        if answer.solved and self.convex and not rows.curved:
            bound = lower_bound(whole, move, answer, rows) * size
            if kinked:
                bound += self._smoothing(numbers, move.shared[:-2], control, unit)
        if answer.solved and self.limits.worst(control).excess > 1e-6:
            return Solved(timing, np.inf, bound, False, f"limits not held after {ROUNDS} rounds")
        on_grid = whole.evaluate(move, x)[2] * clock
        resolved = abs(on_grid / timing.duration - 1) <= RESOLVED
        value = self._grid_energy(timing) if resolved else self.energy(timing)
        return Solved(timing, value, bound, answer.solved, answer.status)
