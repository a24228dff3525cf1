"""Clamped B-splines: quintic ones on [0, 1] for curves in time, and quadratic ones on any knots for squared path speed.

Quintic splines have basis matrices, quadrature on the knot spans and a least-squares fit. Their knots are packed
towards the ends, where a move from rest builds up its acceleration from zero. The breakpoints are
u_i = (1 - p) x_i + p (1 - cos(pi x_i)) / 2 for evenly spaced x_i, with the packing p between 0 and 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from scipy.interpolate import BSpline

DEGREE = 5  # C^4: acceleration and jerk are smooth
PACKING = 0.95  # 0: evenly spaced knots, 1: Chebyshev-like clustering at the ends; 0.8 gives up to 2 % more loss


@dataclass(frozen=True)
class Basis:
    """Quintic B-splines on knots that are packed towards both ends.

    Attributes:
        controls: number of control points. packing: p of the module, 0 to 1.
    """

    controls: int
    packing: float = PACKING

    @cached_property
    def breaks(self) -> np.ndarray:
        """Distinct knots, (controls - DEGREE + 1,)."""
        x = np.linspace(0, 1, self.controls - DEGREE + 1)
        return (1 - self.packing) * x + self.packing * (1 - np.cos(np.pi * x)) / 2

    @cached_property
    def knots(self) -> np.ndarray:
        """The clamped knot vector, (controls + DEGREE + 1,)."""
        return np.concatenate([np.zeros(DEGREE), self.breaks, np.ones(DEGREE)])

    def matrix(self, u: np.ndarray, order: int = 0) -> np.ndarray:
        """Derivative of `order` of every basis function at u (M,): (M, controls)."""
        return _functions(self, order)(np.clip(u, 0.0, 1.0))

    def polygon(self, order: int) -> np.ndarray:
        """Control points of the derivative of `order` from those of the curve, (controls - order, controls).

        A derivative lies in the hull of its control points, so bounds on these hold at every u.
        """
        return np.asarray(_functions(self, order).c[: self.controls - order])

    def gauss(self, per_span: int) -> tuple[np.ndarray, np.ndarray]:
        """Nodes and weights of Gauss quadrature over every knot span, (spans * per_span,) each."""
        x, w = np.polynomial.legendre.leggauss(per_span)
        span = np.diff(self.breaks)[:, None]
        return (self.breaks[:-1, None] + span * (x + 1) / 2).ravel(), (span * w / 2).ravel()

    def ends(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray | None, last: bool
    ) -> np.ndarray:
        """Control points (2 or 3, n) that give position, velocity and, if given, acceleration at an end.

        Derivatives are with respect to u. They are the first control points, or with `last` the last ones, in order.
        """
        count = 2 if acceleration is None else 3
        at = np.array([1.0 if last else 0.0])
        columns = slice(self.controls - count, self.controls) if last else slice(0, count)
        system = np.vstack([self.matrix(at, order)[:, columns] for order in range(count)])
        values = [position, velocity] + ([] if acceleration is None else [acceleration])
        return np.linalg.solve(system, np.vstack(values))

    def fit(self, u: np.ndarray, values: np.ndarray, head: np.ndarray, tail: np.ndarray) -> np.ndarray:
        """Control points (controls, n) whose curve is closest to given values (least squares).

        Args:
            u: (M,) in [0, 1]. values: (M, n). head, tail: (2 or 3, n) the first and the last control points, which
                stay fixed.
        """
        b = self.matrix(u)
        inner = slice(len(head), self.controls - len(tail))
        rest = values - b[:, : len(head)] @ head - b[:, self.controls - len(tail) :] @ tail
        # Weak regularisation towards a straight control polygon: samples may leave a control point undetermined.
        second = np.diff(np.eye(self.controls), 2, axis=0)
        fixed = second[:, : len(head)] @ head + second[:, self.controls - len(tail) :] @ tail
        weight = 1e-4
        system = np.vstack([b[:, inner], weight * second[:, inner]])
        free = np.linalg.lstsq(system, np.vstack([rest, -weight * fixed]), rcond=None)[0]
        return np.vstack([head, free, tail])


@cache
def _functions(basis: Basis, order: int) -> BSpline:
    """All functions of a basis, or their derivatives of `order`, as one spline of values (controls,)."""
    spline = BSpline(basis.knots, np.eye(basis.controls), DEGREE)
    return spline.derivative(order) if order else spline


def greville(knots: np.ndarray) -> np.ndarray:
    """Greville points (N + 2,) of quadratic B-splines on the knots (N + 1,), both ends threefold."""
    padded = np.concatenate([knots[:1], knots, knots[-1:]])
    return (padded[1:] + padded[:-1]) / 2


@dataclass(frozen=True)
class QuadraticBasis:
    """b, a = b'/2 and w = b''/2 at points s as linear maps of the three control values c[first : first + 3]: a squared
    speed, the acceleration, and its change per length."""

    first: np.ndarray  # (M,)
    b: np.ndarray  # (M, 3)
    a: np.ndarray  # (M, 3)
    w: np.ndarray  # (M, 3)


def quadratic_basis(knots: np.ndarray, s: np.ndarray, piece: np.ndarray | None = None) -> QuadraticBasis:
    """The quadratic B-splines at points.

    Args:
        knots: (N + 1,) increasing. s: (M,) points. piece: (M,) the interval to use if a point is a knot (None: the
            one to its right).
    """
    k = np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(knots) - 2) if piece is None else piece
    padded = np.concatenate([knots[:1], knots, knots[-1:]])
    t0, t1, t2, t3 = (padded[k + j] for j in range(4))  # the interval is [t1, t2]
    h, left, right = t2 - t1, t2 - t0, t3 - t1
    x, y = s - t1, t2 - s
    b = np.stack([y * y / (left * h), 1 - y * y / (left * h) - x * x / (right * h), x * x / (right * h)], axis=1)
    a = np.stack([-y / (left * h), y / (left * h) - x / (right * h), x / (right * h)], axis=1)
    w = np.stack([1 / (left * h), -1 / (left * h) - 1 / (right * h), 1 / (right * h)], axis=1)
    return QuadraticBasis(k, b, a, w)
