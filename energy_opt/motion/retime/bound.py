"""Proof that a retiming is the best: convexity read off the law's numbers, and a lower bound by weak duality.

With the power in its nine monomials (retime_terms), a point's share of the energy is, up to terms linear in (a, b),

    [k3 a^2 + k4 a b + k5 b^2 + k1 a + k2 b + k0 - price] / sqrt(b)

where `price` is what a second of the duration is credited with. Completing the square in a leaves
R(b) = r0 + r1 b + r2 b^2, and since (square of an affine function) / sqrt(b) is convex, the share is convex on
0 < b <= B if and only if 3 (r0 - price) - r1 b + 3 r2 b^2 >= 0 there
(4 b^(5/2) times the second derivative of (R - price) / sqrt(b)).
"""

from __future__ import annotations

import numpy as np

from energy_opt.motion.retime.nlp import RetimeProgram


def largest_price(k: np.ndarray, upper: np.ndarray) -> float:
    """The largest price [W] with which every point's share is convex on 0 < b <= upper; -inf where none is.

    Args:
        k: (9, M) coefficients of the power's monomials.
        upper: (M,) bounds of b, in the unit of the coefficients.
    """
    k0, k1, k2, k3, k4, k5 = k[:6]
    size = np.abs(k[:6]).max()
    flat = k3 <= 1e-12 * size
    if (np.abs(np.stack([k1, k4]))[:, flat] > 1e-9 * size).any():
        return -np.inf
    safe = np.where(flat, 1.0, k3)
    r0 = k0 - np.where(flat, 0, k1**2 / (4 * safe))
    r1 = k2 - np.where(flat, 0, k1 * k4 / (2 * safe))
    r2 = k5 - np.where(flat, 0, k4**2 / (4 * safe))
    # least value of r2 b^2 - r1 b / 3 on [0, upper]: at the vertex where it is inside, else at an end
    vertex = np.clip(np.divide(r1, 6 * r2, out=np.zeros_like(r1), where=np.abs(r2) > 1e-300), 0, upper)
    at = np.stack([np.zeros_like(upper), vertex, upper])
    return float((r0 + (r2 * at**2 - r1 * at / 3).min(axis=0)).min())


def lower_bound(program: RetimeProgram, x: np.ndarray, multipliers: np.ndarray, allowed: np.ndarray) -> float:
    """A number that the cost of no feasible timing on the grid is below, for a convex cost and linear constraints.

    The Lagrangian at the multipliers found (of the right signs) is convex, hence nowhere below its tangent at x; the
    tangent's least value over 0 <= control <= allowed is taken. Nothing is assumed of x and the multipliers but their
    signs: wrong ones give a lower, still valid bound.

    Args:
        x: (N,) free control values.
        multipliers: of T / T_ref and of the constraints.
        allowed: (N,) what the true velocity limits would allow in place of the program's bounds.
    """
    here = program.at(x)
    of_time, of_rows = max(float(multipliers[0]), 0.0), multipliers[1:]
    value = here.cost + of_time * (here.time - 1)
    slope = here.slope + of_time * here.time_slope
    linear = program.rows_held.linear
    if linear is not None:
        value += float(of_rows @ here.rows - np.abs(of_rows) @ linear.allowed)
        slope = slope + linear.adjoint(of_rows)
    return value + float(np.minimum(-slope * x, slope * (allowed - x)).sum())
