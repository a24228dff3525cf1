"""Motions whose acceleration jumps, and joints that creep: what the positions do not show is no missing law."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.data.jumps import creeping
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
    d = diagnose(read_set(truth.folder, truth.robot), truth.declared).document
    assert (d["verdict"], [e["name"] for e in d["effects"]]) == ("explained", [world.cause])


def test_of_a_clean_arm_nothing_is_missing(tmp_path):
    """The error had been 1.3 times the noise."""
    truth = write_world(World("xarm7", 31, EXACT, sharp=True), tmp_path / "set")
    assert diagnose(read_set(truth.folder, truth.robot), truth.declared).verdict == "nothing_missing"


@pytest.mark.parametrize(("friction", "watts", "slow"), [(2.0, 0.02, 15), (2.0, 2.0, 25), (0.0, 2.0, 0)])
def test_dry_friction_of_joints_that_creep_is_not_known(friction, watts, slow):
    """Of four joints one moves, one begins 0.3 s later, one rests, one creeps throughout: the last by its watts alone.

    The positions do not show when the second begins; at rest its model has no friction, in motion all of it.
    """
    t = 0.02 * np.arange(50)
    v = np.zeros((50, 4))
    v[10:35, 0], v[25:35, 1], v[10:35, 3] = 0.5, 0.3, 0.005
    samples = SimpleNamespace(v=v, t=t, unit=np.ones(4), noise=0.5, slices=[slice(0, 50)], shown=lambda x: x)
    by_tau = np.full((50, 4), watts / 2.0)
    now = SimpleNamespace(tau=np.zeros((50, 4)), tau_m=friction * np.sign(v), by_tau=by_tau)
    assert creeping(samples, now).sum() == slow
