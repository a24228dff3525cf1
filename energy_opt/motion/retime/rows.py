"""The limits that a retiming is held to at the places where a solve broke them: |value| <= 1, in units of the bound.

Every one of them depends on three neighbouring control values only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from energy_opt.motion.limits.base import Functions
from energy_opt.motion.retime.quadrature import Lift, gathered


@dataclass(frozen=True)
class LinearRows:
    """ra a + rb b + r0 at one place each (K,): speed, acceleration, and torque where it is affine.

    Its bound of 1 is kept a little tighter than the true limit, which is `allowed` (K,) >= 1.
    """

    lift: Lift  # of (a, b)
    ra: np.ndarray
    rb: np.ndarray
    r0: np.ndarray
    allowed: np.ndarray

    @property
    def first(self) -> np.ndarray:
        """(K,) the first of the three control values that each row depends on."""
        return self.lift.first

    @cached_property
    def entries(self) -> np.ndarray:
        """(K, 3) the constraints' coefficients of these control values."""
        return self.ra[:, None] * self.lift.maps[0] + self.rb[:, None] * self.lift.maps[1]

    def values(self, control: np.ndarray) -> np.ndarray:
        """(K,) for control values (N + 2,), ends included."""
        return np.einsum("mk,mk->m", self.entries, control[self.lift.touched]) + self.r0

    def slopes(self, control: np.ndarray) -> np.ndarray:
        """(K, 3) derivatives with respect to the control values that each row depends on."""
        return self.entries

    def hessian(self, control: np.ndarray, multipliers: np.ndarray) -> np.ndarray | float:
        """Sum of the constraints' Hessians times `multipliers` (K,), in the form of `Band`."""
        return 0.0

    def adjoint(self, multipliers: np.ndarray) -> np.ndarray:
        """Sum of the constraints' gradients times `multipliers` (K,), with respect to the free control values."""
        return gathered(self.first, self.entries * multipliers[:, None], self.lift.count)


@dataclass(frozen=True)
class CurvedRows:
    """Limits that are not linear in (a, b) or (a, b, w), `each` of them at every place of `lift`."""

    lift: Lift
    functions: Functions
    each: int
    one_sided: bool = False

    @cached_property
    def first(self) -> np.ndarray:
        return np.repeat(self.lift.first, self.each)

    def values(self, control: np.ndarray) -> np.ndarray:
        return self.functions.value(self.lift.values(control)).ravel()

    def slopes(self, control: np.ndarray) -> np.ndarray:
        slope = self.functions.slope(self.lift.values(control))
        return np.einsum("mrd,dmk->mrk", slope, self.lift.maps).reshape(-1, 3)

    def hessian(self, control: np.ndarray, multipliers: np.ndarray) -> np.ndarray | float:
        z = self.lift.values(control)
        return self.lift.hessian(self.functions.curvature(z, multipliers.reshape(-1, self.each)))


@dataclass(frozen=True)
class Rows:
    """All limits in force, the linear ones first."""

    linear: LinearRows | None = None
    curved: tuple[CurvedRows, ...] = ()

    @cached_property
    def blocks(self) -> tuple[LinearRows | CurvedRows, ...]:
        return self.curved if self.linear is None else (self.linear, *self.curved)

    @cached_property
    def first(self) -> np.ndarray:
        """(count,) the first of the three control values that each row depends on."""
        return np.concatenate([np.zeros(0, dtype=int), *(block.first for block in self.blocks)])

    @property
    def count(self) -> int:
        """Number of constraints."""
        return len(self.first)

    @property
    def lower(self) -> np.ndarray:
        """Lower bounds (count,)."""
        sides = [(-np.inf if isinstance(b, CurvedRows) and b.one_sided else -1.0, len(b.first)) for b in self.blocks]
        return np.concatenate([np.zeros(0), *(np.full(count, side) for side, count in sides)])

    def values(self, control: np.ndarray) -> np.ndarray:
        """(count,)."""
        return np.concatenate([np.zeros(0), *(block.values(control) for block in self.blocks)])

    def slopes(self, control: np.ndarray) -> np.ndarray:
        """(count, 3) derivatives with respect to the control values that each row depends on."""
        return np.concatenate([np.zeros((0, 3)), *(block.slopes(control) for block in self.blocks)])

    def hessian(self, control: np.ndarray, multipliers: np.ndarray) -> np.ndarray | float:
        """Sum of the constraints' Hessians times `multipliers` (count,), in the form of `Band`."""
        total: np.ndarray | float = 0.0
        used = 0
        for block in self.blocks:
            total = total + block.hessian(control, multipliers[used : used + len(block.first)])
            used += len(block.first)
        return total
