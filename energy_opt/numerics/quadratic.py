"""Quadratic programs with a banded Hessian, by a primal-dual interior-point method with a banded Cholesky factor.

    min  d'Hd / 2 + g'd + price * sum(e)     so that  low <= d <= high,  floor - e <= A d <= ceiling + e,  e >= 0

H is a band with a border of a few full rows and columns. The constraints A d are elastic: the program always has a
solution, and constraints that are out of reach are broken by as little as pays. With t the distance of a constraint
from its bound and l its multiplier, e is eliminated like t, so that a step needs one factorization of

    H + A' D A,    D = 1 / (t / l + e / (price - l)),

which is banded where each row of A touches one window of neighbours. Predictor and corrector follow S. Mehrotra (On the
implementation of a primal-dual interior point method, SIAM Journal on Optimization 2, 1992).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.numerics import banded
from energy_opt.numerics.interior import LEAST_DAMPING, interior

__all__ = ["LEAST_DAMPING", "Banded", "Constraints", "Minimum", "minimise"]
LOCAL = banded.LOCAL


@dataclass
class Banded:
    """A symmetric matrix: `band` (N, w), with entry (c + o, c) at [c, o]; `border` (N, k) and `corner` (k, k)."""

    band: np.ndarray
    border: np.ndarray
    corner: np.ndarray

    def times(self, d: np.ndarray) -> np.ndarray:
        """The product with d (N + k,)."""
        n = len(self.band)
        out = np.empty(len(d))
        banded.multiply(self.band, d, out)
        if len(d) > n:
            out[:n] += self.border @ d[n:]
            out[n:] = self.border.T @ d[:n] + self.corner @ d[n:]
        return out


@dataclass(frozen=True)
class Constraints:
    """Linear constraints floor <= A d <= ceiling (infinite where there is none) on n joints' control points.

    Windows are of six control points, of which the first may be pinned. The order is that of the fields:

    Attributes:
        first, joint, coefficient: (L,), (L,), (L, 6) constraints on one joint in a window.
        wide_first, wide: (W,), (W, 6 n) on all joints in a window.
        place, gradient: (P,), (P, n) on the position at a place.
        place_first, basis: (K,), (K, 6) windows and basis values of places.
        border: (R, k) coefficients of the unknowns behind the band, R = L + W + P.
        keys: (R,) names that are the same for the same constraint at another curve.
    """

    first: np.ndarray
    joint: np.ndarray
    coefficient: np.ndarray
    wide_first: np.ndarray
    wide: np.ndarray
    place: np.ndarray
    gradient: np.ndarray
    place_first: np.ndarray
    basis: np.ndarray
    border: np.ndarray
    floor: np.ndarray
    ceiling: np.ndarray
    keys: np.ndarray

    @classmethod
    def of(cls, joints: int, borders: int, **given: np.ndarray) -> Constraints:
        """Those given; what is not given is empty."""
        none, index = np.zeros(0), np.zeros(0, dtype=np.int64)
        usual = {
            "first": index, "joint": index, "coefficient": np.zeros((0, LOCAL)), "wide_first": index,
            "wide": np.zeros((0, LOCAL * joints)), "place": index, "gradient": np.zeros((0, joints)),
            "place_first": index, "basis": np.zeros((0, LOCAL)), "border": np.zeros((0, borders)),
            "floor": none, "ceiling": none, "keys": index,
        }  # fmt: skip
        return cls(**{name: np.ascontiguousarray(given.get(name, x), dtype=x.dtype) for name, x in usual.items()})

    @property
    def count(self) -> int:
        """Number of constraints."""
        return len(self.floor)

    @property
    def matrix(self) -> tuple[object, ...]:
        """A as the compiled functions take it."""
        return (
            self.gradient.shape[1], self.first, self.joint, self.coefficient, self.wide_first, self.wide, self.place,
            self.gradient, self.place_first, self.basis, self.border,
        )  # fmt: skip

    def times(self, d: np.ndarray) -> np.ndarray:
        """A d (R,) for d (N + k,)."""
        out = np.empty(self.count)
        banded.times(d, len(d) - self.border.shape[1], self.matrix, out)
        return out

    def joined(self, other: Constraints) -> Constraints:
        """These constraints and others."""
        one, two = self.__dict__, other.__dict__
        out = {name: np.concatenate([one[name], two[name]]) for name in one if name not in BY_KIND}
        out["place"] = np.concatenate([self.place, other.place + len(self.basis)])
        parts = [np.split(np.arange(c.count), [len(c.first), len(c.first) + len(c.wide)]) for c in (self, other)]
        order = np.concatenate([x for a, b in zip(*parts, strict=True) for x in (a, b + self.count)])
        return Constraints(**out, **{name: np.concatenate([one[name], two[name]])[order] for name in BY_KIND})

    def moved(self, d: np.ndarray) -> Constraints:
        """The constraints as seen from a point from which these are d away."""
        gone = self.times(d)
        return Constraints(**{**self.__dict__, "floor": self.floor + gone, "ceiling": self.ceiling + gone})


BY_KIND = ("border", "floor", "ceiling", "keys")  # one for each constraint, of all kinds


@dataclass(frozen=True)
class Minimum:
    """The step d, multipliers (R,) (positive at the ceiling), sum of e, damping used, steps taken."""

    d: np.ndarray
    multipliers: np.ndarray
    broken: float
    damping: float
    steps: int


def minimise(
    h: Banded, g: np.ndarray, box: tuple[np.ndarray, np.ndarray], held: Constraints, price: float, mass: Banded,
    damping: float = 0.0, tolerance: float = 1e-6,
) -> Minimum:  # fmt: skip
    """Solve the program; where H is not convex enough, as much `mass` as is needed is added to it.

    Args:
        box: low, high with low <= 0 <= high.
        mass: positive definite, without a border.
        damping: the share of mass to begin with.
        tolerance: the last barrier parameter.

    Raises:
        np.linalg.LinAlgError: no damping makes the program convex.
    """
    low, high = (np.flatnonzero(np.isfinite(bound)) for bound in (held.floor, held.ceiling))
    d, multipliers, broken, damping, steps, good = interior(
        h.band, h.border, h.corner, mass.band, mass.corner, g, *box, held.matrix, low, high, held.floor, held.ceiling,
        float(price), float(damping), float(tolerance),
    )  # fmt: skip
    if not good:
        raise np.linalg.LinAlgError("not positive definite")
    return Minimum(d, multipliers, broken, damping, steps)
