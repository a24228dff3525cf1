"""A condition that the answer keeps anyway does not change its energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.batches.tables import random_moves

WIDE = 10.0  # [m/s] a bound of the tool's speed that no move reaches


@pytest.fixture(scope="module")
def ur5e() -> eo.Robot:
    return eo.load_robot("ur5e")


def solved(robot: eo.Robot, number: int, seed: int = 3, **conditions: Any) -> eo.Result:
    """The answer to a seeded move of free duration; without conditions it begins and ends with acceleration."""
    move = random_moves(robot, number + 1, seed)[number]
    ends = {"start": move.start, "goal": move.goal}
    found = eo.optimize(robot, "source-method-2", **ends, **conditions, self_collision=False, compile="never")
    assert found.status == "solved"
    return found


@pytest.mark.parametrize("number", [0, 4])
def test_a_longest_duration_that_does_not_bind_costs_nothing(ur5e: eo.Robot, number: int) -> None:
    """Free accelerations at the ends were not tried where more time than needed was allowed."""
    free = solved(ur5e, number)
    assert np.abs(free.trajectory.acceleration[[0, -1]]).max() > 1
    assert solved(ur5e, number, max_duration=10.0).energy.loss <= 1.01 * free.energy.loss


def test_a_tool_speed_that_the_answer_keeps_costs_nothing(ur5e: eo.Robot) -> None:
    """It slows the straight line, by whose energy the search decides whether to try free accelerations at the ends."""
    free = solved(ur5e, 4, tool_speed=WIDE)
    used = WIDE * (1 + free.certificate.max_violation["tool_speed"])
    held = solved(ur5e, 4, tool_speed=1.01 * used)
    assert held.energy.loss <= 1.01 * free.energy.loss


def test_a_via_point_on_the_answer_costs_nothing(ur5e: eo.Robot) -> None:
    """The curve through it is slower than the straight line."""
    free = solved(ur5e, 0, seed=41)
    via = free.trajectory.sample(np.array([0.45 * free.trajectory.duration]))[0][0]
    assert solved(ur5e, 0, seed=41, via=[via.tolist()]).energy.loss <= 1.01 * free.energy.loss
