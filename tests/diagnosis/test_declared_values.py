"""Declared values that are wrong, also of effects that `diagnose` does not propose where they are absent."""

from __future__ import annotations

import numpy as np
import pytest
from virtual_sets import base_model, make_set

from energy_opt.diagnosis import diagnose
from energy_opt.effects import CoulombFriction, FrictionCurve, ViscousFriction
from energy_opt.measured import read_set
from energy_opt.virtual_arm.simulate import Instruments

pytest.importorskip("mujoco")
TORQUE = np.outer([0.6, 0.8, 0.6, 1.2, 0.8, 0.3, 0.5], [0.8, 1.0, 1.1, 1.2])  # N m, of all joints at all speeds


@pytest.mark.slow
@pytest.mark.parametrize("joints", [[0, 0, 0, 0, 0, 0, 0], [1, 1.7, 1, 1.5, 1, 1, 1]])
def test_a_declared_friction_curve_is_fitted_anew(tmp_path, joints):
    """It kept its declared values: without friction nothing was named, after a minute and a half."""
    now, declared = (FrictionCurve(speed=[0, 0.3, 1, 2], torque=t) for t in ((TORQUE.T * joints).T, TORQUE))
    owned, calm = base_model("panda").replaced(declared), Instruments(noise=0.6, power_resolution=0.05)
    made = make_set(tmp_path / "set", "panda", [now], seed=5, instruments=calm, declared=owned)
    document = diagnose(read_set(made.folder), owned).document()
    effect = document["effects"][0]
    assert effect["name"] == "friction_curve" and effect["refit"]
    assert document["verdict"] == "explained" or [effect["name"]] in document["alternatives"]
    torque = np.reshape(effect["parameters"]["torque"], (7, 4))
    assert abs(torque[1, 2] - now.values["torque"][1, 2]) < 0.15


@pytest.mark.slow
def test_a_second_declared_value_that_is_a_little_wrong_does_not_hide_the_first(tmp_path):
    """Viscous friction was thought to be right, so dry friction had to fit what it left: `partly` at best."""
    now, calm = np.array([0.6, 1.2, 0.6, 0.6, 0.6, 0.6]), Instruments(noise=0.6, power_resolution=0.05)
    owned = base_model("z1").replaced(CoulombFriction(tau_c=2 * now)).replaced(ViscousFriction(b=1.25 * now))
    effects = [CoulombFriction(tau_c=now), ViscousFriction(b=now)]
    made = make_set(tmp_path / "set", "z1", effects, seed=1, instruments=calm, declared=owned, motions=4)
    document = diagnose(read_set(made.folder), owned).document()
    assert document["verdict"] == "explained"
    assert [effect["name"] for effect in document["effects"]] == ["coulomb_friction", "viscous_friction"]
