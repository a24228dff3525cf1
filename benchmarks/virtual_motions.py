"""Motions as one would record to learn an arm's power: poses, there-and-back moves at several speeds, sine runs."""

from __future__ import annotations

import numpy as np

from energy_opt.robot import Robot
from energy_opt.virtual_arm.simulate import Reference, pose

SAMPLE = 2e-3  # [s] between the samples of a reference
SPAN = 2.2  # [rad] poses lie within this of the middle of a joint's range
RAMP = 0.6  # [s] in which a sine run fades in and out


def random_pose(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """A pose (n,) in the middle part of every joint's range."""
    lower, upper = _range(robot)
    return rng.uniform(lower, upper)


def _range(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    lower, upper = robot.limits.lower, robot.limits.upper
    bounded = np.isfinite(lower) & np.isfinite(upper)
    lower, upper = np.where(bounded, lower, -np.pi), np.where(bounded, upper, np.pi)
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    half = np.minimum(0.85 * half, SPAN)
    return middle - half, middle + half


def quintic(duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, and the share of the way and its rate (1/s) of a rest-to-rest quintic."""
    t = np.arange(round(duration / SAMPLE) + 1) * SAMPLE
    x = np.minimum(t / duration, 1.0)
    return t, x**3 * (10 - 15 * x + 6 * x * x), 30 * x**2 * (1 - x) ** 2 / duration


def there_and_back(name: str, start: np.ndarray, goal: np.ndarray, duration: float, pause: float) -> Reference:
    """From start to goal (n,) in `duration` s, a pause, and the same way back."""
    _, share, rate = quintic(duration)
    way = goal - start
    waiting = round(pause / SAMPLE)
    shares = np.concatenate([share, np.ones(waiting), share[::-1]])
    rates = np.concatenate([rate, np.zeros(waiting), -rate[::-1]])
    time = np.arange(len(shares)) * SAMPLE
    return Reference(name, time, start + np.outer(shares, way), np.outer(rates, way))


def shortest(robot: Robot, way: np.ndarray) -> float:
    """The duration in which a quintic over `way` (n,) reaches a velocity or acceleration limit, s."""
    acceleration = np.minimum(robot.limits.acceleration, 12.0)
    return float(np.max(np.maximum(1.875 * abs(way) / robot.limits.velocity, np.sqrt(5.774 * abs(way) / acceleration))))


def sines(name: str, robot: Robot, rng: np.random.Generator, duration: float, still: np.ndarray) -> Reference:
    """Two sines per joint about a random pose, faded in and out; joints in the mask `still` (n,) stay."""
    t = np.arange(round(duration / SAMPLE) + 1) * SAMPLE
    lower, upper = _range(robot)
    centre = rng.uniform(lower + 0.3 * (upper - lower), upper - 0.3 * (upper - lower))
    cycles = rng.uniform(0.15, 0.75, (2, robot.n))
    peak = rng.uniform(0.15, 0.5, (2, robot.n)) * robot.limits.velocity * 0.5
    amplitude = np.minimum(peak / (2 * np.pi * cycles), 0.25 * (upper - lower))
    amplitude = np.minimum(amplitude, 0.45) * ~still
    phase = rng.uniform(0, 2 * np.pi, (2, robot.n))
    angle = 2 * np.pi * cycles * t[:, None, None] + phase
    wave = (amplitude * np.sin(angle)).sum(axis=1)
    speed = (amplitude * 2 * np.pi * cycles * np.cos(angle)).sum(axis=1)
    x = np.clip(np.minimum(t, t[-1] - t) / RAMP, 0.0, 1.0)
    fade = x**3 * (10 - 15 * x + 6 * x * x)
    slope = 30 * x**2 * (1 - x) ** 2 / RAMP * np.where(t < t[-1] / 2, 1.0, -1.0)
    position = centre + fade[:, None] * wave
    velocity = fade[:, None] * speed + slope[:, None] * wave
    return Reference(name, t, position, velocity)


def excitation(
    robot: Robot, rng: np.random.Generator, motions: int = 9, poses: int = 6, still: tuple[int, ...] = ()
) -> list[Reference]:
    """A recording session: poses, moves in slow and fast pairs, sine runs among them, two poses at the end.

    Args:
        still: joints that never move (they stand at one angle in the motions, and differ in the poses).
    """
    parked = np.isin(np.arange(robot.n), still)
    out: list[Reference] = []
    late = min(2, poses)

    def name() -> str:
        return f"run{len(out) + 1:02d}"

    for _ in range(poses - late):
        out.append(pose(name(), random_pose(robot, rng), float(rng.uniform(2.0, 3.2))))
    moves: list[tuple[np.ndarray, np.ndarray, float]] = []
    waves = max(1, round(motions / 6)) if motions else 0
    while len(moves) < motions - waves:
        start, goal = random_pose(robot, rng), random_pose(robot, rng)
        goal = start + (goal - start) * rng.uniform(0.25, 1.0, robot.n) * ~parked
        fast = max(0.7, shortest(robot, goal - start) / rng.uniform(0.45, 0.85))
        moves.append((start, goal, fast))
        moves.append((start, goal, min(fast * rng.uniform(1.3, 3.2), 3.2)))
    moves = moves[: motions - waves]
    order = rng.permutation(motions)
    for k in order:
        if k < len(moves):
            start, goal, duration = moves[k]
            out.append(there_and_back(name(), start, goal, duration, float(rng.uniform(0.3, 0.6))))
        else:
            out.append(sines(name(), robot, rng, float(rng.uniform(4.8, 6.2)), parked))
    for _ in range(late):
        out.append(pose(name(), random_pose(robot, rng), float(rng.uniform(2.0, 3.2))))
    return out
