"""CasADi functions of scalars evaluated over many points by NumPy: each instruction at once for all points of a block.

CasADi's own virtual machine takes some 6 ns for an instruction at a point. NumPy takes 0.5 us for an instruction and
then 0.5 ns for each point, so from a few hundred points on it is several times as fast.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate

import casadi as ca
import numpy as np


def _if_else_zero(condition: np.ndarray, x: np.ndarray, out: np.ndarray) -> np.ndarray:
    """x where the condition holds, else zero."""
    out[...] = np.where(condition, x, 0.0)
    return out


POINTS = 2048  # points of a block: its numbers stay in the processor's cache
OPERATIONS: dict[int, Callable[..., np.ndarray]] = {
    ca.OP_ASSIGN: np.positive, ca.OP_ADD: np.add, ca.OP_SUB: np.subtract, ca.OP_MUL: np.multiply, ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative, ca.OP_SQ: np.square, ca.OP_INV: np.reciprocal, ca.OP_SQRT: np.sqrt, ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power, ca.OP_TWICE: lambda x, out: np.add(x, x, out=out), ca.OP_EXP: np.exp, ca.OP_LOG: np.log,
    ca.OP_EXPM1: np.expm1, ca.OP_LOG1P: np.log1p, ca.OP_SIN: np.sin, ca.OP_COS: np.cos, ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin, ca.OP_ACOS: np.arccos, ca.OP_ATAN: np.arctan, ca.OP_ATAN2: np.arctan2,
    ca.OP_SINH: np.sinh, ca.OP_COSH: np.cosh, ca.OP_TANH: np.tanh, ca.OP_ASINH: np.arcsinh, ca.OP_ACOSH: np.arccosh,
    ca.OP_ATANH: np.arctanh, ca.OP_HYPOT: np.hypot, ca.OP_FABS: np.absolute, ca.OP_SIGN: np.sign,
    ca.OP_COPYSIGN: np.copysign, ca.OP_FLOOR: np.floor, ca.OP_CEIL: np.ceil, ca.OP_FMOD: np.fmod, ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax, ca.OP_LT: np.less, ca.OP_LE: np.less_equal, ca.OP_EQ: np.equal, ca.OP_NE: np.not_equal,
    ca.OP_NOT: np.logical_not, ca.OP_AND: np.logical_and, ca.OP_OR: np.logical_or,
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
}  # fmt: skip


@dataclass(frozen=True)
class Program:
    """The instructions of a function, on numbered places: its registers, then inputs, results and constants.

    Attributes:
        registers: their count. constants: their values.
        steps: operation, places that it reads, and the place that it writes.
    """

    registers: int
    constants: tuple[float, ...]
    steps: tuple[tuple[Callable[..., np.ndarray], tuple[int, ...], int], ...]

    def __call__(self, inputs: Sequence[np.ndarray], results: Sequence[np.ndarray]) -> None:
        """Evaluate for arrays (K, entries) of which each column is one piece of memory."""
        count = len(inputs[0]) if inputs else len(results[0])
        own = np.empty((self.registers, min(POINTS, count)))
        with np.errstate(all="ignore"):
            for first in range(0, count, POINTS):
                block = slice(first, first + POINTS)
                at = [*own[:, : min(POINTS, count - first)], *(column for x in inputs for column in x[block].T)]
                at += [column for x in results for column in x[block].T]
                at += self.constants
                for operation, read, written in self.steps:
                    operation(*(at[k] for k in read), out=at[written])


@lru_cache(maxsize=128)
def program_of(function: ca.Function) -> Program | None:
    """The program of a function with dense columns as arguments; None if it has other instructions than sums, products
    and the like.
    """
    if not function.is_a("SXFunction"):
        return None
    registers, inputs, results = function.sz_w(), range(function.n_in()), range(function.n_out())
    sizes = [*(function.nnz_in(i) for i in inputs), *(function.nnz_out(i) for i in results)]
    begin = list(accumulate(sizes, initial=registers))
    place: list[int] = list(range(registers))
    constants: list[float] = []
    steps: list[tuple[Callable[..., np.ndarray], tuple[int, ...], int]] = []
    for k in range(function.n_instructions()):
        operation, read = function.instruction_id(k), function.instruction_input(k)
        written = function.instruction_output(k)
        if operation == ca.OP_INPUT:
            place[written[0]] = begin[read[0]] + read[1]
        elif operation == ca.OP_CONST:
            place[written[0]] = begin[-1] + len(constants)
            constants.append(float(function.instruction_constant(k)))
        elif operation == ca.OP_OUTPUT:
            steps.append((np.positive, (place[read[0]],), begin[len(inputs) + written[0]] + written[1]))
        elif operation in OPERATIONS:
            steps.append((OPERATIONS[operation], tuple(place[r] for r in read), written[0]))
            place[written[0]] = written[0]
        else:
            return None
    return Program(registers, tuple(constants), tuple(steps))
