"""Measured sets of an arm with a hidden cause, from pinocchio and numpy alone: no law of the package takes part."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

from energy_opt.robot.catalog import CATALOG, urdf_of
from energy_opt.tables import write_table

STEP = 0.01  # [s] between samples
STANDBY, COPPER = 60.0, 0.004  # [W], [W/(N m)^2]


class Hidden:
    """An arm by name; `joints` in its own order, `limits` (2, n) [rad] within which it moves."""

    def __init__(self, name: str) -> None:
        self.name, entry = name, CATALOG[name]
        whole = pin.buildModelFromUrdf(str(urdf_of(entry)))
        self.model = pin.buildReducedModel(whole, [whole.getJointId(j) for j in entry.lock], pin.neutral(whole))
        self.joints = list(self.model.names)[1:]
        low, high = self.model.lowerPositionLimit, self.model.upperPositionLimit
        self.limits = (low + high) / 2 + np.outer([-1, 1], np.minimum(0.3 * (high - low), 1.5))

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """(N, n) [N m] without friction."""
        data = self.model.createData()
        return np.array([pin.rnea(self.model, data, *row) for row in zip(q, v, a, strict=True)])

    def motion(self, rng: np.random.Generator, legs: int, rest: float) -> tuple[np.ndarray, ...]:
        """t, q, v, a of minimum-jerk legs between random poses, with rests before, between and after."""
        q, rows = rng.uniform(*self.limits), []
        for k in range(legs + 1):
            none = np.zeros((round(rest / STEP), len(q)))
            rows.append((q + none, none, none))
            if k < legs:
                way = rng.uniform(*self.limits) - q
                speed = self.model.velocityLimit * rng.uniform(0.25, 0.8)
                lasts = max(float(np.max(1.875 * np.abs(way) / speed)), 0.5)
                u = np.arange(0, 1, STEP / lasts)[:, None]
                s = 10 * u**3 - 15 * u**4 + 6 * u**5
                ds, dds = (30 * u**2 - 60 * u**3 + 30 * u**4) / lasts, (60 * u - 180 * u**2 + 120 * u**3) / lasts**2
                rows.append((q + s * way, ds * way, dds * way))
                q = q + way
        q, v, a = (np.vstack(x) for x in zip(*rows, strict=True))
        return STEP * np.arange(len(q)), q, v, a


def coloured(rng: np.random.Generator, count: int, size: float, memory: float) -> np.ndarray:
    """Noise of a first-order process, (count,) [W]; white if `memory` [s] is 0."""
    out, keep = size * rng.normal(size=count), np.exp(-STEP / memory) if memory else 0.0
    for k in range(1, count):
        out[k] = keep * out[k - 1] + (1 - keep**2) ** 0.5 * out[k]
    return out


def record(
    folder: Path,
    arm: Hidden,
    meter: Callable[[np.ndarray], np.ndarray] = lambda power: power,
    friction: Callable[[np.ndarray], np.ndarray] = lambda v: 0 * v,
    runs: int = 8,
    legs: int = 3,
    rest: float = 0.6,
    noise: float = 0.5,
    memory: float = 0.0,
    seed: int = 1,
) -> Path:
    """Write a set of random motions with standby, copper loss, `friction` (v) [N m] and a `meter` of the power."""
    rng = np.random.default_rng(seed)
    head = ["time", *(f"{joint}.position" for joint in arm.joints), "power"]
    words = ['format = "energy-opt/log/1"', f'robot = "{arm.name}"']
    folder.mkdir(parents=True)
    for k in range(runs):
        t, q, v, a = arm.motion(rng, legs, rest)
        torque = arm.torque(q, v, a) + friction(v)
        power = meter(STANDBY + (torque * v).sum(axis=1) + COPPER * (torque**2).sum(axis=1))
        write_table(folder / f"{k}.csv", head, [t, *q.T, power + coloured(rng, len(t), noise, memory)])
        words.append(f'[[run]]\nfile = "{k}.csv"')
    (folder / "log.toml").write_text("\n".join(words) + "\n")
    return folder
