"""Limits of the whole continuous motion, also between the judge's places: proven, or with a place that breaks one.

Position, velocity, acceleration and jerk are polynomials between samples: their largest values are exact to rounding.
The rigid body's torque is a polynomial up to a bounded error (see `analytic`); so is effort if no effect adds torque.
Other effort, and power, differ from their value in the middle of a piece by at most half its length times their largest
rate (see `enclosure`); pieces that may exceed a bound are divided until they do not, or their middle does.

Polynomials are stored as Bernstein coefficients, (d + 1, ...) of degree d on x in [0, 1]: a piece lies between its
smallest and largest coefficient. The first and the last are the values at the ends.
Source: G. Farin, Curves and Surfaces for CAGD, chapters 4 and 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from energy_opt.motion.dense import Dense
from energy_opt.motion.judge.enclosure import Range, Unknown, enclosed
from energy_opt.motion.limits.base import Limit, Violation
from energy_opt.motion.limits.joint import Acceleration, Effort, Jerk, JointLimit, Position, Velocity
from energy_opt.motion.limits.own import Power
from energy_opt.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from energy_opt.motion.judge.energy import Scorer

ROUNDS = 60  # most halvings of a piece: a double has 52 bits


def quintics(trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (6, N - 1, n) of the curve between samples, less each piece's first position; and the steps [s]."""
    h = np.diff(trajectory.time)[:, None]
    q, v, a = trajectory.position, h * trajectory.velocity[:-1] / 5, h**2 * trajectory.acceleration[:-1] / 20
    far, w, c = q[1:] - q[:-1], h * trajectory.velocity[1:] / 5, h**2 * trajectory.acceleration[1:] / 20
    return np.stack([np.zeros_like(v), v, 2 * v + a, far - 2 * w + c, far - w, far]), h


