"""How near a retimed answer is to the least energy of its path, whichever timing it is."""

import numpy as np
import pytest

from energy_opt.effects import MotionPower
from energy_opt.motion import Move, Planner, Settings
from energy_opt.power import source_method_1
from energy_opt.robot import load_robot

START = np.array([-1.0, -1.5, 1.3, -1.2, -1.5, 0.0])
GOAL = np.array([-0.2, -1.2, 1.2, -1.2, -1.5, -0.5])
UR5 = load_robot("ur5")
SETTINGS = Settings(compile="never")


@pytest.mark.parametrize("duration", [None, 1.5])
def test_a_plain_timing_that_is_the_optimum_is_proven_global(duration: float | None) -> None:
    """Without losses the fastest or evenly slowed timing is the answer; it had no bound."""
    model = source_method_1(UR5)
    result = Planner(UR5, model, SETTINGS).solve(Move(START, GOAL, mode="retime", duration=duration))
    assert result.chosen in ("toppra", "scaled") and result.optimality.kind == "global"
    assert 0 <= result.optimality.gap_percent < 0.01
    assert result.optimality.lower_bound <= result.energy.total


def test_a_model_that_is_not_convex_proves_nothing() -> None:
    model = source_method_1(UR5) + MotionPower(power=10.0)
    result = Planner(UR5, model, SETTINGS).solve(Move(START, GOAL, mode="retime"))
    assert result.optimality.kind == "local" and result.optimality.lower_bound is None
