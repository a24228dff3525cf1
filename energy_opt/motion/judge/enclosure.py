"""Ranges of a CasADi function over many pieces of time at once, with the ranges of its time derivative.

This is interval arithmetic on the function's instructions. Each variable consists of four arrays (K,): the least and
the largest value on each piece, and the least and the largest rate. At a kink of a law, the rates on both sides count;
at a jump the rate has no bound. Source: R. Moore, R. Kearfott, M. Cloud, Introduction to Interval Analysis, chapters 5
and 6.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

LEAST = 1e-300  # smallest argument of a logarithm
UNBOUNDED = 1e150  # the value of an unbounded rate; finite, so that products with 0 are 0


@dataclass(frozen=True)
class Range:
    """Values between low and high, rates between falling and rising, (K,) each."""

    low: np.ndarray
    high: np.ndarray
    falling: np.ndarray
    rising: np.ndarray

    @property
    def rate(self) -> np.ndarray:
        """The largest magnitude of the rate, by entry."""
        return np.maximum(-self.falling, self.rising)


@dataclass(frozen=True)
class Not(Range):
    """1 where `of` is 0, else 0."""

    of: Range


@dataclass(frozen=True)
class Case(Range):
    """`value` where `condition` is not 0, else 0."""

    condition: Range
    value: Range


class Unknown(Exception):
    """The function has an instruction without a rule here."""


def _times(a: Sequence[np.ndarray], b: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The range of products of two ranges."""
    p = (a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1])
    return np.minimum(np.minimum(p[0], p[1]), np.minimum(p[2], p[3])), np.maximum(
        np.maximum(p[0], p[1]), np.maximum(p[2], p[3])
    )


def _value(x: Range) -> tuple[np.ndarray, np.ndarray]:
    """The range of the values."""
    return x.low, x.high


def _rates(x: Range) -> tuple[np.ndarray, np.ndarray]:
    """The range of the rates, with infinite rates made finite."""
    return np.maximum(x.falling, -UNBOUNDED), np.minimum(x.rising, UNBOUNDED)


def _add(a: Range, b: Range) -> Range:
    """a + b: least and largest add up, for values and rates; the sum of two complementary cases is one of them."""
    if isinstance(a, Case) and isinstance(b, Case):
        for one, other in ((a, b), (b, a)):
            if isinstance(other.condition, Not) and other.condition.of is one.condition:
                return _chosen(one.condition, one.value, other.value)
    return Range(a.low + b.low, a.high + b.high, a.falling + b.falling, a.rising + b.rising)


def _neg(a: Range) -> Range:
    """-a: least and largest change places."""
    return Range(-a.high, -a.low, -a.rising, -a.falling)


def _mul(a: Range, b: Range) -> Range:
    """a b, with the rate a' b + a b'."""
    first, second = _times(_rates(a), _value(b)), _times(_value(a), _rates(b))
    return Range(*_times(_value(a), _value(b)), first[0] + second[0], first[1] + second[1])


def _chain(a: Range, low: np.ndarray, high: np.ndarray, slope: tuple[np.ndarray, np.ndarray]) -> Range:
    """A function of a range, with the range of its derivative."""
    return Range(low, high, *_times(slope, _rates(a)))


def _rising(f: Callable[[np.ndarray], np.ndarray], df: Callable[[np.ndarray], np.ndarray]) -> Callable[[Range], Range]:
    """A rising function whose derivative is monotone."""

    def of(a: Range) -> Range:
        ends = df(a.low), df(a.high)
        return _chain(a, f(a.low), f(a.high), (np.minimum(*ends), np.maximum(*ends)))

    return of


def _tanh(a: Range) -> Range:
    """tanh: its derivative 1 - tanh^2 is largest where the range is nearest to 0."""
    near = np.where((a.low <= 0) & (a.high >= 0), 0.0, np.minimum(np.abs(a.low), np.abs(a.high)))
    far = np.maximum(np.abs(a.low), np.abs(a.high))
    return _chain(a, np.tanh(a.low), np.tanh(a.high), (1 - np.tanh(far) ** 2, 1 - np.tanh(near) ** 2))


