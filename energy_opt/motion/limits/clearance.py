"""The clearance between bodies as a limit: constraints over frozen planes, renewed at the start of each round."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from energy_opt.cell.planes import Near, PlaneConstraints
from energy_opt.motion.limits.base import Limit


@dataclass(frozen=True, eq=False)
class ClearanceConstraints(Limit):
    """Pairs of bodies stay apart at places of a curve.

    A motion is proven by the cell's proof, not by these constraints: they only lead the solver to where it may succeed.

    Attributes:
        near: finds planes.
        u: (K,) places in [0, 1].
        margin: (K, P) distance that each pair keeps at each place [m].
        reach: pairs get a constraint that are nearer than this and the largest margin [m].
    """

    name = "clearance"
    unit = "m"
    near: Near
    u: np.ndarray
    margin: np.ndarray
    reach: float

    def places(self, curve: Callable[[np.ndarray], np.ndarray]) -> PlaneConstraints | None:
        """Constraints over planes between bodies that are near along `curve`."""
        reach = self.reach + float(self.margin.max(initial=0.0))
        constraints = self.near.constraints(self.u, curve(self.u), self.margin, reach)
        return constraints if len(constraints.place) else None
