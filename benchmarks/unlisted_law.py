"""What a law outside the library sees of a session, and the base of such laws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from misfit_drives import Drives, sign

__all__ = ["FRICTION", "Law", "Limits", "Part", "Rows", "sign"]

FRICTION = frozenset({"coulomb_friction", "friction_curve"})


@dataclass(frozen=True)
class Part:
    """A run: time on the session's clock (N,) s; q, v, a (N, n) rad, rad/s, rad/s^2; rigid-body torque (N, n) N m.

    `moment` (N, n) N m: what bends each joint's bearing, where a law asks for it.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    moment: np.ndarray | None = None


@dataclass(frozen=True)
class Limits:
    """Of the arm's joints: speed (n,) rad/s, effort (n,) N m."""

    velocity: np.ndarray
    effort: np.ndarray


Rows = list[np.ndarray]


class Law:
    """Base of the laws: adds nothing.

    `size` multiplies what a law that `scales` adds.
    """

    kin: ClassVar[frozenset[str]] = frozenset()
    scales: ClassVar[bool] = True

    def __init__(self, drives: Drives, limits: Limits, rng: np.random.Generator) -> None:
        self.drives, self.limits = drives, limits
        self.drag, self.heat = np.array(drives.drag), np.array(drives.heat)
        self.n = len(self.drag)
        self.draw(rng)

    def draw(self, rng: np.random.Generator) -> None:
        """Draw what differs from arm to arm."""

    def torque(self, parts: list[Part], size: float) -> Rows:
        """What the law adds to the motor's torque in each run, (N, n) N m."""
        return [size * self.added(p) for p in parts]

    def mains(self, parts: list[Part], motor: Rows, bus: Rows, size: float) -> Rows:
        """What the mains give beside standby in each run, (N,) W, for joints that take `bus` W."""
        return [b + size * self.drawn(p, m, b) for p, m, b in zip(parts, motor, bus, strict=True)]

    def added(self, p: Part) -> np.ndarray:
        return np.zeros_like(p.q)

    def drawn(self, p: Part, motor: np.ndarray, bus: np.ndarray) -> np.ndarray:
        return np.zeros(len(p.t))
