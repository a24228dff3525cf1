"""What a move to a joint goal is likely to cost: the straight line with a quintic timing, under the power model.

    q(t) = start + (goal - start) s(t / T),   s(x) = x^3 (10 - 15 x + 6 x^2)

Peaks of s', s'' and s''' are 1.875, 5.774 and 60, so the shortest T within velocity, acceleration and jerk is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.motion.judge.energy import Scorer
from energy_opt.robot import Robot

SAMPLES = 41
STRETCH = (1.0, 1.3, 1.7, 2.3, 3.2)  # durations that are looked at where none is asked for, in shortest ones
PEAKS = (1.875, 5.7735, 60.0)


@dataclass(frozen=True)
class Estimate:
    """Energy [J] and duration [s] of the straight quintic move; possible: no limit of speed rules the duration out."""

    energy: float
    duration: float
    possible: bool


def shortest(robot: Robot, start: np.ndarray, goal: np.ndarray) -> float:
    """The shortest duration [s] of the quintic within velocity, acceleration and jerk limits."""
    way, limits = np.abs(goal - start), robot.limits
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    with np.errstate(divide="ignore", invalid="ignore"):
        times = [
            np.where(way > 0, peak * way / bound, 0.0) ** (1 / k)
            for k, (peak, bound) in enumerate(zip(PEAKS, bounds, strict=True), start=1)
        ]
    return float(np.max(times))


def fastest(robot: Robot, start: np.ndarray, goal: np.ndarray) -> float:
    """A duration [s] that no motion between two positions goes below, by velocity and acceleration limits."""
    way, v, a = np.abs(goal - start), robot.limits.velocity, robot.limits.acceleration
    ramp = np.where(np.isfinite(a), v / a, 0.0)
    with np.errstate(invalid="ignore"):
        times = np.where(way >= v * ramp, way / v + ramp, 2 * np.sqrt(way / a))
    return float(np.nanmax(times))


def estimate(
    scorers: Sequence[Scorer], start: np.ndarray, goal: np.ndarray, duration: float | None, longest: float | None
) -> Estimate:
    """The mean over the scorers' models of what the straight move to a goal takes.

    Args:
        duration: exactly this long [s]; None: the cheapest of several, none longer than `longest` [s].
    """
    robot = scorers[0].robot
    bound = fastest(robot, start, goal)
    if duration is not None:
        return Estimate(_energy(scorers, start, goal, duration), duration, bound <= duration)
    least = max(shortest(robot, start, goal), 1e-3)
    times = [least * k for k in STRETCH if longest is None or least * k <= longest] or [longest or least]
    energies = [_energy(scorers, start, goal, t) for t in times]
    k = int(np.argmin(energies))
    return Estimate(energies[k], times[k], longest is None or bound <= longest)


def _energy(scorers: Sequence[Scorer], start: np.ndarray, goal: np.ndarray, duration: float) -> float:
    x = np.linspace(0, 1, SAMPLES)[:, None]
    way = goal - start
    q = start + way * (x**3 * (10 - 15 * x + 6 * x**2))
    v = way * (30 * x**2 * (1 - x) ** 2) / duration
    a = way * (60 * x * (1 - x) * (1 - 2 * x)) / duration**2
    t = x[:, 0] * duration
    return float(np.mean([np.trapezoid(scorer.drive(q, v, a, t)[1], t) for scorer in scorers]))
