"""The arm's electrical power at the meter, without the meter's faults: P <= W. Controllers trip on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import casadi as ca
import numpy as np

from energy_opt.errors import BadInput
from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Fixed, Limit, Linear, State, Violation, worst_of
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.robot import Robot

STEP = 1e-5  # relative, of differences
ONE_SIDED = 20.0  # bounds: power that flows back is not held to less than so many of them


class Power(Limit):
    """A bound [W]; power that flows back is never too much."""

    name, unit = "power", "W"
    one_sided = True
    local = True

    def __init__(self, bound: float) -> None:
        if not 0.001 <= bound <= 1e09:
            raise BadInput(f"--max-power {bound:g}: expected 0.001 to 1e+09 W")
        self.scale = np.array([float(bound)])

    @classmethod
    def asked(cls, robot: Robot, settings: Settings, move: Move | None, gravity: np.ndarray) -> Self | None:
        return None if settings.max_power is None else cls(settings.max_power)

    def where(self, joints: Sequence[str], column: int) -> str:
        return "the arm"

    def worst(self, x: Dense) -> Violation:
        value = x.power[:, None]
        return worst_of(self, x, value, self.scale, value / self.scale - 1)

    def peaked(self, x: Dense) -> np.ndarray:
        return x.power[:, None] / self.scale

    def scaled(self, share: float) -> Self:
        return type(self)(float(self.scale[0]) * share)

    def expression(self, x: State, p: ca.SX) -> ca.SX:
        return x.power

    def fixed(self, d: PathDynamics) -> Fixed:
        none = np.zeros(len(d.s))
        held = self.use(d, none, none)

        def text(k: int, j: int) -> str:
            return f"standing still takes {held[k, j] * self.scale[0]:.4g} W, the limit is {self.scale[0]:.4g} W"

        return Fixed(held - 1, text, holding=True)

    def tangent(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> Linear:
        step_a, step_b = STEP * (1.0 + np.abs(a)), STEP * np.maximum(b, 1e-3)
        b = np.maximum(b, 2 * step_b)
        by_a = (d.power(a + step_a, b) - d.power(a - step_a, b)) / (2 * step_a)
        by_b = (d.power(a, b + step_b) - d.power(a, b - step_b)) / (2 * step_b)
        rest = d.power(a, b) - by_a * a - by_b * b
        # P <= W as |P + (r - 1) W| <= r W: what flows back stays out of sight
        share = ONE_SIDED * self.scale
        return Linear(*(x[:, None] / share for x in (by_a, by_b, rest + (ONE_SIDED - 1) * self.scale)))

    def use(self, d: PathDynamics, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return d.power(a, b)[:, None] / self.scale
