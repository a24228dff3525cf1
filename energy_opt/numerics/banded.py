"""Banded linear algebra on windows of six neighbouring control points, compiled by Numba.

A symmetric band is kept by columns: entry (c + o, c) at [c, o]. An unknown is control point times n plus joint. A
window begins at control point `first`, which may lie outside [0, free): what is outside is pinned and is left out.

Numba is chosen over calls of LAPACK through SciPy and over a library for quadratic programs: with 56 unknowns a program
takes 0.7 ms, with NumPy and SciPy 4.8 ms; with 294 unknowns 5 to 8 ms, with PIQP 18 to 38 ms.
"""

from __future__ import annotations

import numpy as np

from energy_opt.numerics.jit import jit

LOCAL = 6  # control points of a window


@jit
def factorise(ab):  # type: ignore[no-untyped-def]
    """Write the Cholesky factor of a band (N, w) over it; False where it is not positive definite."""
    size, width = ab.shape
    for j in range(size):
        s = ab[j, 0]
        if not (s > 0.0 and s < 1e300):
            return False
        s = np.sqrt(s)
        ab[j, 0] = s
        m = min(width, size - j)
        for i in range(1, m):
            ab[j, i] /= s
        for i in range(1, m):
            x = ab[j, i]
            if x != 0.0:
                for k in range(i, m):
                    ab[j + i, k - i] -= x * ab[j, k]
    return True


@jit
def solve(ab, x):  # type: ignore[no-untyped-def]
    """Solve with a factor, in place, x (N,)."""
    size, width = ab.shape
    for j in range(size):
        m = min(width, size - j)
        y = x[j] / ab[j, 0]
        x[j] = y
        for i in range(1, m):
            x[j + i] -= ab[j, i] * y
    for j in range(size - 1, -1, -1):
        m = min(width, size - j)
        s = x[j]
        for i in range(1, m):
            s -= ab[j, i] * x[j + i]
        x[j] = s / ab[j, 0]


@jit
def multiply(ab, x, out):  # type: ignore[no-untyped-def]
    """The product of a symmetric band with x (N,)."""
    size, width = ab.shape
    out[:size] = 0.0
    for c in range(size):
        m = min(width, size - c)
        s, y = ab[c, 0] * x[c], x[c]
        for o in range(1, m):
            s += ab[c, o] * x[c + o]
            out[c + o] += ab[c, o] * y
        out[c] += s


@jit
def add_nodes(ab, blocks, local, first, n):  # type: ignore[no-untyped-def]
    """Add the sum over nodes of L' C L to a band.

    Args:
        blocks: C (K, m, m), m >= 3 n, Hessians by position and its first two derivatives; local: (K, 3, 6) values of
            the basis and its derivatives; first: (K,) windows.
    """
    free = len(ab) // n
    half = np.empty((n, 3 * n))
    for k in range(len(blocks)):
        for a in range(LOCAL):
            row = first[k] + a
            if row < 0 or row >= free:
                continue
            x, y, z = local[k, 0, a], local[k, 1, a], local[k, 2, a]
            for i in range(n):
                for j in range(3 * n):
                    half[i, j] = x * blocks[k, i, j] + y * blocks[k, n + i, j] + z * blocks[k, 2 * n + i, j]
            for b in range(a + 1):
                column = first[k] + b
                if column < 0:
                    continue
                x2, y2, z2 = local[k, 0, b], local[k, 1, b], local[k, 2, b]
                for j in range(n):
                    c = column * n + j
                    for i in range(n):
                        o = row * n + i - c
                        if o >= 0:
                            ab[c, o] += x2 * half[i, j] + y2 * half[i, n + j] + z2 * half[i, 2 * n + j]


@jit
def add_places(ab, blocks, basis, first, n):  # type: ignore[no-untyped-def]
    """Add the sum over places of (B B') kron M to a band; `blocks` M (K, n, n) symmetric, `basis` B (K, 6)."""
    free = len(ab) // n
    for k in range(len(blocks)):
        for a in range(LOCAL):
            row = first[k] + a
            if row < 0 or row >= free:
                continue
            for b in range(a + 1):
                column = first[k] + b
                w = basis[k, a] * basis[k, b]
                if column < 0 or w == 0.0:
                    continue
                for j in range(n):
                    c = column * n + j
                    for i in range(n):
                        o = row * n + i - c
                        if o >= 0:
                            ab[c, o] += w * blocks[k, i, j]


@jit
def _to_places(d, basis, first, n, out):  # type: ignore[no-untyped-def]
    """Steps (K, n) at places from those of control points."""
    free = len(d) // n
    out[:] = 0.0
    for k in range(len(basis)):
        for a in range(LOCAL):
            c = first[k] + a
            if 0 <= c < free:
                for j in range(n):
                    out[k, j] += basis[k, a] * d[c * n + j]


