"""Quadratic programs with a banded Hessian, by a primal-dual interior-point method with a banded Cholesky factor.

    min  d'Hd / 2 + g'd + price * sum(e)     so that  low <= d <= high,  floor - e <= A d <= ceiling + e,  e >= 0

H is a band with a border of a few full lines and columns. The constraints A d are elastic: the program always has a
solution, and constraints that cannot be met are violated at that price. With t the distance of a constraint
from its bound and l its multiplier, e is eliminated like t, so that a step needs one factorization of

    H + A' D A,    D = 1 / (t / l + e / (price - l)),

which is banded if each constraint touches one window of neighbours. Predictor and corrector follow S. Mehrotra (On the
implementation of a primal-dual interior point method, SIAM Journal on Optimization 2, 1992).
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, fields
from functools import cache, cached_property

import numpy as np
from scipy.sparse import csr_matrix

from energy_opt.numerics import interior, native
from energy_opt.numerics.interior import LEAST_DAMPING
from energy_opt.numerics.native import LOCAL, pointer

__all__ = ["LEAST_DAMPING", "Banded", "Constraints", "Minimum", "add_nodes", "add_places", "minimise"]


def add_nodes(band: np.ndarray, blocks: np.ndarray, local: np.ndarray, first: np.ndarray, n: int) -> None:
    """Add the sum over nodes of L' C L to a band (N, 6 n), in place.

    Args:
        blocks: C (K, m, m), m >= 3 n, Hessians by position and its first two derivatives, of n joints.
        local: (K, 3, 6) values of the basis and its derivatives, from which L follows; first: (K,) windows.
    """
    c = native.library("quadratic")
    if c is None:
        interior.add_nodes(band, blocks, local, first, n)
        return
    blocks, local = np.ascontiguousarray(blocks, np.float64), np.ascontiguousarray(local, np.float64)
    first, sizes = np.ascontiguousarray(first, np.int64), map(ctypes.c_int64, (len(band), *blocks.shape[:2], n))
    size, count, width, joints = sizes
    c.banded_add_nodes(pointer(band), size, pointer(blocks), count, width, pointer(local), pointer(first), joints)


def add_places(band: np.ndarray, blocks: np.ndarray, basis: np.ndarray, first: np.ndarray, n: int) -> None:
    """Add the sum over places of (B B') kron M to a band (N, 6 n), in place.

    Args:
        blocks: M (K, n, n), symmetric, Hessians by the position. basis: B (K, 6) values of it. first: (K,) windows.
    """
    c = native.library("quadratic")
    if c is not None:
        given = [np.ascontiguousarray(x, dtype=np.float64) for x in (blocks, basis)]
        begin, sizes = np.ascontiguousarray(first, dtype=np.int64), map(ctypes.c_int64, (len(band), len(blocks), n))
        size, count, joints = sizes
        c.banded_add_places(pointer(band), size, pointer(given[0]), count, pointer(given[1]), pointer(begin), joints)
        return
    whole, local = np.zeros((len(blocks), 3 * n, 3 * n)), np.zeros((len(blocks), 3, LOCAL))
    whole[:, :n, :n], local[:, 0] = blocks, basis
    add_nodes(band, whole, local, first, n)


@dataclass
class Banded:
    """A symmetric matrix: `band` (N, w), with entry (c + o, c) at [c, o]; `border` (N, k) and `corner` (k, k)."""

    band: np.ndarray
    border: np.ndarray
    corner: np.ndarray


@dataclass(frozen=True)
class Constraints:
    """Linear constraints floor <= A d <= ceiling (infinite for none) on n joints' control points.

    Windows are of six control points, of which the first may be pinned. The order is that of the fields:

    Attributes:
        first, joint, coefficient: (L,), (L,), (L, 6) constraints on one joint in a window.
        wide_first, wide: (W,), (W, 6 n) on all joints in a window.
        place, gradient: (P,), (P, n) on the position at a place.
        place_first, basis: (K,), (K, 6) windows and basis values of places.
        border: (R, k) coefficients of the unknowns behind the band, R = L + W + P.
        keys: (R,) identifiers, the same for the same constraint at another curve.
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
        """The given arrays; all others are empty, for `joints` joints and `borders` unknowns behind the band."""
        usual = _empty(joints, borders)
        if not given:
            return _none(joints, borders)
        return cls(**usual | {name: np.ascontiguousarray(x, dtype=usual[name].dtype) for name, x in given.items()})

    @property
    def count(self) -> int:
        """Number of constraints."""
        return len(self.floor)

    @cached_property
    def matrix(self) -> native.Matrix:
        """A in the layout of the compiled functions; it refers to the memory of these arrays."""
        counts = len(self.first), len(self.wide), len(self.place), len(self.basis), self.border.shape[1]
        n = self.gradient.shape[1]
        memory = np.empty(len(self.basis) * n * n)
        arrays = [getattr(self, name) for name in (*native.INTEGERS, *native.NUMBERS)]
        out = native.Matrix(n, *counts, *map(pointer, arrays), pointer(memory))
        out.memory = memory
        return out

    def entries(self, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows, columns and values (E,) of A's entries, for `size` unknowns in the band; column -1 if pinned."""
        n, k = self.gradient.shape[1], self.border.shape[1]
        at = (self.basis[self.place][:, :, None] * self.gradient[:, None]).reshape(-1, LOCAL * n)
        window = np.concatenate([self.wide_first, self.place_first[self.place]])[:, None] * n + np.arange(LOCAL * n)
        alone = (self.first[:, None] + np.arange(LOCAL)) * n + self.joint[:, None]
        index = np.arange(self.count)
        row = [np.repeat(index[: len(alone)], LOCAL), np.repeat(index[len(alone) :], LOCAL * n), np.repeat(index, k)]
        inner = np.concatenate([alone.ravel(), window.ravel()])
        inner = np.where((inner >= 0) & (inner < size), inner, -1)
        column = np.concatenate([inner, np.tile(size + np.arange(k), self.count)])
        value = [self.coefficient.ravel(), self.wide.ravel(), at.ravel(), self.border.ravel()]
        return np.concatenate(row), column, np.concatenate(value)

    def sparse(self, size: int) -> csr_matrix:
        """A (R, size + k), for `size` unknowns in the band."""
        row, column, value = self.entries(size)
        used = (column >= 0) & (value != 0)
        shape = self.count, size + self.border.shape[1]
        return csr_matrix((value[used], (row[used], column[used])), shape=shape)

    def times(self, d: np.ndarray) -> np.ndarray:
        """A d (R,) for d (N + k,)."""
        size, c = len(d) - self.border.shape[1], native.library("quadratic")
        if c is None:
            return np.asarray(self.sparse(size) @ d)
        out, d = np.empty(self.count), np.ascontiguousarray(d, dtype=np.float64)
        c.banded_times(pointer(d), ctypes.c_int64(size), ctypes.byref(self.matrix), pointer(out))
        return out

    def joined(self, other: Constraints) -> Constraints:
        """These constraints and the others."""
        if not other.count:
            return self
        pairs = ((name, getattr(self, name), getattr(other, name)) for name in ARRAYS)
        both = {name: np.concatenate([x, y]) if len(x) and len(y) else x if len(x) else y for name, x, y in pairs}
        both["place"] = np.concatenate([self.place, other.place + len(self.basis)])
        if not (len(self.place) and len(other.wide)) and not (self.count > len(self.first) and len(other.first)):
            return Constraints(**both)  # the kinds are in their order
        parts = [np.split(np.arange(c.count), [len(c.first), len(c.first) + len(c.wide)]) for c in (self, other)]
        order = np.concatenate([x for a, b in zip(*parts, strict=True) for x in (a, b + self.count)])
        return Constraints(**both | {name: both[name][order] for name in BY_KIND})

    def within(self, floor: np.ndarray, ceiling: np.ndarray) -> Constraints:
        """The same linear functions within other bounds (R,)."""
        out = object.__new__(Constraints)
        out.__dict__.update(self.__dict__, floor=floor, ceiling=ceiling)  # a cached `matrix` does not hold them
        return out

    def moved(self, d: np.ndarray) -> Constraints:
        """The same constraints in coordinates whose origin is moved by -d."""
        moved = self.times(d)
        return self.within(self.floor + moved, self.ceiling + moved)


@cache
def _none(joints: int, borders: int) -> Constraints:
    """No constraints."""
    return Constraints(**_empty(joints, borders))


@cache
def _empty(joints: int, borders: int) -> dict[str, np.ndarray]:
    """The arrays of no constraints."""
    none, index = np.zeros(0), np.zeros(0, dtype=np.int64)
    return {
        "first": index, "joint": index, "coefficient": np.zeros((0, LOCAL)), "wide_first": index,
        "wide": np.zeros((0, LOCAL * joints)), "place": index, "gradient": np.zeros((0, joints)),
        "place_first": index, "basis": np.zeros((0, LOCAL)), "border": np.zeros((0, borders)),
        "floor": none, "ceiling": none, "keys": index,
    }  # fmt: skip


ARRAYS = tuple(field.name for field in fields(Constraints))
BY_KIND = ("border", "floor", "ceiling", "keys")  # arrays with one entry for each constraint of any kind


@dataclass(frozen=True)
class Minimum:
    """The step d, multipliers (R,) (positive at the ceiling), sum of e, damping used, steps taken.

    `saved`: by how much d'Hd / 2 + g'd falls, with the damping in H.
    """

    d: np.ndarray
    multipliers: np.ndarray
    broken: float
    damping: float
    steps: int
    saved: float


def minimise(
    h: Banded, g: np.ndarray, box: tuple[np.ndarray, np.ndarray], held: Constraints, price: float, mass: Banded,
    damping: float = 0.0, tolerance: float = 1e-6, trying: bool = False,
) -> Minimum:  # fmt: skip
    """Solve the program of the module.

    If H is not convex enough, multiples of `mass` are added to it.

    Args:
        h, g: of the cost; g is (N + k,).
        box: lowest and highest d, (N + k,) each, finite.
        held: the constraints A d. price: of a unit of their excess; no multiplier is larger.
        mass: positive definite, the metric of the damping. damping: its multiple to begin with.
        tolerance: barrier parameter at which the method ends.
        trying: end as soon as the constraints clearly cannot be met; of the result only `broken` counts then.

    Raises:
        LinAlgError: no damping makes the program convex, as if numbers overflowed.
    """
    c, size, inner = native.library("quadratic"), len(g), len(h.band)
    if c is None:
        parts, heavy = (h.band, h.border, h.corner), (mass.band, mass.border, mass.corner)
        a, bounds = held.sparse(inner), (held.floor, held.ceiling)
        return Minimum(*interior.interior(parts, heavy, g, box, a, *bounds, price, damping, tolerance, trying))
    given = np.concatenate([g, *box, held.floor, held.ceiling])
    out = np.empty(size + held.count + 4)  # d, multipliers, and four numbers
    out[-3] = damping
    failed = c.banded_interior(
        pointer(h.band), pointer(h.border), pointer(h.corner), pointer(mass.band), pointer(mass.corner),
        ctypes.c_int64(h.band.shape[1]), ctypes.c_int64(size), pointer(given), ctypes.byref(held.matrix),
        ctypes.c_double(price), ctypes.c_double(tolerance), ctypes.c_int64(trying), pointer(out),
    )  # fmt: skip
    if failed:
        raise np.linalg.LinAlgError("not positive definite" if failed == 1 else "no memory")
    broken, damping, steps, saved = out[-4:].tolist()
    return Minimum(out[:size], out[size:-4], broken, damping, int(steps), saved)
