"""A job of several robots under models with effects that depend on time or store energy."""

from __future__ import annotations

from pathlib import Path

import pytest

import energy_opt as eo

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
    levers = {lever["name"]: lever["energy_total"] for lever in found["levers"]}
    assert levers["supply"] == pytest.approx(found["energy_total"])
    assert levers["supply"] <= levers["paths"] + 0.01