def slope(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Coefficients (d, K, n) of the time derivative of pieces c (d + 1, K, n) that take h (K, 1) [s]."""
    return np.asarray((len(c) - 1) * np.diff(c, axis=0) / h)


@lru_cache(maxsize=4)
def _from_values(degree: int) -> np.ndarray:
    """Matrix from values at degree + 1 even places to coefficients."""
    x = np.linspace(0, 1, degree + 1)[:, None]
    k = np.arange(degree + 1)
    powers = np.array([comb(degree, i) for i in k]) * x**k * (1 - x) ** (degree - k)
    return np.asarray(np.linalg.inv(powers))


def through(values: np.ndarray) -> np.ndarray:
    """Coefficients of the polynomials through values (d + 1, ...) at even places."""
    return np.tensordot(_from_values(len(values) - 1), values, axes=1)


def split(c: np.ndarray, x: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (d + 1, ...) of both parts of pieces c (d + 1, ...) that are divided at x in [0, 1], by de
    Casteljau's algorithm.
    """
    left, right = [c[0]], [c[-1]]
    while len(c) > 1:
        c = (1 - x) * c[:-1] + x * c[1:]
        left.append(c[0])
        right.append(c[-1])
    return np.stack(left), np.stack(right[::-1])


def peak(c: np.ndarray, known: float, tolerance: float) -> tuple[float, int, float]:
    """The largest value of polynomials (d + 1, M) to within `tolerance`; the polynomial, and x there.

    `known` is a value that is reached: what is certainly below it is not searched. Returns (-inf, 0, 0) if nothing is
    above it.
    """
    best = (-np.inf, 0, 0.0)
    number = np.flatnonzero(c.max(axis=0) > known + tolerance)
    c, low, width = c[:, number], np.zeros(len(number)), 1.0
    for _ in range(ROUNDS):
        for row, x in ((c[0], low), (c[-1], low + width)):
            if len(row) and row.max() > max(best[0], known):
                k = int(np.argmax(row))
                best = (float(row[k]), int(number[k]), float(x[k]))
        kept = c.max(axis=0) > max(best[0], known) + tolerance
        if not kept.any():
            break
        c, number, low, width = c[:, kept], number[kept], low[kept], width / 2
        c = np.concatenate(split(c, 0.5), axis=1)
        number, low = np.tile(number, 2), np.concatenate([low, low + width])
    return best


TOLERANCE = 5e-7  # share of a bound: largest uncertainty of a proof
EXACT = 1e-10  # share of a bound: accuracy of the peaks of polynomials
PARTS, MOST = 8, 20_000  # parts into which a piece is divided, and most pieces evaluated before a proof is given up
NARROWEST = 1e-9  # share of a piece: narrower parts, where a value equals its bound, are left unproven
DEGREE = 10  # degree of the polynomial for torque: the judge has so many places between two samples
DERIVATIVES = {Velocity: 1, Acceleration: 2, Jerk: 3}


class Proof:
    """The pieces of one motion between samples, and proofs about them."""

    def __init__(self, dense: Dense, scorer: Scorer) -> None:
        self._dense, self._scorer = dense, scorer
        c, self._h = quintics(dense.trajectory)
        self._derivatives = [c]  # of orders 0 ... 5; the first without each piece's first position
        for _ in range(5):
            self._derivatives.append(slope(self._derivatives[-1], self._h))
        self._begin = dense.time[:: dense.factor][:-1]

    def worst(self, limit: Limit, found: Violation) -> tuple[Violation, bool]:
        """The worst place under a limit, `found` or one between the judge's places, and whether it is proven."""
        if found.excess is None:
            return found, False
        if limit.via.size:
            return found, True  # the samples alone decide whether it is passed
        if isinstance(limit, (Position, *DERIVATIVES)):
            return self._of_polynomials(limit, found), True
        if isinstance(limit, Effort) and not self._scorer.adds_torque:
            return self._of_torque(limit, found)
        if isinstance(limit, (Effort, Power)):
            try:
                return self._of_law(limit, found)
            except Unknown:
                return found, False
        return found, False

    def _over(self, c: np.ndarray, limit: Limit, known: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Excess coefficients (d + 1, M) over bounds of both signs, of those polynomials (d + 1, K, n) that may exceed
        `known`; their columns (M,) among K * 2 n; and the bounds (2 n,).
        """
        if isinstance(limit, Position):
            first, bounds = self._dense.trajectory.position[:-1], np.concatenate([limit.upper, limit.lower])
            unit = np.tile(limit.upper - limit.lower, 2)
        else:
            assert isinstance(limit, JointLimit)
            first, bounds = np.zeros_like(c[0]), np.concatenate([limit.bound, -limit.bound])
            unit = np.abs(bounds)
        unit, sign = np.where(np.isfinite(unit), unit, 1.0), np.repeat([1.0, -1.0], c.shape[2])
        most = np.concatenate([c.max(axis=0) + first, -c.min(axis=0) - first], axis=1)
        piece, j = np.nonzero(most > sign * bounds + known * unit)
        start = first[piece, j % c.shape[2]]
        over = sign[j] * (c[:, piece, j % c.shape[2]] + (start - bounds[j])) / unit[j]
        return over, piece * len(bounds) + j, bounds

    def _of_polynomials(self, limit: Limit, found: Violation) -> Violation:
        c = self._derivatives[next((k for kind, k in DERIVATIVES.items() if isinstance(limit, kind)), 0)]
        return self._peak(c, limit, found, EXACT)

    def _peak(self, c: np.ndarray, limit: Limit, found: Violation, tolerance: float) -> Violation:
        """`found`, or a higher peak of polynomials (d + 1, K, n)."""
        used, column, bounds = self._over(c, limit, _excess(found) + tolerance)
        excess, number, x = peak(used, _excess(found), tolerance)
        if excess <= _excess(found):
            return found
        k, j = divmod(int(column[number]), len(bounds))
        n, sign = len(bounds) // 2, 1.0 if j < len(bounds) // 2 else -1.0
        value, bound = (excess + 1) * float(bounds[j]), abs(float(bounds[j]))
        if isinstance(limit, Position):
            span, bound = float(limit.upper[j % n] - limit.lower[j % n]), float(bounds[j])
            value = bound + sign * excess * (span if np.isfinite(span) else 1.0)
        time = float(self._begin[k] + x * self._h[k, 0])
        return Violation(found.limit, excess, self._dense.joints[j % n], time, value, bound)

    def _torque(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Polynomials (d + 1, K, n B) near rigid-body torque, and bounds (K, n B) of their errors and of their rates'
        errors.
        """
        d = self._dense
        rigid = d.rigid[:: d.factor // DEGREE]
        inner = rigid[:-1].reshape(len(self._begin), DEGREE, -1)
        values = np.concatenate([inner.transpose(1, 0, 2), rigid[None, DEGREE::DEGREE]])
        sizes = [np.abs(c).max(axis=0) for c in self._derivatives[1:]]
        slide = np.abs(self._derivatives[0] + d.trajectory.position[:-1]).max(axis=0)
        errors = [bound.errors(sizes, slide, self._h, DEGREE) for bound in self._scorer.torque_bounds]
        value, rate = (np.concatenate(of_all, axis=1) for of_all in zip(*errors, strict=True))
        return through(values), value, rate

    def _of_torque(self, limit: Effort, found: Violation) -> tuple[Violation, bool]:
        n = len(limit.bound)  # the first of the model's bodies: its torque is limited
        c, error = (x[..., :n] for x in self._torque()[:2])
        out = self._peak(c, limit, found, TOLERANCE)
        open_ = float(np.max(error / limit.bound, initial=0.0, where=np.isfinite(error / limit.bound)))
        return out, bool(np.isfinite(error).all()) and open_ <= TOLERANCE

    def _of_law(self, limit: Effort | Power, found: Violation) -> tuple[Violation, bool]:
        """The worst place by the law's ranges on pieces, divided where they may exceed the bound."""
        power = isinstance(limit, Power)
        if power and self._scorer.remembers:
            return found, False
        function = self._scorer.law_of("powers" if power else "tau_m")
        torque, error, rates = self._torque()
        bound = limit.scale if isinstance(limit, Power) else limit.bound
        count = len(self._begin)
        piece, low, high, looked = np.arange(count), np.zeros(count), np.ones(count), 0
        middle = self._dense.powers if power else self._dense.effort
        middle = middle[self._dense.factor // 2 :: self._dense.factor]
        # divide pieces that may exceed the bound, until none may, or one value does
        while len(piece):
            looked += len(piece)
            if looked > MOST + count:
                return found, False
            ranges = enclosed(function, self._inputs(piece, low, high, torque, error, rates))[0]
            half = (self._h[piece, 0] * (high - low) / 2)[:, None]
            near, rate = middle, half * np.stack([r.rate for r in ranges], axis=1)
            most = np.minimum(np.stack([r.high for r in ranges], axis=1), near + rate) / bound - 1
            if not power:
                least = np.maximum(np.stack([r.low for r in ranges], axis=1), near - rate) / bound
                most = np.maximum(most, -least - 1)
            left = np.flatnonzero(~(most.max(axis=1) <= max(_excess(found), 0.0) + TOLERANCE))
            cuts = low[left, None] + (high - low)[left, None] * np.linspace(0, 1, PARTS + 1)
            piece, low, high = np.repeat(piece[left], PARTS), cuts[:, :-1].ravel(), cuts[:, 1:].ravel()
            if not len(piece):
                return found, True
            if looked + len(piece) > MOST + count or (high - low).min() < NARROWEST:
                return found, False
            places = self._begin[piece] + self._h[piece, 0] * (low + high) / 2
            there = self._scorer.between(self._dense, places)
            worse = limit.worst(there)
            if _excess(worse) > _excess(found):
                found = worse
            middle = there.powers if power else there.effort
        return found, True

    def _inputs(
        self, piece: np.ndarray, low: np.ndarray, high: np.ndarray,
        torque: np.ndarray, error: np.ndarray, rates: np.ndarray,
    ) -> list[list[Range]]:  # fmt: skip
        """Ranges of q, v, a, tau and t on parts of pieces."""
        first = self._dense.trajectory.position[:-1][piece]
        hulls = [_hull(_part_coefficients(c[:, piece], low, high)) for c in self._derivatives[:4]]
        hulls[0] = hulls[0][0] + first, hulls[0][1] + first
        tau = _part_coefficients(torque[:, piece], low, high)
        length = self._h[piece] * (high - low)[:, None]
        tau_low, tau_high = _hull(tau)
        rate_low, rate_high = _hull(slope(tau, length))
        own = [(*hulls[k], *hulls[k + 1]) for k in range(3)]
        own.append((tau_low - error[piece], tau_high + error[piece], rate_low - rates[piece], rate_high + rates[piece]))
        begin, one = self._begin[piece], np.ones(len(piece))
        time = Range(begin + self._h[piece, 0] * low, begin + self._h[piece, 0] * high, one, one)
        return [[Range(*(x[:, j] for x in group)) for j in range(group[0].shape[1])] for group in own] + [[time]]


def _excess(found: Violation) -> float:
    return -np.inf if found.excess is None else found.excess


def _part_coefficients(c: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Coefficients (d + 1, K, n) of pieces from x = low to high, (K,) each."""
    if (low == 0).all() and (high == 1).all():
        return c
    left = split(c, high[:, None])[0]
    return split(left, (low / high)[:, None])[1]


def _hull(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest coefficients."""
    return c.min(axis=0), c.max(axis=0)


def proven(
    dense: Dense, scorer: Scorer, limits: Sequence[Limit], found: Sequence[Violation]
) -> tuple[tuple[Violation, ...], bool]:
    """The worst place under each limit, between the judge's places too, and whether all of them are proven.

    Args:
        dense: the trajectory on the judge's grid. found: the worst of its places under each of `limits`.
    """
    proof = Proof(dense, scorer)
    out = [proof.worst(limit, worst) for limit, worst in zip(limits, found, strict=True)]
    return tuple(worst for worst, _ in out), all(sure for _, sure in out)
