"""The motion to record next: within limits, and such that rival models differ most in the power they expect.

Moves there and back between two poses, fast and then slow, so that speed, direction and load all change. Poses are
drawn and then improved step by step; the score is the smallest of the rivals' mutual differences (rms, W).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from energy_opt.diagnose.predict import predict
from energy_opt.diagnose.samples import Samples
from energy_opt.diagnose.trace import Trace
from energy_opt.effects import Armature, CoulombFriction, ViscousFriction
from energy_opt.files import write_table
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

STEP = 0.008  # [s]
PAUSE = 0.4  # [s]
SLOWER = 2.5  # the slow pass takes this many times as long
DRAWN, IMPROVED = 40, 60
SPAN = 2.0  # [rad] poses lie within this of the middle of a joint's range
COARSE = 5  # every so many samples are compared while searching
SAME = 1e-3  # [W] rivals nearer than this are the same at the meter


@dataclass(frozen=True)
class Motion:
    """A motion (N rows): time [s], q, v, a (N, n), and by how much the rivals differ on it, rms W."""

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    difference: float


def rivals_of(found: Trace, n: int) -> list[PowerModel]:
    """The models to tell apart: those that fit equally well, or the accepted one with more in idle joints."""
    if len(found.rivals) > 1:
        return [f.model for f in found.rivals]
    model = found.accepted.model
    idle = np.isin(np.arange(n), found.idle).astype(float)
    out = [model]
    for kind, size in ((CoulombFriction, 0.5), (ViscousFriction, 0.5), (Armature, 0.2)):
        held = model.get(kind.name)
        before = held.full(n) if held is not None else np.zeros(n)
        out.append(model.replaced(kind.from_full(before + size * idle, n)))
    return out


def propose(found: Trace, robot: Robot, seed: int = 0) -> Motion | None:
    """The most telling motion found, or None where no motion tells the rivals apart."""
    models = rivals_of(found, robot.n)
    rng = np.random.default_rng(seed)
    lower, upper = _range(robot)

    def score(poses: np.ndarray) -> float:
        return difference(models, robot, _there_and_back(robot, poses), COARSE)

    drawn = [rng.uniform(lower, upper, (2, robot.n)) for _ in range(DRAWN)]
    scores = [score(poses) for poses in drawn]
    best, top = drawn[int(np.argmax(scores))], max(scores)
    for k in range(IMPROVED):
        width = 0.3 * (1 - k / IMPROVED) * (upper - lower)
        trial = np.clip(best + rng.normal(size=best.shape) * width, lower, upper)
        value = score(trial)
        if value > top:
            best, top = trial, value
    if top < SAME:
        return None
    time, q, v, a = _there_and_back(robot, best)
    return Motion(time, q, v, a, difference(models, robot, (time, q, v, a), 1))


def difference(
    models: Sequence[PowerModel],
    robot: Robot,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    every: int,
) -> float:
    """Smallest rms difference [W] of any two models' power over a motion."""
    samples = samples_of(robot, *(x[::every] for x in motion))
    powers = [predict(model, samples).reading for model in models]
    return min(float(np.sqrt(np.mean((x - y) ** 2))) for x, y in combinations(powers, 2))


def samples_of(robot: Robot, time: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> Samples:
    """A motion as samples without a measured power."""
    count = len(time)
    return Samples(
        robot.body, q, v, a, time, np.zeros(count), np.zeros(count, dtype=int), (slice(0, count),), ("",), ("motion",),
        (1,),
        np.full_like(q, np.nan), np.ones(count), 1.0, 1.0, True, ((time, np.zeros(count)),),
    )  # fmt: skip


def save(motion: Motion, model: PowerModel, robot: Robot, path: str) -> None:
    """Write a trajectory file with the model's torque and power."""
    from pathlib import Path

    from energy_opt.power import drive_function

    p = predict(model, samples_of(robot, motion.time, motion.q, motion.v, motion.a))
    function, _ = drive_function(model, robot.n)
    values = np.tile(model.values(robot.n)[:, None], (1, len(motion.time)))
    rows = function(motion.q.T, motion.v.T, motion.a.T, p.tau.T, motion.time[None, :], values)
    signals = {"position": motion.q, "velocity": motion.v, "acceleration": motion.a, "effort": np.array(rows[0]).T}
    header, columns = ["time"], [motion.time]
    for signal, data in signals.items():
        header += [f"{joint}.{signal}" for joint in robot.joints]
        columns += list(data.T)
    write_table(Path(path), [*header, "power"], [*columns, p.power])


def _range(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    bounded = np.isfinite(robot.limits.lower) & np.isfinite(robot.limits.upper)
    lower = np.where(bounded, robot.limits.lower, -np.pi)
    upper = np.where(bounded, robot.limits.upper, np.pi)
    middle, half = (lower + upper) / 2, np.minimum(0.45 * (upper - lower), SPAN)
    return middle - half, middle + half


def _there_and_back(robot: Robot, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fast there and back, then slowly; each way a quintic within the robot's limits, torque included."""
    way = poses[1] - poses[0]
    fastest = _duration(robot, poses[0], way)
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for duration in (fastest, SLOWER * fastest):
        x = np.minimum(np.arange(int(np.ceil(duration / STEP)) + 1) * STEP / duration, 1.0)
        share, rate, curve = _quintic(x)
        still = np.zeros(round(PAUSE / STEP))
        there = (share, rate / duration, curve / duration**2)
        parts += [there, (still + 1, still, still), (1 - there[0], -there[1], -there[2]), (still, still, still)]
    share, rate, curve = (np.concatenate(column) for column in zip(*parts, strict=True))
    q, v, a = poses[0] + np.outer(share, way), np.outer(rate, way), np.outer(curve, way)
    return np.arange(len(share)) * STEP, q, v, a


def _quintic(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - 3 * x + 2 * x**2)


def _duration(robot: Robot, start: np.ndarray, way: np.ndarray) -> float:
    """Shortest quintic over `way` within velocity, acceleration, jerk and effort limits (with a tenth to spare), s."""
    limits, size = robot.limits, 1.1 * np.abs(way)
    duration = max(
        0.5,
        float(np.max(1.875 * size / limits.velocity)),
        float(np.max(np.sqrt(5.774 * size / limits.acceleration))),
        float(np.max(np.cbrt(60 * size / limits.jerk))),
    )
    share, rate, curve = _quintic(np.linspace(0, 1, 21))
    for _ in range(12):
        q, v, a = start + np.outer(share, way), np.outer(rate, way) / duration, np.outer(curve, way) / duration**2
        if (np.abs(robot.body.torque(q, v, a)) <= limits.effort).all():
            break
        duration *= 1.2
    return duration
