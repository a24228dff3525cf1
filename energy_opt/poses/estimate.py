"""Estimated energy of moves between joint positions: straight lines with a quintic timing, under the power model.

    q(t) = start + (goal - start) s(t / T),   s(x) = x^3 (10 - 15 x + 6 x^2)

Many moves are estimated together. Over the duration, energy is close to

    E(T) = a T + b + c / T + d / T^3

(holding power; path and friction; viscous friction; losses of acceleration). Four durations determine the coefficients.

Where a joint is near its velocity limit v, a quintic would exceed it. With a trapezoid of velocity, whose plateau is v,
losses of acceleration are 2 b^3 / (b - 1) d^2 / T^3, b = v T / d, with the distance d; with a quintic 120/7 d^2 / T^3.
Where that is less, c and d take the ratio more if they are positive: below zero they are what gravity gives back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.motion.judge.energy import Scorer
from energy_opt.robot import Robot

SAMPLES = 21
LOOKED_AT = np.array([1.1, 1.6, 2.5, 4.5])  # durations at which moves are scored, as multiples of the shortest
LONGEST = 12.0  # longest duration, as a multiple of the shortest: slower moves make no sense
GRID = np.geomspace(LOOKED_AT[0], LONGEST, 40)  # durations for the search of the cheapest, as multiples of the shortest
BLOCK = 40_000  # samples scored at once
QUINTIC = 120 / 7  # integral of the squared acceleration of a quintic, in distance^2 / T^3
LEAST = 1e-3  # [s] lower bound of the shortest duration


@dataclass(frozen=True)
class Curves:
    """Energy over duration of P moves.

    Attributes:
        shortest: (P,) [s] below which velocity and acceleration limits rule a move out.
        coefficients: (P, 4) [J] of a, b, c, d over T / shortest.
        cruising: (P,) [s] that the move takes at velocity limits.
    """

    shortest: np.ndarray
    coefficients: np.ndarray
    cruising: np.ndarray

    def at(self, duration: np.ndarray) -> np.ndarray:
        """Energy (P, M) [J] at durations (P, M) [s]."""
        share = duration / self.shortest[:, None]
        spare = np.maximum(duration / np.maximum(self.cruising[:, None], 1e-9), 1 + 1e-3)
        ratio = np.maximum(2 * spare**3 / (spare - 1) / QUINTIC, 1.0)
        a, b, c, d = self.coefficients.T[:, :, None]
        return np.asarray(a * share + b + np.maximum(c, c * ratio) / share + np.maximum(d, d * ratio) / share**3)

    def cheapest(
        self, price: float = 0.0, longest: float | np.ndarray = np.inf, least: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Energy less price * T (P,) [J], and the duration T (P,) [s] at which that is least.

        Args:
            price: value of a second [W]; longest, least: bounds of the duration [s].
        """
        time = np.clip(self.shortest[:, None] * GRID, least, longest)
        time = np.maximum(time, self.shortest[:, None])
        energy = self.at(time) - price * time
        best = np.argmin(energy, axis=1)[:, None]
        return np.take_along_axis(energy, best, 1)[:, 0], np.take_along_axis(time, best, 1)[:, 0]


