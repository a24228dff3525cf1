"""Minimum energy over the timing of a fixed path.

The squared path speed b(s) is a quadratic B-spline (`spline_timing`); the program is convex if the model allows it, and
is solved by IPOPT from TOPP-RA's timing (`retime.program`). This module decides what to solve for a given duration.

"At most T" is convex. "Exactly T" is not, since T(b) is convex. It is solved as an equality, with

    minimise  E(b) - price * T(b)   subject to  T(b) = T

where a second of the duration is credited with a price [W], a constant that does not change the answer; up to a certain
price the cost stays convex (this always includes standby power). The convex program with T(b) <= T is solved first
(`retime.bound`). With R* its least cost, R* + price * T is a lower bound. If its answer takes all the time, it is the
global one. Otherwise a second costs more than that price: a faster motion would cost less, and the arm creeps where
holding is cheap. IPOPT then solves the equality from the answer of the convex program, stretched, and if the bound is
far away, from the even start as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from energy_opt.errors import Infeasible, at_least
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.path import JointPath
from energy_opt.motion.retime.fastest import FLOOR, quickest
from energy_opt.motion.retime.program import Retiming, Solved, standing_power
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.timing.toppra import fastest
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

LONGEST = 50.0  # longest free duration, as a multiple of the shortest one
GLOBAL_GAP = 0.25  # [%] an answer with a bound closer than this is called the global optimum
USELESS = 1.0  # share of the energy: a bound farther away is not reported
ROUNDING = 1e-12  # relative: durations that differ by less are equal
USED_UP = 1e-5  # relative slack of the duration below which it counts as used up
# share of the duration from which the convex program's answer is the first start: below, the even start led to up to
# 0.3 % less energy in 500 retimings of four arms
BESIDE = 0.6
PROVED = 1e-4  # relative: an answer with a bound closer than this needs no better bound
CORRECTIONS = 4  # most corrections of a duration that the grid does not resolve
HELD = 3e-7  # share of a bound: allowed excess over the tighter bound in the program
LOOKS = 1000  # instants of the fastest timing at which limits may bind
CREEP = 1e-2  # as FLOOR, if creeping saves energy: speeds below a tenth of the top speed are not resolved by the grid


@dataclass(frozen=True)
class RetimeSolution:
    """A retimed path.

    Attributes:
        joints: their names. timing: the path with its squared speed.
        energy: J, by the exact laws on the grid; infinite if limits do not hold.
        lower_bound: J; None if none is proven, as where the program is not convex.
        converged: False if the solver gave up and the best feasible timing is returned instead.
        message: a note for the user; may be empty.
        iterations, build_seconds: of the solver, summed over all solves.
    """

    joints: tuple[str, ...]
    timing: Timing
    energy: float
    lower_bound: float | None
    converged: bool
    message: str = ""
    iterations: int = 0
    build_seconds: float = 0.0

    @cached_property
    def trajectory(self) -> Trajectory:
        """Samples of the timing."""
        return self.timing.trajectory(self.joints)

    @property
    def gap(self) -> float:
        """Distance of the bound below the energy, as a share of the energy; infinite without a bound."""
        if self.lower_bound is None or np.isinf(self.energy):
            return np.inf
        return (self.energy - self.lower_bound) / max(abs(self.energy), 1e-12)


def retime(
    robot: Robot,
    model: PowerModel,
    path: JointPath,
    *,
    duration: float | None = None,
    max_duration: float | None = None,
    shortest: Timing | None = None,
    limits: Sequence[Limit] | None = None,
) -> RetimeSolution:
    """The timing of `path` that takes the least energy under `model`.

    Args:
        duration: exactly so long, s.
        max_duration: at most so long, s. Without either, the duration is free (at most 50 times the shortest).
        shortest: the minimum-time timing if it is known; it gives grid and end speeds.
        limits: in place of the robot's own.

    Raises:
        Infeasible: the path breaks limits at any timing, or the duration is too short for it.
    """
    held = joint_limits(robot.limits) if limits is None else tuple(limits)
    if shortest is None:
        shortest = fastest(robot, model, path, limits=held)
    if not path.moves:
        return _hold_pose(robot, model, duration, shortest)
    work = Retiming(robot, model, shortest, held)
    wanted = duration if duration is not None else max_duration
    start = shortest
    if wanted is not None and shortest.duration > wanted * (1 + ROUNDING):
        start = _faster_than_toppra(work, shortest, wanted)
    if duration is not None and all(work.rest):
        start = start.slowed(duration)
    solution = _free(work, start, max_duration) if duration is None else _exact(work, start, duration)
    bound = (
        None if solution.lower_bound is None or solution.gap > USELESS else min(solution.lower_bound, solution.energy)
    )
    return replace(solution, lower_bound=bound, iterations=work.tally.iterations, build_seconds=work.tally.build)


def _faster_than_toppra(work: Retiming, shortest: Timing, wanted: float) -> Timing:
    """A timing faster than TOPP-RA's.

    Raises:
        Infeasible: no timing takes at most `wanted` seconds.
    """
    best = quickest(work, shortest)
    if best.duration <= wanted:
        return best
    longest = work.limits.longest(best.control, best.at(np.linspace(0.0, best.duration, LOOKS))[0])
    worst = work.limits.worst(best.control * (best.duration / wanted) ** 2, longest)
    line = worst.limit.linear(work.dynamics, 1.0)
    # a speed limit is on the square
    excess = worst.excess if line is None or not line.of_speed else np.sqrt(1 + worst.excess) - 1
    joint = worst.limit.where(work.robot.joints, worst.column)
    time = float(best.time_at(np.array([worst.position]))[0]) * wanted / best.duration
    raise Infeasible(
        f"{joint}: the {worst.limit.name} limit would be exceeded by {100 * excess:.3g} % at {time:.4g} s of "
        f"{wanted:.6g} s; the shortest duration that works on this path is {at_least(best.duration)} s",
        joint=joint,
        limit="duration",
        time=time,
        position=worst.position,
        excess=float(excess),
        shortest_duration=best.duration,
    )


def _free(work: Retiming, start: Timing, longest: float | None) -> RetimeSolution:
    """The answer for a free duration of at most `longest` seconds."""
    cap = LONGEST * work.shortest.duration if longest is None else longest
    found = _best(work, start, price=0.0, longest=cap, floor=FLOOR)
    if not found.solved:
        return _feasible_start(work, start, f"the solver stopped with {found.status}")
    message = ""
    if longest is None and found.timing.duration > cap * (1 - 1e-3):
        message = f"the energy still falls with the duration, which was held at {LONGEST:g} times the shortest one"
    return RetimeSolution(work.robot.joints, found.timing, found.energy, found.bound, True, message)


def _exact(work: Retiming, start: Timing, duration: float) -> RetimeSolution:
    """The answer for exactly `duration` seconds; see the module."""
    price = work.convex_price()
    best = RetimeSolution(work.robot.joints, start, np.inf, None, False)
    starts = [start]
    if work.convex:
        relaxed = work.relax(start, price=price, longest=duration, floor=FLOOR)
        timing = _stretched(work, relaxed.timing, duration)
        share = relaxed.timing.duration / duration
        if relaxed.bound is not None:
            best = replace(best, lower_bound=relaxed.bound + price * duration)
        if relaxed.solved and abs(share - 1) <= USED_UP:
            best = _lesser(best, _stretched_solution(work, timing, best.lower_bound, relaxed))
        if relaxed.solved:
            starts = [timing, start] if share > BESIDE else [start, timing]
    for number, tried in enumerate(starts):
        if best.gap > (GLOBAL_GAP / 100 if number else PROVED):
            best = _lesser(best, _equality(work, tried, price, duration))
    reason = "the search ended at a timing of more energy" if best.converged else best.message
    slowed = _feasible_start(work, start, reason, best.lower_bound)
    least = duration / (1 + USED_UP)
    if least <= work.shortest.duration and least <= quickest(work, work.shortest).duration:
        slowed = replace(slowed, converged=True, message="in the shortest duration there is no other timing")
    if np.isinf(best.energy):
        return slowed
    if all(work.rest) and slowed.energy < best.energy:
        return replace(slowed, converged=best.converged or slowed.converged)
    message = "" if best.converged else f"{best.message}, at a timing that holds all limits"
    return replace(best, converged=True, message=message)


def _equality(work: Retiming, start: Timing, price: float, duration: float) -> RetimeSolution:
    """Minimum energy in exactly `duration` seconds, from `start`; of infinite energy if limits do not hold."""
    found = _best(work, start, price=price, longest=duration, floor=CREEP, exactly=True)
    bound = None if found.bound is None else found.bound + price * duration
    timing, nearer = _stretched(work, found.timing, duration), duration
    # the grid does not resolve creeping, so its duration differs slightly from the true one
    for _ in range(CORRECTIONS):
        if not found.solved or work.limits.worst(timing.control).excess <= HELD:
            break
        nearer *= (1 - 1e-7) * duration / found.timing.duration
        found = work.optimise(found.timing, price=price, longest=nearer, floor=CREEP, exactly=True)
        timing = _stretched(work, found.timing, duration)
    return _stretched_solution(work, timing, bound, found)


def _stretched_solution(work: Retiming, timing: Timing, bound: float | None, found: Solved) -> RetimeSolution:
    """A solver's answer, stretched; of infinite energy if limits do not hold."""
    inside = work.limits.worst(timing.control).excess <= HELD
    energy = work.energy(timing) if inside else np.inf
    return RetimeSolution(
        work.robot.joints, timing, energy, bound, found.solved, f"the solver stopped with {found.status}"
    )