def _square(a: Range) -> Range:
    """a^2, with the derivative 2 a; its least value is 0 if the range contains 0."""
    ends = a.low**2, a.high**2
    least = np.where((a.low <= 0) & (a.high >= 0), 0.0, np.minimum(*ends))
    return _chain(a, least, np.maximum(*ends), (2 * a.low, 2 * a.high))


def _inverse(a: Range) -> Range:
    """1 / a, with the derivative -1 / a^2; unbounded if the range contains 0."""
    across = (a.low <= 0) & (a.high >= 0)
    low, high = (np.where(across, 1.0, x) for x in (a.low, a.high))
    out = _chain(a, 1 / high, 1 / low, (-1 / np.minimum(low**2, high**2), -1 / np.maximum(low**2, high**2)))
    return _unless(across, out)


def _sqrt(a: Range) -> Range:
    """sqrt(a), with the derivative 1 / (2 sqrt(a)), which has no bound at 0."""
    low, high = np.maximum(a.low, 0.0), np.maximum(a.high, 0.0)
    with np.errstate(divide="ignore"):
        slope = np.minimum(0.5 / np.sqrt(high), UNBOUNDED), np.minimum(0.5 / np.sqrt(low), UNBOUNDED)
    return _chain(a, np.sqrt(low), np.sqrt(high), slope)


def _log(a: Range) -> Range:
    """log(a) of a > 0, with the derivative 1 / a; unbounded below and in its rate if the range contains 0."""
    low, high = np.maximum(a.low, LEAST), np.maximum(a.high, LEAST)
    out = _chain(a, np.log(low), np.log(high), (1 / high, np.minimum(1 / low, UNBOUNDED)))
    return Range(np.where(a.low > 0, out.low, -UNBOUNDED), out.high, out.falling, out.rising)


def _cos(a: Range) -> Range:
    """cos(a), with the derivative -sin(a)."""
    return _chain(a, *_cosine(a.low, a.high), _cosine(a.low + np.pi / 2, a.high + np.pi / 2))


