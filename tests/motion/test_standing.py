"""Dry friction at rest: it holds, so that standing still never costs more than creeping, and answers stand still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from poses import START

from energy_opt.effects import (
    EXACT,
    AsymmetricFriction,
    CoulombFriction,
    GearEfficiency,
    Kinks,
    LoadFriction,
    Payload,
    Smooth,
)
from energy_opt.effects.base import Effect
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.standing import creeping
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel, drive_function, load_model, source_method_2
from energy_opt.robot import Robot, load_robot

LOADS = np.array([-20.0, -3.0, -0.4, 0.0, 0.7, 2.0, 30.0])  # [N m] below, at and above the friction


def heat(model: PowerModel, v: float, kinks: Kinks, holds: bool) -> np.ndarray:
    """Power (7,) [W], the work on the loads left out, of joints under `LOADS`, one at a time at speed v."""
    function, names = drive_function(model, 1, kinks, holds=holds)
    parts = [np.array(function(0, v, 0, load, 0, model.values(1))[2]).ravel() for load in LOADS]
    return np.array([sum(p) - p[names.index("mechanical")] for p in parts])


@pytest.mark.parametrize(
    "friction",
    [CoulombFriction(tau_c=2.0), LoadFriction(mu=0.2), GearEfficiency(eta=0.8)],
    ids=lambda friction: friction.name,
)
def test_no_creeping_is_cheaper_than_standing(friction: Effect) -> None:
    model = source_method_2().replaced(friction)
    for kinks, slack in ((EXACT, 1e-12), (Smooth(), 2e-4)):  # W; a hundredth of what the free ride was worth
        standing = heat(model, 0.0, kinks, holds=True)
        for v in np.outer([-1, 1], [1e-6, 1e-4, 6e-4, 2e-3, 1e-2, 3e-2]).ravel():
            assert (heat(model, v, kinks, holds=True) >= standing - slack).all()
    free = heat(model, -1e-4, EXACT, holds=False) - heat(model, 0.0, EXACT, holds=False)
    assert free.min() < -0.02  # without, friction carries a load for free


def test_friction_holds_at_rest_and_is_the_declared_law_in_motion() -> None:
    model = source_method_2().replaced(CoulombFriction(tau_c=2.0))
    r = 0.0036
    expected = 88.04 + r * np.maximum(np.abs(LOADS) - 2.0, 0) ** 2
    np.testing.assert_allclose(heat(model, 0.0, EXACT, holds=True), expected, rtol=1e-12)
    for friction in (CoulombFriction(tau_c=2.0), AsymmetricFriction(tau_plus=2.0, tau_minus=1.0)):
        other = source_method_2().replaced(friction)
        for v in (-0.3, -1e-6, 1e-6, 0.3):
            assert (heat(other, v, EXACT, holds=True) == heat(other, v, EXACT, holds=False)).all()


def test_torque_for_limits_has_no_help_from_friction_at_rest(panda: Robot) -> None:
    model = source_method_2().replaced(CoulombFriction(tau_c=2.0))
    rest = np.zeros((1, 7))
    held, _, _ = Scorer(panda, model).drive(START[None], rest, rest, np.zeros(1))
    assert held == pytest.approx(Scorer(panda, source_method_2()).drive(START[None], rest, rest, np.zeros(1))[0])


@pytest.fixture(scope="module")
def solved(panda: Robot) -> tuple[Planner, Trajectory]:
    """A move of two joints; the others need not move, and two of them bear loads."""
    model = source_method_2().replaced(CoulombFriction(tau_c=1.0))
    planner = Planner(panda, model, Settings(starts=1, controls=16, compile="never"))
    goal = START + np.array([0.8, 0, 0, 0.3, 0, 0, 0])
    result = planner.solve(Move(START, goal, duration=1.6))
    assert result.status == "solved" and result.chosen == "reshape"
    return planner, result.trajectory


STANDS = [1, 2, 4, 5, 6]


def test_joints_that_need_not_move_stand(solved: tuple[Planner, Trajectory]) -> None:
    """They crept at up to 0.1 rad/s."""
    _, trajectory = solved
    assert not creeping(trajectory).any()
    v = np.abs(trajectory.velocity[:, STANDS]).max(axis=0)
    assert (v < 1e-3).all()


def test_creeping_variants_of_the_answer_cost_more(solved: tuple[Planner, Trajectory]) -> None:
    planner, t = solved
    least, u = planner.score(t).total, (t.time - t.time[0]) / t.duration
    w = 2 * np.pi / t.duration
    bump = np.stack([1 - np.cos(w * t.duration * u), w * np.sin(w * t.duration * u), w * w * np.cos(2 * np.pi * u)])
    for joint in STANDS:
        for size in (-2e-3, -3e-4, 3e-4, 2e-3):  # [rad], up to 8 mrad/s
            q, v, a = t.position.copy(), t.velocity.copy(), t.acceleration.copy()
            for rows, add in zip((q, v, a), size * bump, strict=True):
                rows[:, joint] += add
            assert planner.score(replace(t, position=q, velocity=v, acceleration=a)).total > least - 1e-4


def test_a_loaded_joint_with_little_to_move_does_not_creep() -> None:
    """The shoulder crept by 2 mrad for 3 s against its load: that took 15 J more than the move without the 2 mrad."""
    robot = load_robot("ur10e")
    planner = Planner(robot, load_model("careful", robot).replaced(Payload(mass=10.0, com=[0.0, 0.0, 0.05])))
    start, goal = np.array([0, -0.5, 0.6, -1.6, -1.57, 0]), np.array([2.4, -0.5, 0.6, -1.6, -1.57, 0])
    found = planner.solve(Move(start, goal, duration=3.0))
    beyond = planner.solve(Move(start, goal + [0, 0.002, 0, 0, 0, 0], duration=3.0))
    assert beyond.certificate.valid and beyond.energy.total <= found.energy.total + 0.5
    speed = beyond.trajectory.velocity[:, 1]
    assert (speed == 0).mean() > 0.9 and np.abs(speed).max() > 0
