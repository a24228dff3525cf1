"""Slow moves under dry friction: a faster move and rest at one end take less energy than creeping all the time."""

from __future__ import annotations

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.motion import Move, Planner
from energy_opt.motion.plan.resting import with_rest
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import load_model
from energy_opt.robot import load_robot

START, GOAL = [0.5, -0.3, 0.4, -0.3, -1.2, 0.5], [1.2, -1.5708, 0.05, -1.5708, -1.2, 0.0]
UR = load_robot("ur5e")


@pytest.fixture(scope="module")
def planner() -> Planner:
    return Planner(UR, load_model("careful", UR))


def held(motion: Trajectory, duration: float, after: bool) -> Trajectory:
    """The motion, and its last or first position for the rest of the duration."""
    wait = np.linspace(0, duration - motion.duration, 50)
    place = motion.position[-1 if after else 0]
    still = np.zeros((len(wait) - 1, motion.position.shape[1]))
    time = [motion.time, motion.duration + wait[1:]] if after else [wait[:-1], wait[-1] + motion.time]
    blocks = ((motion.position, still + place), (motion.velocity, still), (motion.acceleration, still))
    states = [np.concatenate([a, b] if after else [b, a]) for a, b in blocks]
    return Trajectory(motion.joints, np.concatenate(time), *states)


@pytest.mark.parametrize("after", [True, False])
def test_rest_fills_the_duration(planner: Planner, after: bool) -> None:
    motion = planner.solve(Move(START, GOAL, duration=1.5)).trajectory
    whole = with_rest(motion, 4.0, after)
    assert whole is not None and whole.duration == pytest.approx(4.0, abs=1e-12)
    at = np.linspace(0, 4, 997)
    np.testing.assert_allclose(whole(at), held(motion, 4.0, after)(at), atol=1e-6)
    still = whole.velocity[whole.time > 1.5 + 1e-6] if after else whole.velocity[whole.time < 2.5 - 1e-6]
    assert len(still) > 100 and not still.any()
    moving = motion.part(slice(50, None) if not after else slice(-50))
    assert with_rest(moving, 4.0, after) is None


def test_a_slow_move_takes_no_more_than_a_faster_one_and_rest(planner: Planner) -> None:
    """In 20 s it took 24 % more loss than in 3 s with rest after it."""
    faster = planner.solve(Move(START, GOAL, duration=3.0)).trajectory
    for duration in (8.0, 20.0):
        slow = planner.solve(Move(START, GOAL, duration=duration))
        alternative = min(planner.score(held(faster, duration, after)).total for after in (True, False))
        assert slow.status == "solved" and slow.certificate.valid
        assert slow.energy.total <= alternative + 0.01 * slow.energy.loss
        assert slow.duration == pytest.approx(duration, abs=1e-9) and "rests for the other" in slow.message


def test_so_does_a_point_of_a_front_and_a_plan_under_two_models() -> None:
    front = eo.tradeoff("ur5e", "careful", start=START, goal=GOAL, durations=[3.0, 12.0])
    losses = [point["energy_loss"] for point in front["points"]]
    assert losses[1] <= 1.01 * losses[0]
    plan = eo.optimize("ur5e", start=START, goal=GOAL, duration=12.0)
    assert plan.status == "solved" and all(row["saving_joules"] >= 0 for row in plan["models"])
