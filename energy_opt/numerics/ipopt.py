"""IPOPT on functions written in NumPy: exact sparse derivatives, no expression graph, set up in a millisecond."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import casadi as ca
import numpy as np

from energy_opt.numerics.interrupts import interrupted_at_end

OPTIONS: dict[str, object] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "print_time": False,
    "ipopt.nlp_scaling_method": "none",  # programs are already scaled, also for the linear solver
    "ipopt.mumps_scaling": 0,
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.min_refinement_steps": 0,
    "no_nlp_grad": True,
    "calc_lam_p": False,
    "error_on_fail": False,
}
# If steps cannot be computed, the linear solver's own scaling may help.
STUCK = ("Restoration_Failed", "Error_In_Step_Computation")
CAREFUL: dict[str, object] = {"mumps_scaling": 77, "mumps_permuting_scaling": 7, "min_refinement_steps": 1}


class Problem(Protocol):
    """A nonlinear program: min f(x) subject to bounds on x (N,) and on g(x) (R,).

    `jacobian` gives the nonzeros of dg/dx, `hessian` those of the Hessian of factor f + multipliers . g, in the order
    of the patterns (column by column).

    Attributes:
        jacobian_pattern: of dg/dx. hessian_pattern: upper triangle of the Hessian of the Lagrangian. Both are fixed.
    """

    jacobian_pattern: ca.Sparsity
    hessian_pattern: ca.Sparsity

    def cost(self, x: np.ndarray) -> float: ...
    def gradient(self, x: np.ndarray) -> np.ndarray: ...
    def constraints(self, x: np.ndarray) -> np.ndarray: ...
    def jacobian(self, x: np.ndarray) -> np.ndarray: ...
    def hessian(self, x: np.ndarray, factor: float, multipliers: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True)
class Answer:
    """The point where IPOPT stopped.

    Attributes:
        x: (N,) the point, within its bounds. row_multipliers: (R,) of g.
        success: whether IPOPT converged. status: IPOPT's status. iterations: their number.
    """

    x: np.ndarray
    row_multipliers: np.ndarray
    success: bool
    status: str
    iterations: int


class _Callback(ca.Callback):
    """A CasADi function that is computed in Python.

    Args:
        raised: once it is not empty, nothing is evaluated any more, which ends IPOPT.
        name: of the function. inputs, outputs: names with sparsity patterns.
        evaluate: from arrays of the inputs' nonzeros to arrays of the outputs' nonzeros.
    """

    def __init__(
        self,
        raised: Sequence[BaseException],
        name: str,
        inputs: dict[str, ca.Sparsity],
        outputs: dict[str, ca.Sparsity],
        evaluate: Callable[..., Sequence[float | np.ndarray]],
    ) -> None:
        ca.Callback.__init__(self)
        self._in, self._out = list(inputs.items()), list(outputs.items())
        self._evaluate, self._raised = evaluate, raised
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._in)

    def get_n_out(self) -> int:
        return len(self._out)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self._in[i][1]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._out[i][1]

    def get_name_in(self, i: int) -> str:
        return self._in[i][0]

    def get_name_out(self, i: int) -> str:
        return self._out[i][0]

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arguments: Sequence[memoryview | None], results: Sequence[memoryview | None]) -> int:
        """Evaluate directly from and into IPOPT's memory, without CasADi matrices; 1 if that failed."""
        if self._raised:
            return 1
        values = self._evaluate(*(np.zeros(0) if x is None else np.frombuffer(x).copy() for x in arguments))
        for result, value in zip(results, values, strict=True):
            if result is not None:
                np.frombuffer(result)[:] = value
        return 0


def _array(x: ca.DM) -> np.ndarray:
    """The entries of a column."""
    return np.asarray(x.full()).ravel()


def solve(
    problem: Problem,
    x0: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    row_bounds: tuple[np.ndarray, np.ndarray],
    options: dict[str, object],
) -> Answer:
    """Minimise with IPOPT.

    If IPOPT cannot compute a step, it is started once more with the linear solver's own scaling.

    Args:
        problem: functions and derivatives. x0: (N,) start. bounds: of x, (N,) each. row_bounds: of g, (R,) each.
            options: of IPOPT, without the prefix "ipopt.".

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; or what else its handler raises.
    """
    x_shape, none = ca.Sparsity.dense(len(x0), 1), ca.Sparsity(0, 0)
    one, g_shape = ca.Sparsity.dense(1, 1), ca.Sparsity.dense(len(row_bounds[0]), 1)
    jac, hess = problem.jacobian_pattern, problem.hessian_pattern
    xp = {"x": x_shape, "p": none}
    with interrupted_at_end(only=True) as raised:
        function = partial(_Callback, raised)
        nlp = function("nlp", xp, {"f": one, "g": g_shape}, lambda x, p: [problem.cost(x), problem.constraints(x)])
        grad_f = function(
            "nlp_grad_f",
            xp,
            {"f": one, "grad_f_x": x_shape},
            lambda x, p: [problem.cost(x), problem.gradient(x)],
        )
        jac_g = function(
            "nlp_jac_g",
            xp,
            {"g": g_shape, "jac_g_x": jac},
            lambda x, p: [problem.constraints(x), problem.jacobian(x)],
        )
        hess_lag = function(
            "nlp_hess_l",
            {**xp, "lam_f": one, "lam_g": g_shape},
            {"triu_hess_gamma_x_x": hess},
            lambda x, p, f, g: [problem.hessian(x, float(f[0]), g)],
        )
        given = {**OPTIONS, **{f"ipopt.{key}": value for key, value in options.items()}}
        solver = ca.nlpsol("ipopt", "ipopt", nlp, {**given, "grad_f": grad_f, "jac_g": jac_g, "hess_lag": hess_lag})
        r = solver(x0=x0, lbx=bounds[0], ubx=bounds[1], lbg=row_bounds[0], ubg=row_bounds[1])
    stats = solver.stats()
    if str(stats["return_status"]) in STUCK and not CAREFUL.keys() <= options.keys():
        return solve(problem, x0, bounds, row_bounds, {**options, **CAREFUL})
    ended = bool(stats["success"]), str(stats["return_status"]), int(stats["iter_count"])
    return Answer(np.clip(_array(r["x"]), *bounds), _array(r["lam_g"]), *ended)
