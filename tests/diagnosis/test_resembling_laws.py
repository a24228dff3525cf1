"""Laws that resemble each other are alternatives; worlds of laws and noise that are not the package's."""

from __future__ import annotations

import pytest

from energy_opt.diagnosis import diagnose
from energy_opt.measured import read_set

pytest.importorskip("mujoco")
from misfit_world import World, write_world

WARMING = [
    World("z1", 620014, (0.03, 0.05), "ar1", "standby_drift"),
    World("panda", 2100001, (0.03, 0.05), "ar1", "standby_drift"),
]
RESEMBLING = [
    (World("z1", 100002, (0.0, 0.05), "ar1", unlisted="dahl"), {"coulomb_friction", "asymmetric_friction"}),
    (World("z1", 8200002, (0.0, 0.05), "ar1", unlisted="dahl"), {"coulomb_friction"}),
    (World("panda", 100008, (0.0, 0.05), "white", unlisted="field_weakening"), set()),
    (World("panda", 9800008, (0.0, 0.05), "white", unlisted="field_weakening"), set()),
    (World("panda", 10100016, (0.0, 0.05), "white", unlisted="thixotropy"), {"viscous_friction"}),
    # the true law is the likelier one on motions held out
    (World("xarm7", 10110011, (0.0, 0.05), "ar1", "viscous_friction", unlisted="phases"), {"viscous_friction"}),
    # noise at rest is louder than the standstills fitted
    (World("xarm7", 11120038, (0.03, 0.05), "ar1", "load_friction"), {"load_friction"}),
    (World("z1", 8330002, (0.0, 0.0), "white", "payload"), {"payload"}),  # links can stand for it
    (World("z1", 220002, (0.03, 0.05), "ar1", "payload"), {"payload"}),
    (World("panda", 220004, (0.03, 0.05), "ar1", "armature"), {"armature"}),
    # heat of the runs that are held out warms the windings, too
    (World("xarm7", 620046, (0.03, 0.05), "ar1", "winding_self_heating"), {"winding_self_heating"}),
    # noise of encoders during a dwell is no motion
    (World("xarm7", 320027, (0.03, 0.05), "ar1", "idle_hold"), {"idle_hold"}),
    # of log odds of 319, 3 do not decide between laws that are the same to first order
    (World("xarm7", 11820011, (0.03, 0.05), "ar1", "gear_efficiency"), {"gear_efficiency"}),
    # where more than the noise is left, held-out motions decide under the largest plausible noise
    (World("panda", 300054, (0.0, 0.05), "ar1", unlisted="coupled_friction"), {"coulomb_friction"}),
]
MORE = [  # of the same kinds
    (World("xarm7", 10110026, (0.0, 0.05), "ar1", "viscous_friction", unlisted="dahl"), {"viscous_friction"}),
    (World("xarm7", 220007, (0.03, 0.05), "ar1", "supply_efficiency"), {"supply_efficiency"}),
    (World("xarm7", 520050, (0.03, 0.05), "ar1", "psu_loss"), {"psu_loss"}),  # or links that are all too light
    # lower prior odds of a rare effect exclude no alternative
    (World("xarm7", 220050, (0.03, 0.05), "ar1", "psu_loss"), {"psu_loss"}),
    (World("panda", 520051, (0.03, 0.05), "ar1", "asymmetric_friction"), {"asymmetric_friction"}),
    # the best of a dozen free functions is twenty times as likely by chance
    (World("panda", 420008, (0.03, 0.05), "ar1", "motion_power"), {"motion_power"}),
    # the loss of a supply beside heavier links has a third of the evidence
    (World("z1", 420002, (0.03, 0.05), "ar1", "payload"), {"payload"}),
    # no deviation of a link is significant alone
    (World("xarm7", 320054, (0.03, 0.05), "ar1", "dc_link"), {"dc_link"}),
    (World("xarm7", 420054, (0.03, 0.05), "ar1", "dc_link"), {"dc_link"}),  # one motion alone fills the store
    (World("xarm7", 520042, (0.03, 0.05), "ar1", "standby_drift"), {"standby_drift"}),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("world", "true"), RESEMBLING + [pytest.param(*case, marks=pytest.mark.nightly) for case in MORE]
)
def test_laws_that_resemble_each_other_are_alternatives(tmp_path, world, true):
    """Where a function that is no effect's is likelier, laws that foresee as well stand beside each other.

    `true`: effects of which each alone is the same mechanism; of an unlisted law none need be named.
    """
    truth = write_world(world, tmp_path / "set")
    d = diagnose(read_set(truth.folder, truth.robot), truth.declared).document()
    said = [{e["name"] for e in d["effects"]}, *map(set, d["alternatives"])]
    assert any({name} in said for name in true) or bool(world.unlisted and not d["effects"])


@pytest.mark.parametrize("world", WARMING, ids=lambda world: world.arm)
def test_a_warm_up_by_more_than_meters_drift_is_claimed(tmp_path, world):
    """By 4 to 6 W, while meters of such arms drift by 2 to 3 W."""
    truth = write_world(world, tmp_path / "set")
    assert [x.name for x in diagnose(read_set(truth.folder, truth.robot), truth.declared).effects] == ["standby_drift"]


@pytest.mark.slow
def test_an_elastic_belt_is_not_friction(tmp_path):
    """Stribeck friction takes 0.01 W off the error held out, and adds to the squares over the noise."""
    truth = write_world(World("z1", 11400006, (0.0, 0.05), "ar1", unlisted="belt"), tmp_path / "set")
    assert not diagnose(read_set(truth.folder, truth.robot), truth.declared).effects


@pytest.mark.nightly
def test_a_search_that_leaves_effects_out_ends(tmp_path):
    """Load friction and coulomb friction replaced each other for ever."""
    truth = write_world(World("panda", 12800081, (0.0, 0.05), unlisted="bearing_load"), tmp_path / "set")
    assert not diagnose(read_set(truth.folder, truth.robot), truth.declared).effects
