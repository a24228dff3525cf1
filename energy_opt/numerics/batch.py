"""CasADi functions of one point evaluated over many points at once, straight from and into NumPy memory."""

from __future__ import annotations

import casadi as ca
import numpy as np


class Batch:
    """A CasADi function of dense columns applied to K points: arguments (K, rows), results (K, entries)."""

    def __init__(self, function: ca.Function, count: int) -> None:
        self._function = function.map(count) if count > 1 else function
        self._in = [np.zeros((count, function.nnz_in(i))) for i in range(function.n_in())]
        self._out = [np.zeros((count, function.nnz_out(i))) for i in range(function.n_out())]
        self._buffer, self._trigger = self._function.buffer()
        for i, given in enumerate(self._in):
            self._buffer.set_arg(i, given.data)
        for i, out in enumerate(self._out):
            self._buffer.set_res(i, out.data)

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """The results; each call overwrites those of the call before."""
        for given, value in zip(self._in, arguments, strict=True):
            given[...] = value
        self._trigger()
        return self._out
