"""Numeric constraints of standard moves (see limits.base.PlaceRows): distances between bodies at places of the motion.

A place stays at its share of its piece while the unknowns change. With J_k = dq_k/dx, a row's gradient g gives g^T J_k,
and a place's Hessian H gives J_k^T H J_k, beside what the bending of q_k itself adds.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from energy_opt.motion.limits.base import PlaceRows
from energy_opt.profiles.chain import Chain
from energy_opt.profiles.symbols import ChainSymbols


class Placed:
    """One limit's constraints on the chain that they were asked for."""

    def __init__(self, rows: PlaceRows, symbols: ChainSymbols, chain: Chain) -> None:
        self.rows = rows
        pieces, shares = chain.places(rows.u * chain.duration)
        q = ca.horzcat(*(symbols.at(int(piece), float(s))[0] for piece, s in zip(pieces, shares, strict=True)))
        pull = ca.SX.sym("pull", q.numel())
        slope = ca.densify(ca.jacobian(ca.vec(q), symbols.x))
        bent = ca.densify(ca.hessian(ca.dot(pull, ca.vec(q)), symbols.x)[0])
        self._position = ca.Function("position", [symbols.x], [ca.densify(q), slope])
        self._bent = ca.Function("bent", [symbols.x, pull], [bent])

    def move(self, x: np.ndarray) -> None:
        """Go to other unknowns."""
        q, slope = self._position(x)
        self._x, self._q = x, np.asarray(q.full()).T.copy()
        self._slope = np.asarray(slope.full()).reshape(*self._q.shape, -1)  # (K, n, unknowns)
        self.value = self.rows.value(self._q)
        self._gradient = self.rows.gradient(self._q)

    def slopes(self) -> np.ndarray:
        """Derivatives with respect to all unknowns, (R, unknowns)."""
        return np.asarray(np.matmul(self._gradient[:, None, :], self._slope[self.rows.place])[:, 0])

    def hessian(self, multipliers: np.ndarray) -> np.ndarray:
        """The constraints' share of the Lagrangian's Hessian, (unknowns, unknowns)."""
        h = self.rows.hessian(self._q, multipliers)
        pull = np.zeros_like(self._q)
        np.add.at(pull, self.rows.place, multipliers[:, None] * self._gradient)
        curved = np.einsum("kai,kab,kbj->ij", self._slope, h, self._slope, optimize=True)
        return np.asarray(curved + np.asarray(self._bent(self._x, pull.ravel()).full()))