def _cosine(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The range of cos: of its ends, and -1 or 1 if the range contains such a place."""
    ends, turn = (np.cos(low), np.cos(high)), 2 * np.pi
    top, bottom = (np.floor(high / turn - k) >= np.ceil(low / turn - k) for k in (0.0, 0.5))
    return np.where(bottom, -1.0, np.minimum(*ends)), np.where(top, 1.0, np.maximum(*ends))


def _unless(lost: np.ndarray, x: Range) -> Range:
    """The range, but unbounded where `lost`."""
    far = np.full(len(lost), UNBOUNDED)
    return Range(
        *(
            np.where(lost, y, z)
            for y, z in zip((-far, far, -far, far), (x.low, x.high, x.falling, x.rising), strict=True)
        )
    )


def _hull(x: Range, y: Range, only_x: np.ndarray, only_y: np.ndarray) -> Range:
    """x or y, if it is known which; else the hull of both."""
    pairs = zip((x.low, x.high, x.falling, x.rising), (y.low, y.high, y.falling, y.rising), strict=True)
    both = [(f, g, np.minimum(f, g) if k % 2 == 0 else np.maximum(f, g)) for k, (f, g) in enumerate(pairs)]
    return Range(*(np.where(only_x, f, np.where(only_y, g, hull)) for f, g, hull in both))


def _fmax(a: Range, b: Range) -> Range:
    """max(a, b): the rate of the larger one; of both if the ranges overlap."""
    out = _hull(a, b, a.low >= b.high, b.low >= a.high)
    return Range(np.maximum(a.low, b.low), np.maximum(a.high, b.high), out.falling, out.rising)


def _fabs(a: Range) -> Range:
    """|a| = max(a, -a)."""
    return _fmax(a, _neg(a))


def _constant(low: np.ndarray, high: np.ndarray) -> Range:
    """Constant values, which jump if low and high differ."""
    jump = np.where(low == high, 0.0, UNBOUNDED)
    return Range(low, high, -jump, jump)


def _sign(a: Range) -> Range:
    """sign(a), which jumps at 0."""
    return _constant(np.sign(a.low), np.sign(a.high))


def _below(a: Range, b: Range) -> Range:
    """1 if a < b, else 0."""
    return _constant((a.high < b.low) * 1.0, (a.low < b.high) * 1.0)


def _at_most(a: Range, b: Range) -> Range:
    """1 if a <= b, else 0."""
    return _constant((a.high <= b.low) * 1.0, (a.low <= b.high) * 1.0)


def _chosen(condition: Range, x: Range, y: Range) -> Range:
    """x where the condition is not 0, else y; the value may jump where that is unknown."""
    on, off = (condition.low > 0) | (condition.high < 0), (condition.low == 0) & (condition.high == 0)
    out = _hull(x, y, on, off)
    jump = np.where(on | off, 0.0, UNBOUNDED)
    return Range(out.low, out.high, out.falling - jump, out.rising + jump)


def _if(a: Range, b: Range) -> Range:
    """b where a is not 0, else 0."""
    out = _chosen(a, b, Range(*(np.zeros_like(b.low),) * 4))
    return Case(out.low, out.high, out.falling, out.rising, a, b)


def _not(a: Range) -> Range:
    """1 where a is 0, else 0."""
    out = _constant(((a.low == 0) & (a.high == 0)) * 1.0, ((a.low <= 0) & (a.high >= 0)) * 1.0)
    return Not(out.low, out.high, out.falling, out.rising, a)


ONE: dict[int, Callable[[Range], Range]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_NEG: _neg,
    ca.OP_SQ: _square,
    ca.OP_TWICE: lambda a: _add(a, a),
    ca.OP_INV: _inverse,
    ca.OP_SQRT: _sqrt,
    ca.OP_EXP: _rising(lambda x: np.exp(np.minimum(x, 300.0)), lambda x: np.exp(np.minimum(x, 300.0))),
    ca.OP_LOG: _log,
    ca.OP_COS: _cos,
    ca.OP_SIN: lambda a: _cos(_add(a, _constant(*(np.full(len(a.low), -np.pi / 2),) * 2))),
    ca.OP_TANH: _tanh,
    ca.OP_FABS: _fabs,
    ca.OP_SIGN: _sign,
    ca.OP_NOT: _not,
}
TWO: dict[int, Callable[[Range, Range], Range]] = {
    ca.OP_ADD: _add,
    ca.OP_SUB: lambda a, b: _add(a, _neg(b)),
    ca.OP_MUL: _mul,
    ca.OP_DIV: lambda a, b: _mul(a, _inverse(b)),
    ca.OP_FMAX: _fmax,
    ca.OP_FMIN: lambda a, b: _neg(_fmax(_neg(a), _neg(b))),
    ca.OP_LT: _below,
    ca.OP_LE: _at_most,
    ca.OP_IF_ELSE_ZERO: _if,
    ca.OP_AND: lambda a, b: _constant(a.low * b.low, a.high * b.high),
    ca.OP_OR: lambda a, b: _constant(np.maximum(a.low, b.low), np.maximum(a.high, b.high)),
}


def enclosed(function: ca.Function, inputs: Sequence[Sequence[Range]]) -> list[list[Range]]:
    """Ranges of a function's outputs from those of its inputs, element by element.

    Raises:
        Unknown: an instruction without a rule here.
    """
    with np.errstate(all="ignore"):  # overflow gives no bound
        return _enclosed(function, inputs)


def _enclosed(function: ca.Function, inputs: Sequence[Sequence[Range]]) -> list[list[Range]]:
    """`enclosed` without the treatment of overflow: one instruction after the other."""
    count = len(inputs[0][0].low)
    work: dict[int, Range] = {}
    out: list[list[Range]] = [[] for _ in range(function.n_out())]
    for k in range(function.n_instructions()):
        op, at, to = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_OUTPUT:
            needed = out[to[0]]
            needed += [_constant(*(np.zeros(count),) * 2)] * (to[1] + 1 - len(needed))
            needed[to[1]] = work[at[0]]
        elif op == ca.OP_INPUT:
            work[to[0]] = inputs[at[0]][at[1]]
        elif op == ca.OP_CONST:
            value = np.full(count, function.instruction_constant(k))
            work[to[0]] = _constant(value, value)
        elif op in ONE:
            work[to[0]] = ONE[op](work[at[0]])
        elif op in TWO:
            work[to[0]] = TWO[op](work[at[0]], work[at[1]])
        else:
            raise Unknown(f"instruction {op}")
    return out
