"""The duration that is named as the shortest, where standard moves are asked for."""

from __future__ import annotations

import pytest

import energy_opt as eo

MOVE = {"start": [0, 1, -1, 0, 0, 0], "goal": [0.6, 1.3, -1.2, 0.2, 0.1, 0.1], "mode": "retime"}
QUICK = {"model": "source-method-2", "self_collision": False, "controls": 16, "compile": "never", "standard": "moves"}


def test_the_shortest_duration_that_is_named_works_for_standard_moves() -> None:
    with pytest.raises(eo.Infeasible) as fault:
        eo.optimize("z1", **MOVE, duration=0.2, **QUICK)
    shortest = fault.value.shortest_duration
    assert shortest is not None and f"{shortest:.6g} s" in str(fault.value)
    result = eo.optimize("z1", **MOVE, duration=shortest, **QUICK)
    assert result.status in ("solved", "not_converged") and result.certificate.within_limits
    free = {**QUICK, "standard": None}
    with pytest.raises(eo.Infeasible) as fault:
        eo.optimize("z1", **MOVE, duration=0.2, **free)
    assert fault.value.shortest_duration < 0.99 * shortest
