"""The nonlinear program of a retiming: built once per grid and kind of law, solved for many moves.

    minimise    sum over points of weight / sqrt(b) (energy_factor P(a, b) + time_factor)
    over        b's free control values, within their bounds
    subject to  T / T_ref <= 1 (or = 1), and the limits at the places where a solve broke them

Derivatives are exact and sparse: point functions give value, gradient and Hessian in (a, b), and constant sparse maps
carry them to the control values (the Hessian has two off-diagonals, as three control values meet in every interval).
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from energy_opt.motion.retime_grid import Grid, lift
from energy_opt.motion.retime_rows import Rows
from energy_opt.motion.retime_terms import Terms

TOLERANCE = 1e-7  # of the solver, on a cost of order one


@dataclass(frozen=True)
class Move:
    """The numbers of one move, in the problem's unit of squared speed.

    Attributes:
        at: (terms.size - 1, M) what the point functions are given, without the weights.
        shared: (terms.shared_size,) with the factors of energy and time at the end.
        ends: (2,) first and last control value.
        lower, upper: (N,) bounds of the free control values.
        allowed: (N,) what the true velocity limits would allow in place of `upper`.
        duration: T_ref, in the problem's unit of time.
    """

    at: np.ndarray
    shared: np.ndarray
    ends: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    allowed: np.ndarray
    duration: float


def parameters(move: Move) -> np.ndarray:
    """The program's parameter vector."""
    return np.concatenate([move.at.T.ravel(), move.shared, move.ends, [move.duration]])


@dataclass(frozen=True)
class Answer:
    """Free control values (N,), multipliers of T / T_ref and of the rows, and the solver's verdict."""

    x: np.ndarray
    of_time: float
    of_rows: np.ndarray
    solved: bool
    status: str
    iterations: int
    build_seconds: float
    solve_seconds: float


class Program:
    """The program for one grid and kind of law."""

    def __init__(self, grid: Grid, terms: Terms) -> None:
        self.grid, self.terms = grid, terms
        self.lift = carried = lift(grid.knots, grid.s)
        m = len(grid.s)
        self.x = ca.MX.sym("x", carried.count - 2)
        self.p = ca.MX.sym("p", (terms.size - 1) * m + terms.shared_size + 3)
        split = (terms.size - 1) * m
        at = ca.vertcat(ca.reshape(self.p[:split], terms.size - 1, m), ca.DM(grid.weight).T)
        shared, ends, self.reference = self.p[split:-3], self.p[-3:-1], self.p[-1]
        self.z = ca.reshape(carried.matrix @ self.x + ca.sparsify(ca.DM(carried.ends)) @ ends, 2, m)
        self.points = (self.z, at, shared)
        b = self.z[1, :].T
        down, of_b = carried.matrix.T, carried.matrix[1::2, :].T
        self.cost = terms.cost.map("costs", "serial", m, [2], [0])(*self.points)
        self.cost_slope = down @ ca.vec(terms.slope.map("slopes", "serial", m, [2], [])(*self.points))
        pace = ca.DM(grid.weight) / ca.sqrt(b)
        self.time = ca.sum1(pace)
        self.time_slope = of_b @ (-0.5 * pace / b)
        self._values = ca.Function("values", [self.x, self.p], [self.cost, self.cost_slope, self.time, self.time_slope])
        self._without_rows: dict[bool, ca.Function] = {}

    def evaluate(self, move: Move, x: np.ndarray) -> tuple[float, np.ndarray, float, np.ndarray]:
        """Cost and time at the free control values x (N,), each with its gradient (N,)."""
        cost, slope, duration, time_slope = self._values(x, parameters(move))
        return float(cost), np.array(slope).ravel(), float(duration), np.array(time_slope).ravel()

    def solver(self, rows: Rows, ends: np.ndarray, near: bool = False) -> ca.Function:
        """IPOPT for the program with the limits in `rows`; T / T_ref is the first constraint."""
        if rows.count:
            return self._solver(rows, ends, near)
        if near not in self._without_rows:
            self._without_rows[near] = self._solver(rows, ends, near)
        return self._without_rows[near]

    def _solver(self, rows: Rows, ends: np.ndarray, near: bool) -> ca.Function:
        x, p = self.x, self.p
        of_cost, multiplier = ca.MX.sym("of_cost"), ca.MX.sym("multiplier", 1 + rows.count)
        bend = self.terms.curvature.map("bend", "serial", len(self.grid.s), [2, 3, 4], [])
        pattern, gather = self.lift.curvature
        bent = gather @ ca.vec(bend(*self.points, of_cost, multiplier[0] / self.reference))
        hessian = ca.sparsity_cast(bent, pattern)
        values, slopes = [self.time / self.reference], [self.time_slope.T / self.reference]
        if rows.count:
            value, slope, curved = rows.parts(x, ends, multiplier[1:])
            values.append(value)
            slopes.append(slope)
            hessian = ca.triu(hessian + curved)
        g = ca.vertcat(*values)
        exact = {
            "grad_f": ca.Function("nlp_grad_f", [x, p], [self.cost, self.cost_slope], ["x", "p"], ["f", "grad_f_x"]),
            "jac_g": ca.Function("nlp_jac_g", [x, p], [g, ca.vertcat(*slopes)], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": ca.Function(
                "nlp_hess_l",
                [x, p, of_cost, multiplier],
                [hessian],
                ["x", "p", "lam_f", "lam_g"],
                ["triu_hess_gamma_x_x"],
            ),
        }
        options = {
            **exact,
            "no_nlp_grad": True,
            "calc_lam_p": False,
            "print_time": 0,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.tol": TOLERANCE,
            "ipopt.max_iter": 200,
            "ipopt.nlp_scaling_method": "none",
            "ipopt.mu_init": 1e-4 if near else 1e-2,
            "ipopt.bound_relax_factor": 0.0,
            "ipopt.mumps_scaling": 0,  # the program is scaled already
            "ipopt.mumps_permuting_scaling": 0,
        }
        return ca.nlpsol("retime", "ipopt", {"x": x, "p": p, "f": self.cost, "g": g}, options)

    def solve(self, move: Move, start: np.ndarray, rows: Rows, *, exactly: bool = False, near: bool = False) -> Answer:
        """Solve from `start` (N,); with `exactly`, T = T_ref in place of T <= T_ref.

        `near` says that the start is close to the answer."""
        begun = time.perf_counter()
        solver = self.solver(rows, move.ends, near)
        built = time.perf_counter()
        result = solver(
            x0=np.clip(start, move.lower, move.upper),
            p=parameters(move),
            lbx=move.lower,
            ubx=move.upper,
            lbg=np.concatenate([[1.0 if exactly else -np.inf], -np.ones(rows.count)]),
            ubg=np.ones(1 + rows.count),
        )
        stats = solver.stats()
        multipliers = np.array(result["lam_g"]).ravel()
        return Answer(
            np.array(result["x"]).ravel(),
            float(multipliers[0]),
            multipliers[1:],
            bool(stats["success"]),
            str(stats["return_status"]),
            int(stats["iter_count"]),
            built - begun,
            time.perf_counter() - built,
        )


@lru_cache(maxsize=16)
def _program(knots: bytes, s: bytes, weight: bytes, terms: Terms) -> Program:
    return Program(Grid(*(np.frombuffer(x) for x in (knots, s, weight))), terms)


def program(grid: Grid, terms: Terms) -> Program:
    """The program for `grid` and `terms`, built at the first call and kept."""
    return _program(grid.knots.tobytes(), grid.s.tobytes(), grid.weight.tobytes(), terms)