def _lesser(one: RetimeSolution, other: RetimeSolution) -> RetimeSolution:
    """The solution of less energy, with the better bound."""
    bounds = [solution.lower_bound for solution in (one, other) if solution.lower_bound is not None]
    return replace(other if other.energy <= one.energy else one, lower_bound=max(bounds, default=None))


def _best(
    work: Retiming, start: Timing, *, price: float, longest: float, floor: float, exactly: bool = False
) -> Solved:
    """The answer from `start`; if the solver fails under a nonconvex model, that from the convex optimum.

    The convex optimum is that of the model without its nonconvex effects. It is tried only then: in 640 retimings under
    seven models it took longer than the answer itself, and won more than 0.05 % of the energy in 4 of them.
    """
    found = work.optimise(start, price=price, longest=longest, floor=floor, exactly=exactly)
    if found.solved or work.convex:
        return found
    simpler = work.with_model(work.model.kept(lambda effect: effect.convex_in_retiming))
    second = simpler.optimise(start, price=simpler.convex_price() if exactly else price, longest=longest, floor=floor)
    if not second.solved:
        return found
    again = work.optimise(second.timing, price=price, longest=longest, floor=floor, exactly=exactly)
    return again if again.solved else found


def _feasible_start(work: Retiming, start: Timing, reason: str, bound: float | None = None) -> RetimeSolution:
    """The feasible start, TOPP-RA's timing, slowed; it counts as converged if the bound proves it good enough."""
    solution = RetimeSolution(work.robot.joints, start, work.energy(start), bound, True)
    if solution.gap <= GLOBAL_GAP / 100:
        return solution
    return replace(solution, converged=False, message=f"{reason}: this is the evenly slowed move")


