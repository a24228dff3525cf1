"""A job of several robots under models with effects that depend on time or store energy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from swings import swing

import energy_opt as eo
from energy_opt.jobs.legs import Step
from energy_opt.power.known import careful
from energy_opt.workcell.motion import Scoring

JOB = """
format = "energy-opt/job/2"
cycle_time = 6.0
[supply]
shared = true
capacity = 50.0
[[robot]]
name = "b"
robot = "z1"
[[robot.step]]
name = "there"
to = [0.8, 1.2, -1.2, 0, 0, 0]
[[robot.step]]
wait = 1.0
[[robot.step]]
name = "back"
to = [0, 1, -1, 0, 0, 0]
"""


def test_a_store_of_an_arm_gives_way_to_the_supply_and_steps_start_anew(tmp_path: Path) -> None:
    """A model with a DC link was refused, and the supply's energy counted warming in waits that no step counts."""
    (tmp_path / "job.toml").write_text(JOB)
    model = eo.PowerModel(
        "z1",
        (
            eo.effects.Standby(power=20.0),
            eo.effects.CopperLoss(r_over_kt2=0.01),
            eo.effects.DcLink(capacity=5.0),
            eo.effects.StandbyDrift(power=10.0, time_constant=3.0),
        ),
    )
    found = eo.job(tmp_path / "job.toml", model=model).document()
    assert found["status"] == "solved"
    assert any("standby_drift: each step counts as if no motion came before it" in said for said in found["warnings"])
    assert any("[supply] replaces what a model assumes of braking (dc_link)" in said for said in found["warnings"])
    levers = {lever["name"]: lever["energy_total"] for lever in found["levers"]}
    assert levers["supply"] == pytest.approx(found["energy_total"])
    assert levers["supply"] <= levers["paths"] + 0.01


def test_a_link_stores_what_a_model_returns_and_replaces_what_careful_assumes(panda: eo.Robot) -> None:
    up, down = np.array([0, 0, 0, -1.0, 0, 1.6, 0.7]), np.array([0, 0.9, 0, -1.0, 0, 1.6, 0.7])
    motion = swing(panda.joints, up, down, 1.0)
    tau = panda.body.torque(motion.position, motion.velocity, motion.acceleration)
    bus = (tau * motion.velocity + 1e-3 * tau**2).sum(axis=1)
    braked, plain = (float(np.trapezoid(power, motion.time)) for power in (-bus.clip(max=0), bus))
    assert braked > 10

    def told(*effects: eo.effects.Effect) -> Scoring:
        model = eo.PowerModel("panda", (eo.effects.CopperLoss(r_over_kt2=1e-3), *effects))
        return Scoring(panda, model, capacity=1e6)

    for efficiency in (0.0, 0.6, 1.0):
        found = told(eo.effects.Regeneration(efficiency=efficiency))
        total = found.energy(Step("down", up, down), motion).total
        assert total == pytest.approx(plain + (1 - efficiency) * braked, rel=1e-3) and not found.replaced
    assert told(eo.effects.DcLink(capacity=5.0)).replaced == ("dc_link",)
    assert Scoring(panda, careful(panda), 50.0).replaced == ("regeneration",)
