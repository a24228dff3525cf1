"""What velocity, acceleration, jerk and effort have in common: a bound on the magnitude of one number per joint."""

from __future__ import annotations

from typing import Self

import numpy as np

from energy_opt.motion.dense import Dense
from energy_opt.motion.limits.base import Limit, Violation, worst_of


class JointLimit(Limit):
    """|value_j| <= bound_j for every joint; inf: no bound."""

    def __init__(self, bound: np.ndarray) -> None:
        self.bound = np.asarray(bound, dtype=float)

    def of(self, x: Dense) -> np.ndarray:
        """The limited value of every sample, (N, n)."""
        raise NotImplementedError

    def worst(self, x: Dense) -> Violation:
        value = self.of(x)
        return worst_of(self, x, value, self.bound, np.abs(value) / self.bound - 1)

    def scaled(self, share: float) -> Self:
        return type(self)(self.bound * share)
