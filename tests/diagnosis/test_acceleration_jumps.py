"""Motions whose acceleration jumps: what smoothing makes wrong beside a jump is no missing law."""

from __future__ import annotations

import pytest

from energy_opt.diagnosis import diagnose
from energy_opt.measured import read_set

pytest.importorskip("mujoco")
from misfit_world import World, write_world

EXACT = (0.0, 0.0)


@pytest.mark.parametrize(
    "world",
    [
        World("xarm7", 32, EXACT, cause="motion_power", sharp=True),
        World("xarm7", 33, EXACT, cause="coulomb_friction", sharp=True),
        World("panda", 34, EXACT, cause="payload", sharp=True),
    ],
    ids=lambda world: world.cause,
)
def test_a_cause_is_found_and_nothing_else_is_missing(tmp_path, world):
    """The error had been three to seven times the noise, and no cause was named."""
    truth = write_world(world, tmp_path / "set")
    d = diagnose(read_set(truth.folder, truth.robot), truth.declared).document()
    assert (d["verdict"], [e["name"] for e in d["effects"]]) == ("explained", [world.cause])


def test_of_a_clean_arm_nothing_is_missing(tmp_path):
    """The error had been 1.3 times the noise."""
    truth = write_world(World("xarm7", 31, EXACT, sharp=True), tmp_path / "set")
    assert diagnose(read_set(truth.folder, truth.robot), truth.declared).verdict == "nothing_missing"
