"""A front over a cycle under several models: all of its energies are those of the first one."""

from __future__ import annotations

import pytest

import energy_opt as eo
from energy_opt.robot import Robot

START, GOAL = [0, -0.785, 0, -2.356, 0, 1.571, 0.785], [0.8, 0.2, 0.3, -1.4, -0.4, 2.0, 0.0]


def test_the_fastest_move_with_a_wait_is_stated_under_the_first_model(panda: Robot) -> None:
    """It was the mean of the models, so a year's saving compared energies under different models."""
    asked = {"start": START, "goal": GOAL, "mode": "retime", "cycle": 3.0, "durations": [2.0], "cycles_per_year": 1000}
    first = eo.source_model(panda)
    loaded = first + eo.effects.Payload(mass=3.0, com=[0.0, 0.0, 0.15])
    found = eo.tradeoff(panda, [first, loaded], **asked).document()
    alone = eo.tradeoff(panda, first, **asked).document()
    over, of_one = found["cycle"]["fastest_then_wait"], alone["cycle"]["fastest_then_wait"]
    assert over["energy_stored"] == pytest.approx(of_one["energy_stored"], abs=1e-6)
    assert over["energy_total"] == pytest.approx(of_one["energy_total"], rel=1e-3)
    saved = over["energy_total"] - found["cycle"]["minimum"]["energy_total"]
    assert found["per_year"]["kwh"] == pytest.approx(1000 * saved / 3.6e6)
