"""IPOPT on NumPy functions: the second attempt where steps cannot be computed, the one that is no help, and Ctrl-C."""

from __future__ import annotations

import signal
from typing import Any

import casadi as ca
import numpy as np
import pytest

from energy_opt.numerics import ipopt


class Circle:
    """The point of the unit circle with the least x + y."""

    jacobian_pattern = ca.Sparsity.dense(1, 2)
    hessian_pattern = ca.Sparsity.upper(2)

    def cost(self, x: np.ndarray) -> float:
        return float(x.sum())

    def gradient(self, x: np.ndarray) -> np.ndarray:
        return np.ones(2)

    def constraints(self, x: np.ndarray) -> np.ndarray:
        return np.array([x @ x])

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        return 2 * x

    def hessian(self, x: np.ndarray, factor: float, multipliers: np.ndarray) -> np.ndarray:
        return 2 * multipliers[0] * np.array([1.0, 0.0, 1.0])


class Stuck:
    """The true solver, which says of itself that it is stuck where its linear solver does not scale."""

    def __init__(self, solver: ca.Function, says: str | None) -> None:
        self.solver, self.says = solver, says

    def __call__(self, **given: Any) -> dict[str, ca.DM]:
        return dict(self.solver(**given))

    def stats(self) -> dict[str, Any]:
        stats = dict(self.solver.stats())
        return stats if self.says is None else {**stats, "return_status": self.says, "success": False}


def solved(monkeypatch: pytest.MonkeyPatch, statuses: list[str | None]) -> tuple[ipopt.Answer, list[dict[str, Any]]]:
    """The answer and every attempt's options, where attempts end with these statuses (None: the true one)."""
    attempts: list[dict[str, Any]] = []
    make = ca.nlpsol

    def nlpsol(name: str, plugin: str, nlp: Any, options: dict[str, Any]) -> Stuck:
        attempts.append(options)
        return Stuck(make(name, plugin, nlp, options), statuses[len(attempts) - 1])

    monkeypatch.setattr(ipopt.ca, "nlpsol", nlpsol)
    free = np.full(2, np.inf)
    answer = ipopt.solve(Circle(), np.array([-1.0, 0.2]), (-free, free), (np.ones(1), np.ones(1)), {"max_iter": 50})
    return answer, attempts


@pytest.mark.parametrize("status", ipopt.STUCK)
def test_a_stuck_attempt_is_repeated_with_the_linear_solvers_own_scaling(
    monkeypatch: pytest.MonkeyPatch, status: str
) -> None:
    answer, attempts = solved(monkeypatch, [status, None])
    assert [a["ipopt.mumps_scaling"] for a in attempts] == [0, 77]
    assert [a["ipopt.mumps_permuting_scaling"] for a in attempts] == [0, 7]
    assert [a["ipopt.min_refinement_steps"] for a in attempts] == [0, 1]
    assert attempts[1]["ipopt.max_iter"] == 50  # what was asked for still holds
    assert answer.success and answer.x == pytest.approx(np.full(2, -np.sqrt(0.5)), abs=1e-7)


def test_there_is_one_repetition_and_only_where_it_may_help(monkeypatch: pytest.MonkeyPatch) -> None:
    answer, attempts = solved(monkeypatch, [ipopt.STUCK[0]] * 2)
    assert len(attempts) == 2 and not answer.success and answer.status == ipopt.STUCK[0]
    monkeypatch.undo()
    assert len(solved(monkeypatch, ["Infeasible_Problem_Detected"])[1]) == 1


@pytest.mark.parametrize("name", ["cost", "gradient", "constraints", "jacobian", "hessian"])
@pytest.mark.parametrize("heard", [False, True])
def test_ctrl_c_is_not_lost(monkeypatch: pytest.MonkeyPatch, name: str, heard: bool) -> None:
    """It reaches the caller at once; a handler that only takes note of it lets the solve go on."""
    evaluate, calls, notes = getattr(Circle, name), [], []

    def pressed(self: Circle, *values: Any) -> Any:
        calls.append(1)
        if len(calls) == 3:
            signal.raise_signal(signal.SIGINT)
        return evaluate(self, *values)

    monkeypatch.setattr(Circle, name, pressed)
    handler = (lambda *words: notes.append(words)) if heard else signal.default_int_handler
    before = signal.signal(signal.SIGINT, handler)
    try:
        if heard:
            assert solved(monkeypatch, [None])[0].success and len(notes) == 1
        else:
            with pytest.raises(KeyboardInterrupt):
                solved(monkeypatch, [None])
            assert len(calls) == 3
        assert signal.getsignal(signal.SIGINT) is handler
    finally:
        signal.signal(signal.SIGINT, before)
