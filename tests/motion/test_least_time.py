"""Moves in hardly more than the least time of their straight line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.batches.tables import random_moves


def solved(robot: eo.Robot, number: int, **options: Any) -> eo.Result:
    """The answer to a seeded move."""
    move = random_moves(robot, number + 1, 3)[number]
    known = {"self_collision": False, "compile": "never"}
    return eo.optimize(robot, "source-method-2", start=move.start, goal=move.goal, **known, **options)


@pytest.mark.parametrize(("name", "number"), [("ur5e", 0), ("ur5e", 1), ("panda", 0), ("panda", 3)])
@pytest.mark.parametrize("longer", [1.0, 1.0005])
def test_other_joints_save_while_the_slowest_one_is_at_its_limits(name: str, number: int, longer: float) -> None:
    """No spline follows its limits: the answer was the straight line, not converged."""
    robot = eo.load_robot(name)
    fastest = solved(robot, number, mode="retime", objective="time").baseline("toppra")
    near = solved(robot, number, duration=longer * fastest.duration)
    beyond = solved(robot, number, duration=1.01 * fastest.duration)
    assert near.status == "solved" and near.chosen == "reshape"
    assert near.energy.loss < 1.03 * beyond.energy.loss


@pytest.mark.parametrize("mode", ["retime", "reshape"])
def test_a_move_can_last_as_long_as_the_fastest_timing(mode: str) -> None:
    """Its duration is stated in whole nanoseconds; rounded down, the move was refused."""
    robot = eo.load_robot("ur5e")
    fastest = solved(robot, 0, mode="retime", objective="time").baseline("toppra")
    assert solved(robot, 0, mode=mode, duration=fastest.duration).status == "solved"


@pytest.mark.parametrize(("name", "number"), [("ur5e", 1), ("xarm7", 1)])
def test_a_free_duration_costs_no_more_than_the_least_one(name: str, number: int) -> None:
    """Standby makes time costly, so the answer takes the least time. Splines take 1 % longer, for 0.2 to 0.7 % more.

    By default, moves of free duration begin and end with zero acceleration, unless a timing of the line is cheaper.
    """
    robot = eo.load_robot(name)
    fastest = solved(robot, number, mode="retime", objective="time").baseline("toppra")
    free = solved(robot, number, end_acceleration="free")
    least = solved(robot, number, duration=fastest.duration)
    ends = solved(robot, number).trajectory.acceleration[[0, -1]]
    assert free.energy.total <= least.energy.total * 1.0002 and np.abs(ends).max() < 1e-6


@pytest.mark.parametrize("number", [0, 3])
def test_a_front_begins_with_a_reshaped_move(number: int) -> None:
    """Its first point takes the least time. It was the line's timing: 2.6 and 1.5 times the next point's loss."""
    robot = eo.load_robot("panda")
    move = random_moves(robot, number + 1, 3)[number]
    known = {"self_collision": False, "compile": "never"}
    fastest = solved(robot, number, mode="retime", objective="time").baseline("toppra").duration
    front = eo.tradeoff(
        robot, "source-method-2", start=move.start, goal=move.goal, durations=[fastest, 1.08 * fastest], **known
    )
    first, second = front.document()["points"]
    assert first["status"] == "solved" and first["energy_loss"] < 1.2 * second["energy_loss"]


def test_a_largest_duration_near_the_least_one_is_reshaped_too() -> None:
    """No spline is so fast: the slow joint keeps the first path's timing, as with an exact duration."""
    robot = eo.load_robot("panda")
    fastest = solved(robot, 0, mode="retime", objective="time").baseline("toppra").duration
    assert (
        solved(robot, 0, max_duration=1.0005 * fastest).energy.loss < 0.6 * solved(robot, 0, mode="retime").energy.loss
    )
