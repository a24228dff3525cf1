"""CasADi functions of one point evaluated over many points at once, straight from and into NumPy memory.

The function over a block of points is built once and shared by all who want it; it has no memory of its own. The
memory, a batch's arrays, belongs to the one who made the batch: two batches of one function, in two threads too, never
meet.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

# Points a block: building the function over a block takes time and memory in proportion to it (0.3 ms at 256 for a
# law of power, several ms for a Hessian), more calls cost next to nothing.
BLOCK = 256


@lru_cache(maxsize=128)
def _over(function: ca.Function, count: int) -> ca.Function:
    """The function over `count` points."""
    return function.map(count) if count > 1 else function


class Batch:
    """A CasADi function of dense columns applied to K points: arguments (K, inputs), results (K, entries)."""

    def __init__(self, function: ca.Function, count: int) -> None:
        block = max(1, min(count, BLOCK))
        padded = -(-count // block) * block
        self._in = [np.zeros((padded, function.nnz_in(i))) for i in range(function.n_in())]
        self._out = [np.zeros((padded, function.nnz_out(i))) for i in range(function.n_out())]
        self._given = [given[:count] for given in self._in]
        self._answer = [out[:count] for out in self._out]
        over = _over(function, block)
        self._blocks = []
        for first in range(0, padded, block):
            buffer, evaluate = over.buffer()
            for i, given in enumerate(self._in):
                buffer.set_arg(i, given[first : first + block].data)
            for i, out in enumerate(self._out):
                buffer.set_res(i, out[first : first + block].data)
            self._blocks.append((buffer, evaluate))

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """The results; each call overwrites those of the call before."""
        for given, value in zip(self._given, arguments, strict=True):
            given[...] = value
        for _, evaluate in self._blocks:
            evaluate()
        return self._answer
