"""Durations: free ones where only losses cost, and the shortest one that a refusal names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.effects import CoulombFriction, Regeneration, Smooth
from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Planner, Settings
from energy_opt.power import source_method_2
from energy_opt.robot import load_robot


def test_a_rounded_clamp_is_exact_far_from_its_kink() -> None:
    assert float(Smooth().positive(-50.0, 0.5)) == pytest.approx(0.0, abs=2e-3)
    assert float(Smooth().positive(50.0, 0.5)) == pytest.approx(50.0, abs=2e-3)
    assert 0 < float(Smooth().positive(0.0, 0.5)) <= 0.25


def test_a_free_duration_is_not_too_long() -> None:
    """Its clamps stated 0.25 W too little for each joint: the move took 4.2 s and half as much energy again."""
    robot = load_robot("z1")
    model = eo.source_model(robot).without("standby") + CoulombFriction(tau_c=(0.02 * robot.limits.effort).tolist())
    planner = Planner(robot, model + Regeneration(efficiency=0.0, level="joint"), Settings(compile="never"))
    start, goal = np.array([0.5, 0.4, -1.4, 0.0, 0.3, 0.4]), np.array([-0.6, 1.2, -0.6, -0.5, 0.5, -0.3])
    free = planner.solve(Move(start, goal))
    assert free.energy.total <= min(planner.solve(Move(start, goal, duration=d)).energy.total for d in (2.0, 3.0))


def test_searches_do_not_end_at_kinks_of_power() -> None:
    """Hurried braking keeps the power at zero, where regeneration ends: such searches ended 2 to 3 % too high."""
    robot = load_robot("panda")
    planner = Planner(robot, eo.load_model("careful", robot), Settings(compile="never"))
    start = np.array([-1.729, -0.081, -1.436, -2.41, 1.085, 1.203, 1.082])
    goal = np.array([-0.805, 0.636, -0.202, -1.263, 1.649, 1.206, 0.456])
    free = planner.solve(Move(start, goal))
    for share in (1.001, 1.026):  # in the mean, longer durations cost 0.24 % more for each percent
        longer = planner.solve(Move(start, goal, duration=share * free.trajectory.duration))
        assert longer.energy.total < 1.012 * free.energy.total


WHEEL = """<robot name="wheel"><link name="base"/><link name="wheel">
  <inertial><mass value="1"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" effort="10" velocity="1"/></joint></robot>"""


def test_the_shortest_duration_that_is_named_is_at_most_that_of_the_first_path(tmp_path: Path) -> None:
    (tmp_path / "wheel.urdf").write_text(WHEEL)
    planner = Planner(load_robot(str(tmp_path / "wheel.urdf")), eo.source_model("panda", 1), Settings(compile="never"))
    least = planner.minimum_time(Move([-0.5], [0.6]))
    with pytest.raises(Infeasible, match="the shortest found") as caught:
        planner.solve(Move([-0.5], [0.6], "reshape", 0.99 * least))
    assert caught.value.shortest_duration == pytest.approx(least, rel=1e-4)


def test_a_saving_is_stated_beside_a_timing_that_is_slower_by_rounding(tmp_path: Path) -> None:
    (tmp_path / "wheel.urdf").write_text(WHEEL)
    planner = Planner(load_robot(str(tmp_path / "wheel.urdf")), eo.source_model("panda", 1), Settings(compile="never"))
    move = Move([-0.5], [0.6], "retime")
    timing, result = planner.timing(move), planner.solve(move)
    faster = timing.slowed(timing.duration * (1 - 1e-6)).trajectory(planner.robot.joints)
    scaled = planner.with_trajectory(result, move, faster).baseline("scaled")
    assert scaled is not None and scaled.valid and scaled.trajectory.duration == pytest.approx(timing.duration, 1e-9)


@pytest.mark.slow
def test_a_drive_too_weak_for_its_friction_is_named(tmp_path: Path) -> None:
    """Reshaping said that it found no motion that is better than the first path, or that it kept the best one."""
    (tmp_path / "wheel.urdf").write_text(WHEEL)
    model = eo.source_model("panda", 1) + CoulombFriction(tau_c=[11.0])
    planner = Planner(load_robot(str(tmp_path / "wheel.urdf")), model, Settings(compile="never"))
    for duration in (None, 5.0):
        with pytest.raises(Infeasible, match=r"^turn: .* limit .*10") as caught:
            planner.solve(Move([-0.5], [0.6], duration=duration))
        assert caught.value.limit == "effort" and caught.value.joint == "turn"


def test_a_retiming_without_convexity_works_in_the_shortest_duration() -> None:
    """It did not converge where there is only one timing, so refusals named 5 % more."""
    robot = load_robot("panda")
    planner = Planner(robot, eo.load_model("careful", robot), Settings(compile="never"))
    start, goal = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785]), np.array([1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4])
    least = planner.minimum_time(Move(start, goal))
    assert planner.solve(Move(start, goal, "retime", least)).status == "solved"
    with pytest.raises(Infeasible, match="the shortest duration that works") as caught:
        planner.solve(Move(start, goal, "retime", 0.9 * least))
    assert caught.value.shortest_duration == pytest.approx(least, rel=1e-5)


def test_a_tight_jerk_limit_leaves_the_ends_of_a_free_duration_free() -> None:
    """From zero acceleration the move takes 2.40 s at least, but 1.97 s without that: the line's timing was kept."""
    arm, tight = load_robot("panda"), np.full(7, 10.0)
    arm = replace(arm, limits=arm.limits.replace(acceleration=0.3 * tight, jerk=tight))
    planner = Planner(arm, source_method_2(), Settings(starts=1, compile="never"))
    start = [-1.449, -0.074, -1.177, -1.091, -1.366, 1.742, -1.491]
    goal = [-0.098, 0.818, 0.937, -1.617, 1.464, 1.845, -0.84]
    result = planner.solve(Move(np.array(start), np.array(goal)))
    line = next(b for b in result.baselines if b.name == "toppra")
    assert result.chosen == "reshape" and result.energy.loss < 0.6 * line.energy.loss
