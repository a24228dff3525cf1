"""What keeps standard moves clear of the arm's own body and its cell: planes, more where a proof failed."""

from __future__ import annotations

import numpy as np

from energy_opt.cell.cell import Cell, Clearance
from energy_opt.cell.planes import Near
from energy_opt.motion.limits.clearance import ClearanceRows
from energy_opt.motion.reshape.clear import REACH, Margins, Places


class Keep:
    """The constraints for moves between two poses `ends` (2, n); they learn from proofs that fail."""

    def __init__(self, cell: Cell, near: Near, ends: np.ndarray) -> None:
        self._near, self._margins = near, Margins(cell, ends)
        self._places = Places.evenly(len(self._margins.wanted))

    def learn(self, proof: Clearance, duration: float) -> None:
        """Look where a proof failed, and keep more distance there."""
        self._places.learn(proof, duration)

    def rows(self) -> ClearanceRows:
        """The limit to be added to the others."""
        return ClearanceRows(self._near, self._places.u, self._margins.at(self._places), REACH)