def fastest(robot: Robot, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Lower bounds (P,) [s] of the durations of motions, by the limits on velocity, acceleration and jerk.

    Args:
        robot: for its limits. start, goal: (P, n) [rad, m].
    """
    limits = robot.limits
    distance, v, a, j = np.abs(goal - start), limits.velocity, limits.acceleration, limits.jerk
    ramp = np.where(np.isfinite(a), v / np.where(np.isfinite(a), a, 1.0), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        times = np.where(
            distance >= v * ramp, np.where(np.isfinite(v), distance / v, 0.0) + ramp, 2 * np.sqrt(distance / a)
        )
        times = np.maximum(times, np.where(np.isfinite(j), (32 * distance / j) ** (1 / 3), 0.0))
    return np.asarray(np.nan_to_num(times).max(axis=-1))


def fastest_straight(robot: Robot, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Durations (P,) [s] of the fastest straight moves from rest to rest, by the limits on velocity, acceleration and
    jerk; all joints share one timing.

    Args:
        robot: for its limits. start, goal: (P, n) [rad, m].
    """
    limits, distance = robot.limits, np.maximum(np.abs(goal - start), 1e-12)
    v, a, j = (np.min(x / distance, axis=1) for x in (limits.velocity, limits.acceleration, limits.jerk))
    a = np.minimum(a, 1e12)
    ramp = a / j  # [s] until the acceleration is reached; 0 without a limit on jerk
    peak = np.minimum(v, (np.sqrt((a * ramp) ** 2 + 4 * a) - a * ramp) / 2)  # speed, if the acceleration is reached
    peak = np.where(peak < a * ramp, np.minimum(v, (j / 4) ** (1 / 3)), peak)
    rising = np.where(peak < a * ramp, 2 * np.sqrt(peak / j), peak / a + ramp)
    return np.asarray(1 / peak + rising)


def quickest(robot: Robot, q: np.ndarray, found: np.ndarray) -> np.ndarray:
    """The positions (n,) that are quickest to reach; among equals those with less travel.

    Args:
        robot: for its limits. q: (n,) to begin at. found: (K, n) to choose from.
    """
    seconds = fastest(robot, np.broadcast_to(q, found.shape), found) + 1e-3 * np.abs(found - q).sum(axis=1)
    return np.asarray(found[int(np.argmin(seconds))])


def curves(scorers: Sequence[Scorer], start: np.ndarray, goal: np.ndarray) -> Curves:
    """Energy over duration of straight moves, the mean over the scorers' models; start and goal (P, n) [rad, m]."""
    shortest = np.maximum(fastest(scorers[0].robot, start, goal), LEAST)
    count = len(LOOKED_AT)
    times = np.outer(shortest, LOOKED_AT).ravel()
    energy = straight(scorers, np.repeat(start, count, axis=0), np.repeat(goal, count, axis=0), times)
    cruising = (np.abs(goal - start) / scorers[0].robot.limits.velocity).max(axis=1)
    basis = np.stack([LOOKED_AT, np.ones(count), 1 / LOOKED_AT, LOOKED_AT**-3.0], axis=-1)
    return Curves(shortest, np.linalg.solve(basis, energy.reshape(-1, count).T).T, cruising)


def straight(scorers: Sequence[Scorer], start: np.ndarray, goal: np.ndarray, duration: np.ndarray) -> np.ndarray:
    """Energy (P,) [J] of straight moves, the mean over the models.

    Args:
        scorers: of the models. start, goal: (P, n) [rad, m]. duration: (P,) [s].
    """
    x = np.linspace(0, 1, SAMPLES)[:, None]
    displacement, time = (goal - start)[:, None], duration[:, None, None]
    q = start[:, None] + displacement * (x**3 * (10 - 15 * x + 6 * x**2))
    v = displacement * (30 * x**2 * (1 - x) ** 2) / time
    a = displacement * (60 * x * (1 - x) * (1 - 2 * x)) / time**2
    return energies(scorers, q, v, a, duration[:, None] * x[:, 0])


def energies(scorers: Sequence[Scorer], q: np.ndarray, v: np.ndarray, a: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Energy (P,) [J] of P motions of S samples each, the mean over the models; q, v, a (P, S, n), time (P, S) [s]."""
    count, samples, n = q.shape
    out = np.zeros(count)
    for scorer in scorers:
        block = 1 if scorer.remembers else max(BLOCK // samples, 1)
        for first in range(0, count, block):
            part = slice(first, first + block)
            at, speed, bend = (x[part].reshape(-1, n) for x in (q, v, a))
            power = scorer.drive(at, speed, bend, time[part].ravel())[1].reshape(-1, samples)
            out[part] += np.trapezoid(power, time[part], axis=1)
    return out / len(scorers)


def holding(scorers: Sequence[Scorer], q: np.ndarray) -> np.ndarray:
    """Power (K,) [W] of standing still at positions q (K, n), the mean over the models."""
    return np.asarray(np.mean([scorer.holding(q) for scorer in scorers], axis=0))
