"""The interior-point loop of `quadratic`, in NumPy and LAPACK, for machines without a C compiler.

`banded.c` does the same, in a twentieth of the time for arrays of usual size.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cho_solve_banded, cholesky_banded
from scipy.sparse import csr_matrix, diags_array, eye_array, vstack

BARRIER = 1e-3  # first barrier parameter, for a cost of order one
BEGIN_BOX, BEGIN_ROW = 1e-2, 1e-1  # least initial distances from bounds of the box and of constraints
# share of a step below which the program seems to have no free point: the excesses e take over all that is missing
STUCK = 0.1
CLOSE = 0.995  # share of the distance to the nearest bound that a step may use
STEPS = 40
PRIMAL, DUAL = 1e-5, 1e-4  # residuals at which the loop ends
# sum of excesses from which a program whose gap is less than their price counts as one that cannot be met: in a search,
# none of 128 such programs could be
HOPELESS = 0.1
LEAST_DAMPING = 0.0005
MOST_DAMPING = 1e9

Parts = tuple[np.ndarray, np.ndarray, np.ndarray]  # band (N, w), border (N, k) and corner (k, k)


class _Factor:
    """A Cholesky factor of a bordered band.

    Raises:
        LinAlgError: the matrix is not positive definite.
    """

    def __init__(self, band: np.ndarray, border: np.ndarray, corner: np.ndarray) -> None:
        if not (np.isfinite(band).all() and (band[:, 0] > 0).all()):
            raise LinAlgError("not positive definite")
        self._band, self._border = cholesky_banded(band.T, lower=True, check_finite=False), border
        self._through = cho_solve_banded((self._band, True), border) if border.size else border
        self._corner = cho_factor(corner - border.T @ self._through, lower=True) if border.size else None

    def solve(self, x: np.ndarray) -> np.ndarray:
        n = len(self._border)
        out = cho_solve_banded((self._band, True), x[:n])
        if self._corner is None:
            return np.asarray(out)
        last = cho_solve(self._corner, x[n:] - self._through.T @ x[:n])
        return np.concatenate([out - self._through @ last, last])


def _add_square(parts: Parts, a: csr_matrix, weight: np.ndarray) -> Parts:
    """The matrix plus A' diag(weight) A."""
    band, border, corner = (part.copy() for part in parts)
    square = (a.T @ (diags_array(weight) @ a)).tocoo()
    row, column, n = square.row, square.col, len(band)
    inner = (row < n) & (column <= row)
    np.add.at(band, (column[inner], row[inner] - column[inner]), square.data[inner])
    edge = (row < n) & (column >= n)
    np.add.at(border, (row[edge], column[edge] - n), square.data[edge])
    both = (row >= n) & (column >= n)
    np.add.at(corner, (row[both] - n, column[both] - n), square.data[both])
    return band, border, corner


def _times(parts: Parts, d: np.ndarray) -> np.ndarray:
    """The product with a bordered band."""
    band, border, corner = parts
    n = len(band)
    out = np.concatenate([band[:, 0] * d[:n] + border @ d[n:], border.T @ d[:n] + corner @ d[n:]])
    for o in range(1, min(band.shape[1], n)):
        out[o:n] += band[:-o, o] * d[: n - o]
        out[: n - o] += band[:-o, o] * d[o:n]
    return out


def add_nodes(band: np.ndarray, blocks: np.ndarray, local: np.ndarray, first: np.ndarray, n: int) -> None:
    """Add the sum over nodes of L' C L to a band.

    Args:
        blocks: C (K, m, m), m >= 3 n, Hessians by position and its first two derivatives; local: (K, 3, 6) values of
            the basis and its derivatives; first: (K,) windows.
    """
    core = blocks[:, : 3 * n, : 3 * n].reshape(len(blocks), 3, n, 3, n)
    full = np.einsum("kda,kdiej,keb->kaibj", local, core, local, optimize=True)
    width = band.shape[1]
    full = full.reshape(len(blocks), width, width)
    row, column = np.tril_indices(width)
    begin = (first * n)[:, None]
    used = (begin + column >= 0) & (begin + row < len(band))
    np.add.at(
        band, ((begin + column)[used], np.broadcast_to(row - column, used.shape)[used]), full[:, row, column][used]
    )


