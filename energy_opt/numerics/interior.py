"""The interior-point loop of `quadratic`, compiled by Numba."""

from __future__ import annotations

import numpy as np

from energy_opt.numerics.banded import add_square, back, factorise, multiply, solve, times
from energy_opt.numerics.jit import jit

BARRIER = 1e-3  # the first barrier parameter, where the cost is of order one
BEGIN_BOX, BEGIN_ROW = 1e-3, 1e-2  # least first distances from bounds
CLOSE = 0.995  # of the way to the nearest bound is gone
STEPS = 40
PRIMAL, DUAL = 1e-5, 1e-4  # residuals at which it ends
LEAST_DAMPING = 0.0005
MOST_DAMPING = 1e9


@jit
def _signed(moved, size, low, high, out):  # type: ignore[no-untyped-def]
    """Distances that grow with (d, -d, A d at floors, -A d at ceilings); `moved` is (d, A d)."""
    for i in range(size):
        out[i] = moved[i]
        out[size + i] = -moved[i]
    begin = 2 * size
    for i in range(len(low)):
        out[begin + i] = moved[size + low[i]]
    begin += len(low)
    for i in range(len(high)):
        out[begin + i] = -moved[size + high[i]]


@jit
def _gathered(y, size, low, high, a, inner, by_row, out):  # type: ignore[no-untyped-def]
    """The transpose of `_signed` after (d, A d)."""
    for i in range(size):
        out[i] = y[i] - y[size + i]
    by_row[:] = 0.0
    begin = 2 * size
    for i in range(len(low)):
        by_row[low[i]] = y[begin + i]
    begin += len(low)
    for i in range(len(high)):
        by_row[high[i]] -= y[begin + i]
    back(by_row, inner, a, out)


@jit
def _product(ab, edge, corner, d, out):  # type: ignore[no-untyped-def]
    """A bordered band times d."""
    inner, count = edge.shape
    multiply(ab, d, out)
    for k in range(count):
        s = 0.0
        for i in range(inner):
            out[i] += edge[i, k] * d[inner + k]
            s += edge[i, k] * d[i]
        for j in range(count):
            s += corner[k, j] * d[inner + j]
        out[inner + k] = s


@jit
def _step(s, weight, slope, t, lam, e, room, to_t, to_e, begin, dt, dl, de):  # type: ignore[no-untyped-def]
    """What follows from a step of d; the share at which the first of t, lam, e, price - lam becomes zero."""
    most = 1.0
    for i in range(len(t)):
        dl[i] = s[i] - weight[i] * slope[i]
        dt[i] = (to_t[i] - t[i] * dl[i]) / lam[i] - t[i]
        most = max(most, max(-dt[i] / t[i], -dl[i] / lam[i]))
    for i in range(begin, len(t)):
        de[i] = (to_e[i] + e[i] * dl[i]) / room[i] - e[i]
        most = max(most, max(-de[i] / e[i], dl[i] / room[i]))
    return 1.0 / most


