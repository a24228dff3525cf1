"""Free durations where only losses cost: the rounding of clamps must not reward slow motions."""

from __future__ import annotations

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.effects import CoulombFriction, Regeneration, Smooth
from energy_opt.motion import Move, Planner, Settings
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
