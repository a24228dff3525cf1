"""A cycle whose planning is interrupted says so, and no program of arms that may touch is written as valid."""

from __future__ import annotations

from typing import Any

import pytest

import energy_opt as eo

AT_ONCE = {"model": "source-method-2", "stopped": lambda: True}
AHEAD, ASIDE = [0.0, 1.9, -1.2, 0.0, 0.0, 0.0], [1.2, 1.2, -1.0, 0.0, 0.0, 0.0]


def facing(apart: float) -> dict[str, Any]:
    """Two arms at a distance [m] that face and reach for each other at the same time."""
    steps = [{"name": "ahead", "to": AHEAD, "mode": "retime"}, {"name": "aside", "to": ASIDE, "mode": "retime"}]
    robots = [
        {"name": name, "robot": "z1", "base": [x, 0, 0, 0, 0, yaw], "step": steps}
        for name, x, yaw in (("left", 0.0, 0.0), ("right", apart, 3.14159))
    ]
    return {"format": "energy-opt/job/2", "cycle_time": 6.0, "robot": robots}


@pytest.mark.parametrize(("apart", "verdict"), [(0.7, "colliding"), (3.0, "proven")])
@pytest.mark.filterwarnings("ignore:cycle_")
def test_programs_are_valid_only_if_the_arms_are_proven_apart(apart: float, verdict: str) -> None:
    found = eo.job(facing(apart), write=["yaml"], **AT_ONCE)
    assert found["clearance"]["verdict"] == verdict
    assert len(found.files) == 4 and {row.valid for row in found.files} == {verdict == "proven"}
    assert all(("BREAKS A LIMIT: left and right, " in str(row)) == (verdict == "colliding") for row in found.files)
    assert found.exit_code == 130 and found["interrupted"] and found["status"] == "not_converged"
    assert any(said.startswith("interrupted: ") for said in found["warnings"])
