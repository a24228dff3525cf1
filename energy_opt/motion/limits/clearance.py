"""The clearance between bodies as a limit: constraints over frozen planes, renewed whenever a round begins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from energy_opt.cell.planes import Near, PlaneConstraints
from energy_opt.motion.limits.base import Limit


@dataclass(frozen=True, eq=False)
class ClearanceConstraints(Limit):
    """Pairs of bodies stay apart at places of a curve.

    What proves a motion is the cell's proof, not these constraints: they only lead the solver to where it may succeed.

    Attributes:
        near: finds planes.
        u: (K,) places in [0, 1].
        margin: (K, P) what each pair keeps at each place [m].
        reach: nearer than this a pair gets a row [m].
    """

    name = "clearance"
    unit = "m"
    near: Near
    u: np.ndarray
    margin: np.ndarray
    reach: float

    def places(self, curve: Callable[[np.ndarray], np.ndarray]) -> PlaneConstraints | None:
        """Constraints over planes between what is near along `curve`."""
        constraints = self.near.constraints(self.u, curve(self.u), self.margin, self.reach)
        return constraints if len(constraints.place) else None
