"""Motions of the misfit worlds, trapezoids of speed, and a hand that pushes the arm on its way."""

from __future__ import annotations

import numpy as np

from energy_opt.robot import Robot

STEP = 0.004  # [s] of the world


def session(
    robot: Robot, rng: np.random.Generator, motions: int, poses: int, shifted: bool, sharp: bool = False
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Poses held, then runs of moves with blended trapezoids of speed, at several speeds, with stops between.

    `sharp`: trapezoids that are not blended, with short ramps, as of industrial arms: the acceleration jumps.
    """
    low, high = np.maximum(robot.limits.lower, -2.6), np.minimum(robot.limits.upper, 2.6)
    middle, half = (low + high) / 2, 0.8 * (high - low) / 2
    if shifted:
        middle, half = middle + 0.35 * half * rng.choice([-1, 1], robot.n), 0.65 * half
    out = []
    for _ in range(poses):
        q = np.tile(middle + half * rng.uniform(-1, 1, robot.n), (int(rng.uniform(2, 3) / STEP), 1))
        out.append((q, np.zeros_like(q), np.zeros_like(q)))
    for k in range(motions):
        q = middle + half * rng.uniform(-1, 1, robot.n)
        speeds = [np.zeros((int(0.4 / STEP), robot.n))]
        at = q.copy()
        for _ in range(2 + int(k % 3)):
            goal = middle + half * rng.uniform(-1, 1, robot.n)
            goal = at + (goal - at) * rng.uniform(0.2, 0.8, robot.n)
            way = goal - at
            pace = rng.uniform(0.15, 0.6)
            cruise = float(np.max(np.abs(way) / (pace * robot.limits.velocity)))
            ramp = rng.uniform(0.2, 0.4) / (3 if sharp else 1)
            count, edge = max(int(cruise / STEP), 2), int(ramp / STEP)
            shape = np.convolve(np.ones(count), np.ones(edge) / edge)
            if not sharp:
                shape = np.convolve(shape, np.ones(edge // 2) / (edge // 2))
            shape /= shape.sum() * STEP
            speeds += [np.outer(shape, way), np.zeros((int(rng.uniform(0.3, 0.7) / STEP), robot.n))]
            at = goal
        v = np.concatenate(speeds)
        path = q + np.concatenate([np.zeros((1, robot.n)), np.cumsum((v[1:] + v[:-1]) / 2 * STEP, axis=0)])
        out.append((path, v, np.gradient(v, STEP, axis=0)))
    return out


def hand_torque(t: np.ndarray, robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Torque (N, n) [N m] of a hand that pushes for a second or so, at an eighth to a third of two joints' limits."""
    out = np.zeros((len(t), robot.n))
    for j in rng.choice(robot.n, 2, replace=False):
        begin, lasts = rng.uniform(0.1, 0.6) * t[-1], rng.uniform(0.6, 1.5)
        shape = np.clip((t - begin) / 0.15, 0, 1) * np.clip((begin + lasts - t) / 0.15, 0, 1)
        out[:, j] = rng.choice([-1, 1]) * rng.uniform(0.13, 0.33) * robot.limits.effort[j] * shape
    return out
