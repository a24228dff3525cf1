"""A front under several models: its energies are those of the first one, and its minima those of the mean."""

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
    saved = over["energy_robust"] - found["cycle"]["minimum"]["energy_robust"]
    assert found["per_year"]["kwh"] == pytest.approx(1000 * saved / 3.6e6)


def test_the_minimum_is_that_of_the_mean(panda: Robot) -> None:
    """It was the least energy under the first model: 29 % more in the mean than what `optimize` finds."""
    first = eo.PowerModel("panda", ()) + eo.effects.Standby(power=3.0) + eo.effects.CopperLoss(r_over_kt2=0.005)
    models = [first, first + eo.effects.ViscousFriction(b=6.0)]
    asked = {"start": START, "goal": GOAL, "mode": "retime"}
    found = eo.tradeoff(panda, models, durations=[1.0, 2.0, 3.0], cycle=6.0, **asked)
    best = eo.optimize(panda, models, robust="mean", **asked)
    least = found["minimum"]
    assert least["energy_robust"] == pytest.approx(best.document()["robust"]["total"], rel=1e-6)
    assert least["energy_robust"] < min(row["energy_robust"] for row in found["points"])
    over = [row["cycle"]["energy_robust"] for row in found["points"]]
    assert found["cycle"]["minimum"]["energy_robust"] <= min(over)
    assert found["robust"] == {"kind": "mean", "total": least["energy_robust"]}
    assert "minimum mean energy over the models" in str(found)


def test_the_largest_energy_over_a_cycle_is_that_of_one_model(panda: Robot) -> None:
    """Move and wait were added up under different models: less than one of the models takes."""
    first = eo.PowerModel("panda", ()) + eo.effects.Standby(power=60.0) + eo.effects.CopperLoss(r_over_kt2=0.005)
    other = first.replaced(eo.effects.Standby(power=5.0)) + eo.effects.ViscousFriction(b=8.0)
    asked = {"start": START, "goal": GOAL, "mode": "retime", "durations": [2.0, 3.0], "cycle": 4.0}
    found = eo.tradeoff(panda, [first, other], robust="worst", **asked)
    alone = [eo.tradeoff(panda, model, **asked) for model in (first, other)]
    for k, row in enumerate(found["points"]):
        assert row["cycle"]["energy_robust"] >= row["cycle"]["energy_total"] - 1e-9
        least = max(one["points"][k]["cycle"]["energy_total"] for one in alone)
        assert row["cycle"]["energy_robust"] >= least * (1 - 1e-6)
    assert "robust" not in eo.tradeoff(panda, [first], robust="mean", **asked).document()
