"""CasADi functions of one point evaluated over many points at once, straight from and into NumPy memory.

A function that is not compiled runs instruction by instruction for a block of points (see `vectors`). Only functions
of other instructions, and few points where there is no compiler, take CasADi's virtual machine. Each batch owns its
arrays. So two batches of one function do not disturb each other, also in two threads.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Literal

import casadi as ca
import numpy as np

from energy_opt.numerics import native
from energy_opt.numerics.lanes import Compiled, sizes
from energy_opt.numerics.native import LANES
from energy_opt.numerics.vectors import program_of, width_of

# Points per block of CasADi's virtual machine, and least points for NumPy: the time and memory to build the function
# over a block are proportional to it (0.3 ms at 256 for a law of power, several ms for a Hessian); more calls cost
# almost nothing.
BLOCK = 256


@lru_cache(maxsize=128)
def _over(function: ca.Function, count: int) -> ca.Function:
    """The function over `count` points."""
    return function.map(count) if count > 1 else function


class Batch:
    """A function of dense columns applied to K points: arguments (K, inputs), results (K, entries)."""

    def __init__(self, function: ca.Function | Compiled, count: int) -> None:
        ready = isinstance(function, Compiled)
        c = None if ready else native.library("vectors")
        program = program_of(function) if not ready and (c is not None or count >= BLOCK) else None
        inputs, outputs = (function.inputs, function.outputs) if ready else sizes(function)
        # compiled functions take LANES points at once, programs a block of points, else CasADi's virtual machine maps
        if ready:
            block = LANES
        elif program is None:
            block = max(1, min(count, BLOCK))
        else:
            block = 1 if c is None else width_of(count)
        padded = -(-count // block) * block
        order: Literal["C", "F"] = "F" if program is not None and c is None else "C"
        self._in = [np.zeros((padded, size), order=order) for size in inputs]
        self._out = [np.zeros((padded, size), order=order) for size in outputs]
        self._given = [given[:count] for given in self._in]
        self._answer = [out[:count] for out in self._out]
        self._calls: list[Callable[[], object]] = []
        if ready:
            pointers = [(ctypes.c_void_p * len(held))(*(x.ctypes.data for x in held)) for held in (self._in, self._out)]
            self._calls.append(partial(function.many, *pointers, ctypes.c_long(padded // block)))
            return
        if program is not None:
            arrays = [*self._in, *self._out]
            self._calls.append(partial(program.by_numpy, arrays) if c is None else program.over(arrays, block, c))
            return
        over = _over(function, block)
        for first in range(0, padded, block):
            buffer, evaluate = over.buffer()
            for i, given in enumerate(self._in):
                buffer.set_arg(i, given[first : first + block].data)
            for i, out in enumerate(self._out):
                buffer.set_res(i, out[first : first + block].data)
            self._calls.append(partial(_evaluated, buffer, evaluate))

    def fixing(self, first: int, *arguments: np.ndarray) -> Batch:
        """The same batch, with constant arguments from number `first` on; a row (inputs,) counts for every point."""
        held = slice(first, first + len(arguments))
        for given, value in zip(self._given[held], arguments, strict=True):
            given[...] = value
        del self._given[held]
        return self

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """The results for the arguments that are not fixed; each call overwrites those of the call before."""
        for given, value in zip(self._given, arguments, strict=True):
            given[...] = value
        for call in self._calls:
            call()
        return self._answer


def _evaluated(buffer: object, evaluate: Callable[[], object]) -> None:
    """Evaluate; `buffer` is kept as long as it may be used."""
    evaluate()