def _stretched(work: Retiming, timing: Timing, duration: float) -> Timing:
    """The timing stretched slightly to take `duration`: only where no limit is near, if evenly breaks a limit."""
    evenly = _stretched_at(timing, duration)
    if work.limits.worst(evenly.control).excess <= HELD:
        return evenly
    loose = work.limits.slack_controls(timing.control)
    locally = _stretched_at(timing, duration, loose) if loose.any() else evenly
    return locally if work.limits.worst(locally.control).excess <= HELD else evenly


def _stretched_at(timing: Timing, duration: float, where: np.ndarray | slice = slice(1, -1)) -> Timing:
    """The timing stretched slightly, at the control values `where`, to take `duration`."""
    pace = np.zeros(len(timing.control))
    pace[1:-1] = 1 / np.sqrt(timing.control[1:-1])
    share = pace[where].sum() / pace.sum()  # approximate share of the duration
    for _ in range(20):
        factor = timing.duration / duration
        if abs(factor - 1) < 1e-13:
            break
        control = timing.control.copy()
        control[where] *= factor ** (2 / share)
        timing = replace(timing, control=control)
    return timing


def _hold_pose(robot: Robot, model: PowerModel, duration: float | None, shortest: Timing) -> RetimeSolution:
    """A move of no length: the arm holds its pose for the duration asked for."""
    timing = shortest if duration is None else shortest.slowed(duration)
    energy = standing_power(robot, model, timing.path) * timing.duration
    return RetimeSolution(robot.joints, timing, energy, energy, True, "start and goal coincide")
