"""Moves that were hard, and a sample of the thousand drawn ones on each arm, judged by the second evaluator.

`benchmarks/problem_suite.py` draws and judges them; all of them take hours.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import problem_suite as suite
import pytest
from feasibility import holds, line_has_timing, some_path
from independent import Arm
from machine import allowed

KEPT = tomllib.loads((Path(__file__).parents[1] / "hard_moves.toml").read_text(encoding="utf-8"))["move"]
SAMPLE = [(arm, 1000 + k) for arm in suite.ARMS for k in range(4)]  # none of the benchmark's own
LONGEST = 25.0  # [s] of processor time, of the reference machine


@pytest.mark.slow
@pytest.mark.parametrize("move", KEPT, ids=lambda move: f"{move['arm']} {move['reason'][:30]}")
def test_moves_that_were_hard(move: dict[str, object]) -> None:
    row = suite.judged_answer(str(move["arm"]), {"slowness": None, **move})
    assert not suite.faults(row), suite.described(row | {"number": 0})
    assert row["status"] == ("infeasible" if "cannot be done" in str(move["reason"]) else "solved")
    assert row["seconds"] < allowed(2.0 if move["kind"] == "tiny" else LONGEST)


@pytest.mark.slow
def test_a_sample_of_the_problem_suite() -> None:
    rows = [suite.solve(*case) for case in SAMPLE]
    assert not any(suite.faults(row) for row in rows), suite.table(rows)
    assert sum(row["status"] == "solved" for row in rows) > 0.8 * len(rows)


def test_the_second_evaluator_knows_feasible_moves() -> None:
    """A pendulum: what it can hold, lift straight through, swing through, and not."""
    text = (
        '<robot name="r"><link name="a"/><link name="b"><inertial><origin xyz="1 0 0"/><mass value="1"/>'
        '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint></robot>'
    )
    arm, level = Arm(text, ["j"]), 9.81
    hanging, up, before = np.array([np.pi / 2]), np.array([-np.pi / 2]), np.array([-0.9 * np.pi])
    for share, held, timed in ((1.01, True, True), (0.99, False, True), (0.3, False, False)):
        bounds = {"lower": np.array([-4.0]), "upper": np.array([4.0]), "velocity": np.array([20.0])}
        bounds |= {"acceleration": np.array([np.inf]), "effort": np.array([share * level])}
        assert holds(arm, bounds, np.array([[0.0]]))[0] == held
        assert line_has_timing(arm, bounds, hanging, up) == timed  # a share of 0.99 swings through
        assert some_path(arm, bounds, hanging, up, 0) == held
        assert holds(arm, bounds, np.array([hanging, up])).all()
    assert not holds(arm, bounds, before[None])[0]