@jit
def interior(band, border, corner, mass, mass_corner, g, low_box, high_box, a, low, high, floor, ceiling, price, damping, tolerance):  # type: ignore[no-untyped-def]  # fmt: skip # noqa: E501
    """The step d (N + k,), multipliers (R,), sum of e, damping, steps, and whether a convex matrix was found.

    Args:
        band, border, corner: the Hessian; mass, mass_corner: what it is damped with.
        low, high: constraints with a floor, and with a ceiling.
    """
    inner, size, count = len(band), len(g), len(floor)
    begin = 2 * size
    total = begin + len(low) + len(high)
    b = np.empty(total)
    _signed(np.concatenate((low_box, floor)), size, low, high, b)
    for i in range(size):
        b[size + i] = -high_box[i]
    for i in range(len(high)):
        b[begin + len(low) + i] = -ceiling[high[i]]
    t, lam, e, room = np.empty(total), np.empty(total), np.zeros(total), np.ones(total)
    for i in range(total):
        t[i] = max(-b[i], BEGIN_BOX if i < begin else BEGIN_ROW)
        lam[i] = BARRIER / t[i]
        if i >= begin:
            lam[i] = min(lam[i], price / 2)
            room[i] = price - lam[i]
            e[i] = BARRIER / room[i]
    pairs = 2 * total - begin
    band, border, corner = band.copy(), border.copy(), corner.copy()
    if damping > 0:
        band += damping * mass
        corner += damping * mass_corner
    d, v, change, moved = np.zeros(size), np.zeros(total), np.empty(size), np.empty(size + count)
    by_row, residual, weight, s = np.empty(count), np.empty(size), np.empty(total), np.empty(total)
    slope, dt, dl, de = np.empty(total), np.empty(total), np.empty(total), np.zeros(total)
    to_t, to_e, part = np.zeros(total), np.zeros(total), np.empty(size)
    ab, edge, corner_now = np.empty_like(band), np.empty_like(border), np.empty_like(corner)
    through, last = np.empty_like(border.T.copy()), np.empty(size - inner)
    _gathered(lam, size, low, high, a, inner, by_row, residual)
    residual[:] = g - residual
    primal = 0.0
    for i in range(total):
        primal = max(primal, abs(e[i] - b[i] - t[i]))
    steps = 0
    while steps < STEPS:
        mu, dual = 0.0, 0.0
        for i in range(total):
            mu += t[i] * lam[i]
            if i >= begin:
                mu += e[i] * room[i]
        mu /= pairs
        for i in range(size):
            dual = max(dual, abs(residual[i]))
        if mu < tolerance and dual < DUAL and primal < PRIMAL:
            break
        steps += 1
        by_row[:] = 0.0
        for i in range(total):
            weight[i] = 1.0 / (t[i] / lam[i] + e[i] / room[i])
        for i in range(len(low)):
            by_row[low[i]] += weight[begin + i]
        for i in range(len(high)):
            by_row[high[i]] += weight[begin + len(low) + i]
        while True:
            ab[:], edge[:], corner_now[:] = band, border, corner
            for i in range(inner):
                ab[i, 0] += weight[i] + weight[size + i]
            for i in range(inner, size):
                corner_now[i - inner, i - inner] += weight[i] + weight[size + i]
            add_square(by_row, a, ab, edge, corner_now)
            good = factorise(ab)
            if good and size > inner:
                for k in range(size - inner):
                    through[k] = edge[:, k]
                    solve(ab, through[k])
                for k in range(size - inner):
                    for j in range(size - inner):
                        x = 0.0
                        for i in range(inner):
                            x += edge[i, k] * through[j, i]
                        corner_now[k, j] -= x
                good = factor_small(corner_now)
            if good:
                break
            more = max(LEAST_DAMPING, damping)
            damping += more
            if not damping < MOST_DAMPING:
                return d, by_row, 0.0, damping, steps, False
            band += more * mass
            corner += more * mass_corner
            _product(band, border, corner, d, residual)
            _gathered(lam, size, low, high, a, inner, by_row, part)
            residual += g - part
            by_row[:] = 0.0
            for i in range(len(low)):
                by_row[low[i]] += weight[begin + i]
            for i in range(len(high)):
                by_row[high[i]] += weight[begin + len(low) + i]
        way = 0.0
        for phase in range(2):
            if phase == 0:
                to_t[:], to_e[:] = 0.0, 0.0
            else:
                after = 0.0
                for i in range(total):
                    after += (t[i] + way * dt[i]) * (lam[i] + way * dl[i])
                    if i >= begin:
                        after += (e[i] + way * de[i]) * (room[i] - way * dl[i])
                centre = mu * min(1.0, max((after / pairs / mu) ** 3, 1e-6))
                for i in range(total):
                    to_t[i] = centre - dt[i] * dl[i]
                    to_e[i] = centre + de[i] * dl[i] if i >= begin else 0.0
            for i in range(total):
                s[i] = weight[i] * (b[i] - v[i] + to_t[i] / lam[i] - to_e[i] / room[i])
            _gathered(s, size, low, high, a, inner, by_row, change)
            change -= residual
            if size > inner:
                for k in range(size - inner):
                    x = change[inner + k]
                    for i in range(inner):
                        x -= through[k, i] * change[i]
                    last[k] = x
                solve_small(corner_now, last)
            solve(ab, change[:inner])
            for k in range(size - inner):
                change[inner + k] = last[k]
                for i in range(inner):
                    change[i] -= through[k, i] * last[k]
            moved[:size] = change
            times(change, inner, a, moved[size:])
            _signed(moved, size, low, high, slope)
            way = _step(s, weight, slope, t, lam, e, room, to_t, to_e, begin, dt, dl, de)
        way = min(1.0, CLOSE * way)
        residual *= 1.0 - way
        primal *= 1.0 - way
        d += way * change
        for i in range(total):
            v[i] += way * slope[i]
            t[i] += way * dt[i]
            lam[i] += way * dl[i]
            if i >= begin:
                e[i] += way * de[i]
                room[i] = price - lam[i]
    by_row[:] = 0.0
    for i in range(len(low)):
        by_row[low[i]] -= lam[begin + i]
    for i in range(len(high)):
        by_row[high[i]] += lam[begin + len(low) + i]
    return np.minimum(np.maximum(d, low_box), high_box), by_row, e[begin:].sum(), damping, steps, True


@jit
def factor_small(x):  # type: ignore[no-untyped-def]
    """Write the Cholesky factor (lower) of a small dense matrix over it; False where it is not positive definite."""
    for j in range(len(x)):
        for i in range(j, len(x)):
            s = x[i, j]
            for k in range(j):
                s -= x[i, k] * x[j, k]
            if i == j:
                if not (s > 0.0 and s < 1e300):
                    return False
                x[j, j] = np.sqrt(s)
            else:
                x[i, j] = s / x[j, j]
    return True


@jit
def solve_small(x, y):  # type: ignore[no-untyped-def]
    """Solve with a factor of `factor_small`, in place, y (k,)."""
    for i in range(len(y)):
        for k in range(i):
            y[i] -= x[i, k] * y[k]
        y[i] /= x[i, i]
    for i in range(len(y) - 1, -1, -1):
        for k in range(i + 1, len(y)):
            y[i] -= x[k, i] * y[k]
        y[i] /= x[i, i]
