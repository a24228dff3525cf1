"""CasADi functions of scalars evaluated over many points: each instruction at once for all points of a block.

CasADi's own virtual machine takes 3 to 6 ns for an instruction at a point, mostly to find out what it says. In C
(`program.c`) an instruction takes 8 ns for 48 points, so the Hessian of a seven-joint arm's node takes 5 us a point
instead of 100. Compiled, it takes 1.3 us; `benchmarks/compiled.py` shows what that is worth. NumPy takes 0.5 us for an
instruction and then 0.5 ns for each point; it serves from a few hundred points on where there is no compiler. All of
them do the same operations in the same order.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate

import casadi as ca
import numpy as np

from energy_opt.numerics import native
from energy_opt.numerics.native import LANES


def _if_else_zero(condition: np.ndarray, x: np.ndarray, out: np.ndarray) -> np.ndarray:
    """x where the condition holds, else zero."""
    out[...] = np.where(condition, x, 0.0)
    return out


POINTS = 2048  # points of NumPy's blocks: their numbers stay in the processor's cache
WIDEST = 128  # most points of a block in C; their number is a multiple of the lanes of the widest registers
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


@dataclass(frozen=True, eq=False)
class Program:
    """The instructions of a function, on numbered places: its registers, then arguments, results and constants.

    Attributes:
        registers: their count. sizes: entries of each argument, then of each result. inputs: number of arguments.
        constants: their values (c,).
        code: (S, 4) operation, first and second place that it reads (the same one for one operand), place written.
    """

    registers: int
    sizes: tuple[int, ...]
    inputs: int
    constants: np.ndarray
    code: np.ndarray

    @cached_property
    def _code_in_c(self) -> np.ndarray:
        """`code` with the operations' numbers of `program.c`."""
        numbers = {getattr(ca, name): number for number, name in enumerate(native.operations())}
        code = self.code.copy()
        code[:, 0] = [numbers[operation] for operation in self.code[:, 0].tolist()]
        return code

    def over(self, arrays: Sequence[np.ndarray], width: int, c: ctypes.CDLL) -> Callable[[], object]:
        """A call that evaluates in C, of arrays (K, entries) for arguments and results.

        K is a multiple of `width`, and `width` is a multiple of LANES.
        """
        places = _aligned(self.registers + sum(self.sizes) + len(self.constants), width)
        places[len(places) - len(self.constants) :] = self.constants[:, None]
        sizes = np.array(self.sizes, dtype=np.int64)
        addresses = (ctypes.c_void_p * len(arrays))(*(x.ctypes.data for x in arrays))
        numbers = width, len(arrays[0]) // width, self.registers, self.inputs, len(arrays)
        code = self._code_in_c
        given = [native.pointer(code), ctypes.c_long(len(code)), native.pointer(places)]
        given += [*map(ctypes.c_long, numbers), native.pointer(sizes)]

        def call(_held: tuple[np.ndarray, ...] = (places, sizes, code, *arrays)) -> None:
            c.program_run(*given, addresses)

        return call

    def by_numpy(self, arrays: Sequence[np.ndarray]) -> None:
        """Evaluate for arrays (K, entries) for arguments and results, of which each column is one piece of memory."""
        count, code, constants = len(arrays[0]), self.code.tolist(), self.constants.tolist()
        own = np.empty((self.registers, min(POINTS, count)))
        with np.errstate(all="ignore"):
            for first in range(0, count, POINTS):
                block = slice(first, first + POINTS)
                at = [*own[:, : min(POINTS, count - first)], *(column for x in arrays for column in x[block].T)]
                at += constants
                for operation, x, y, written in code:
                    read = (at[x],) if operation in SINGLE else (at[x], at[y])
                    OPERATIONS[operation](*read, out=at[written])


def _aligned(count: int, width: int) -> np.ndarray:
    """Zeros (count, width) that begin at a multiple of the bytes of all lanes."""
    room = np.zeros(count * width + LANES)
    begin = -(room.ctypes.data // room.itemsize) % LANES
    return room[begin : begin + count * width].reshape(count, width)


SINGLE = {ca.OP_ASSIGN, ca.OP_TWICE, *(k for k, f in OPERATIONS.items() if isinstance(f, np.ufunc) and f.nin == 1)}


def width_of(count: int) -> int:
    """Points of each block in C, for `count` points."""
    blocks = -(-count // WIDEST)
    return max(1, -(-count // (blocks * LANES))) * LANES if blocks else LANES


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
    code: list[tuple[int, int, int, int]] = []
    for k in range(function.n_instructions()):
        operation, read = function.instruction_id(k), function.instruction_input(k)
        written = function.instruction_output(k)
        if operation == ca.OP_INPUT:
            place[written[0]] = begin[read[0]] + read[1]
        elif operation == ca.OP_CONST:
            place[written[0]] = begin[-1] + len(constants)
            constants.append(float(function.instruction_constant(k)))
        elif operation == ca.OP_OUTPUT:
            code.append((ca.OP_ASSIGN, place[read[0]], place[read[0]], begin[len(inputs) + written[0]] + written[1]))
        elif operation in OPERATIONS:
            code.append((operation, place[read[0]], place[read[-1]], written[0]))
            place[written[0]] = written[0]
        else:
            return None
    return Program(
        registers, tuple(sizes), len(inputs), np.array(constants), np.array(code, dtype=np.int32).reshape(-1, 4)
    )
