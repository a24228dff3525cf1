"""A leg's front: how its least energy goes with its duration, over the timing of its first path."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.jobs.allocate import Front, Solved
from energy_opt.jobs.legs import Leg
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.retime.fastest import minimum_time
from energy_opt.motion.retime.program import Retiming
from energy_opt.motion.retime.solve import FLOOR
from energy_opt.motion.timing.law import Timing
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

LONGEST = 50.0  # a leg's duration ends at this multiple of its shortest
SLOWER = 1.02  # step of a difference quotient
SAMPLES = 40  # of the path, for the power that holding it takes


def fastest_timing(robot: Robot, model: PowerModel, leg: Leg, limits: Sequence[Limit]) -> Timing:
    """The fastest timing of a leg's first path.

    Raises:
        Infeasible: the path breaks limits at any timing; says which leg.
    """
    try:
        return minimum_time(robot, model, leg.path, limits)
    except Infeasible as error:
        raise Infeasible(
            f"{leg.name}: {error}", joint=error.joint, limit=error.limit, position=error.position
        ) from None


def holding_power(scorer: Scorer, q: np.ndarray) -> np.ndarray:
    """Power (K,) [W] of standing still at positions q (K, n)."""
    still = np.zeros_like(q)
    _, power, _ = scorer.drive(q, still, still, np.zeros(len(q)))
    return power


def front_of(leg: Leg, timing: Timing, scorer: Scorer, limits: Sequence[Limit], most: float) -> Front:
    """The front of a leg up to a duration of `most` [s]; `timing` is its fastest."""
    robot, model = scorer.robot, scorer.model
    shortest, longest = max(timing.duration, leg.least), min(leg.most, LONGEST * timing.duration, most)
    holding = float(holding_power(scorer, leg.path(np.linspace(0, 1, SAMPLES))).mean())
    if not leg.path.moves:
        return Front(shortest, shortest, holding, lambda price: Solved(shortest, holding * shortest, None))
    work = Retiming(robot, model, timing, limits)
    last = [timing]

    def at_price(price: float) -> Solved:
        found = work.optimise(last[0], price=price, longest=longest, floor=FLOOR)
        if not found.solved and last[0] is not timing:
            found = work.optimise(timing, price=price, longest=longest, floor=FLOOR)
        if not found.solved:
            slowed = timing.slowed(float(np.clip(last[0].duration, shortest, longest)))
            return Solved(slowed.duration, work.energy(slowed), None)
        last[0] = found.timing
        bound = found.bound if leg.least <= timing.duration else None  # it knows nothing of a least duration
        return Solved(found.timing.duration, found.energy, bound)

    return Front(shortest, longest, holding, at_price)


def slope_of_slowing(legs: Sequence[Leg], timings: Sequence[Timing], scorers: Sequence[Scorer], factor: float) -> float:
    """W that another second is worth to legs that are all slowed evenly, by `factor`."""
    energy, time = [0.0, 0.0], [0.0, 0.0]
    for leg, timing, scorer in zip(legs, timings, scorers, strict=True):
        for k, more in enumerate((factor, SLOWER * factor)):
            duration = float(np.clip(more * timing.duration, max(timing.duration, leg.least), leg.most))
            slowed = timing.slowed(duration).trajectory(scorer.robot.joints)
            energy[k] += scorer.energy(slowed).total
            time[k] += duration
    return (energy[1] - energy[0]) / (time[1] - time[0]) if time[1] > time[0] else 0.0