@jit
def _from_places(v, basis, first, n, out):  # type: ignore[no-untyped-def]
    """Add what acts at places (K, n) to control points."""
    free = len(out) // n
    for k in range(len(basis)):
        for a in range(LOCAL):
            c = first[k] + a
            if 0 <= c < free:
                for j in range(n):
                    out[c * n + j] += basis[k, a] * v[k, j]


@jit
def times(d, size, a, out):  # type: ignore[no-untyped-def]
    """A d (R,) of constraints `a` = (n, first, joint, coefficient, wide first, wide, place, gradient, place first,
    basis, border), d (N + k,)."""
    n, first, joint, coefficient, wide_first, wide, place, gradient, place_first, basis, border = a
    free, one, two = size // n, len(first), len(first) + len(wide_first)
    for r in range(one):
        s = 0.0
        for i in range(LOCAL):
            c = first[r] + i
            if 0 <= c < free:
                s += coefficient[r, i] * d[c * n + joint[r]]
        out[r] = s
    for r in range(len(wide_first)):
        s, begin = 0.0, wide_first[r] * n
        for i in range(max(0, -begin), min(LOCAL * n, size - begin)):
            s += wide[r, i] * d[begin + i]
        out[one + r] = s
    if len(place):
        at = np.empty((len(basis), n))
        _to_places(d[:size], basis, place_first, n, at)
        for r in range(len(place)):
            s = 0.0
            for j in range(n):
                s += gradient[r, j] * at[place[r], j]
            out[two + r] = s
    for r in range(len(border)):
        for k in range(border.shape[1]):
            out[r] += border[r, k] * d[size + k]


@jit
def back(y, size, a, out):  # type: ignore[no-untyped-def]
    """Add A' y to `out` (N + k,)."""
    n, first, joint, coefficient, wide_first, wide, place, gradient, place_first, basis, border = a
    free, one, two = size // n, len(first), len(first) + len(wide_first)
    for r in range(one):
        for i in range(LOCAL):
            c = first[r] + i
            if 0 <= c < free:
                out[c * n + joint[r]] += coefficient[r, i] * y[r]
    for r in range(len(wide_first)):
        begin, x = wide_first[r] * n, y[one + r]
        for i in range(max(0, -begin), min(LOCAL * n, size - begin)):
            out[begin + i] += wide[r, i] * x
    if len(place):
        at = np.zeros((len(basis), n))
        for r in range(len(place)):
            for j in range(n):
                at[place[r], j] += gradient[r, j] * y[two + r]
        _from_places(at, basis, place_first, n, out[:size])
    for r in range(len(border)):
        for k in range(border.shape[1]):
            out[size + k] += border[r, k] * y[r]


@jit
def add_square(weight, a, ab, edge, corner):  # type: ignore[no-untyped-def]
    """Add A' diag(weight) A to a matrix of band, border (N, k) and corner (k, k)."""
    n, first, joint, coefficient, wide_first, wide, place, gradient, place_first, basis, border = a
    size = len(ab)
    free, one, two = size // n, len(first), len(first) + len(wide_first)
    for r in range(one):
        for i in range(LOCAL):
            row = first[r] + i
            x = weight[r] * coefficient[r, i]
            if row < 0 or row >= free or x == 0.0:
                continue
            for j in range(i + 1):
                column = first[r] + j
                if column >= 0:
                    ab[column * n + joint[r], (row - column) * n] += x * coefficient[r, j]
    for r in range(len(wide_first)):
        begin = wide_first[r] * n
        low, high = max(0, -begin), min(LOCAL * n, size - begin)
        for j in range(low, high):
            x = weight[one + r] * wide[r, j]
            if x != 0.0:
                for i in range(j, high):
                    ab[begin + j, i - j] += x * wide[r, i]
    if len(place):
        blocks = np.zeros((len(basis), n, n))
        for r in range(len(place)):
            for i in range(n):
                x = weight[two + r] * gradient[r, i]
                if x != 0.0:
                    for j in range(n):
                        blocks[place[r], i, j] += x * gradient[r, j]
        add_places(ab, blocks, basis, place_first, n)
    count = border.shape[1]
    if count:
        whole = np.empty(size + count)
        y = np.empty(len(weight))
        for k in range(count):
            for r in range(len(weight)):
                y[r] = weight[r] * border[r, k]
            whole[:] = 0.0
            back(y, size, a, whole)
            for i in range(size):
                edge[i, k] += whole[i]
            for j in range(count):
                corner[k, j] += whole[size + j]