def interior(
    parts: Parts, mass: Parts, g: np.ndarray, box: tuple[np.ndarray, np.ndarray], a: csr_matrix, floor: np.ndarray,
    ceiling: np.ndarray, price: float, damping: float, tolerance: float, trying: bool = False,
) -> tuple[np.ndarray, np.ndarray, float, float, int, float]:  # fmt: skip
    """The step d (N + k,), multipliers (R,), sum of e, damping, steps, and by how much the cost falls.

    Args:
        parts: the Hessian; mass: the matrix for its damping.
        box: bounds of d; a: the matrix of constraints (R, N + k); floor, ceiling: (R,), infinite for none.
        trying: see `quadratic.minimise`.

    Raises:
        LinAlgError: no damping makes the program convex.
    """
    size, begin = len(g), 2 * len(g)
    low, high = np.flatnonzero(np.isfinite(floor)), np.flatnonzero(np.isfinite(ceiling))
    # all constraints as signed d - b >= 0: both sides of the box, then the elastic ones, which have an excess e
    eye = eye_array(size, format="csr")
    signed = vstack([eye, -eye, a[low], -a[high]], format="csr")
    b = np.concatenate([box[0], -box[1], floor[low], -ceiling[high]])
    elastic = np.arange(len(b)) >= begin
    t = np.maximum(-b, np.where(elastic, BEGIN_ROW, BEGIN_BOX))
    lam = np.where(elastic, np.minimum(BARRIER / t, price / 2), BARRIER / t)
    room = np.where(elastic, price - lam, 1.0)
    e = np.where(elastic, BARRIER / room, 0.0)
    pairs = len(b) + int(elastic.sum())
    parts = tuple(x + damping * y for x, y in zip(parts, mass, strict=True))  # type: ignore[assignment]
    d, v = np.zeros(size), np.zeros(len(b))
    residual, primal, steps = g - signed.T @ lam, float(np.abs(e - b - t).max(initial=0.0)), 0
    while steps < STEPS:
        mu = (t @ lam + (e * room)[elastic].sum()) / pairs
        if mu < tolerance and np.abs(residual).max() < DUAL and primal < PRIMAL:
            break
        excess = float(e[begin:].sum())
        if trying and excess > HOPELESS and mu * pairs < price * excess:
            break
        steps += 1
        weight = 1 / (t / lam + e / room)
        while True:  # until the matrix is positive definite
            try:
                factor = _Factor(*_add_square(parts, signed, weight))
                break
            except (LinAlgError, ValueError):
                more = max(LEAST_DAMPING, damping)
                damping += more
                if not damping < MOST_DAMPING:
                    raise LinAlgError("not positive definite") from None
                parts = tuple(x + more * y for x, y in zip(parts, mass, strict=True))  # type: ignore[assignment]
                residual = _times(parts, d) + g - signed.T @ lam
        to_t, to_e, way = np.zeros(len(b)), np.zeros(len(b)), 0.0
        dt, dl, de = to_t, to_t, to_t
        for phase in range(2):  # predictor and corrector
            if phase:
                after = (t + way * dt) @ (lam + way * dl) + ((e + way * de) * (room - way * dl))[elastic].sum()
                centre = mu * min(1.0, max((after / pairs / mu) ** 3, 1e-6))
                to_t, to_e = centre - dt * dl, np.where(elastic, centre + de * dl, 0.0)
            s = weight * (b - v + to_t / lam - to_e / room)
            change = factor.solve(signed.T @ s - residual)
            slope = signed @ change
            dl = s - weight * slope
            dt = (to_t - t * dl) / lam - t
            de = np.where(elastic, (to_e + e * dl) / room - e, 0.0)
            shares = [-dt / t, -dl / lam, (-de / np.where(elastic, e, 1.0))[elastic], (dl / room)[elastic]]
            way = 1 / max(1.0, *(float(share.max(initial=0.0)) for share in shares))
        way = min(1.0, CLOSE * way)
        residual, primal, d, v = residual * (1 - way), primal * (1 - way), d + way * change, v + way * slope
        t, lam, e = t + way * dt, lam + way * dl, e + way * de
        room = np.where(elastic, price - lam, 1.0)
        if way < STUCK and primal > PRIMAL:  # no point is free: the excesses take all that is missing
            e = np.where(elastic, np.maximum(e, b - v + t), e)
            primal = float(np.abs(e - b + v - t).max())
    multipliers = np.zeros(len(floor))
    multipliers[low] -= lam[begin : begin + len(low)]
    multipliers[high] += lam[begin + len(low) :]
    d = np.clip(d, *box)
    saved = float(-(g + _times(parts, d) / 2) @ d)
    return d, multipliers, float(e[begin:].sum()), damping, steps, saved
