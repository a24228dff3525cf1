"""Laws that contain a declared effect: friction that differs by direction, and friction that falls with warmth."""

from __future__ import annotations

import numpy as np
import pytest
from virtual_sets import base_model, make_set

from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.hypothesis.terms import Scale, Term, chart
from energy_opt.effects import (
    AsymmetricFriction,
    CoulombFriction,
    DailyFriction,
    TemperatureFriction,
    ThermalViscous,
    ViscousFriction,
)
from energy_opt.measured import read_set
from energy_opt.power import load_model
from energy_opt.robot import load_robot
from energy_opt.virtual_arm.simulate import Instruments

DRY, WET = np.array([6.0, 6.0, 5.0, 1.6, 1.6, 1.4]), np.array([9.0, 9.0, 7.0, 1.2, 1.2, 1.0])


@pytest.mark.parametrize("kind", [AsymmetricFriction, ThermalViscous, TemperatureFriction, DailyFriction])
def test_a_containing_law_starts_as_the_declared_friction(kind):
    robot = load_robot("ur5e")
    declared = base_model("ur5e").replaced(CoulombFriction(tau_c=DRY)).replaced(ViscousFriction(b=WET))
    held = [declared.get(name) for name in kind.contains]
    for start in kind.containing(*held):
        term = Term(kind.name, (), tuple(start.full(6).tolist()), instead=kind.contains)
        own = chart(term, declared, Scale.of(robot.limits, np.full(9, 100.0)), 6)
        model = own.into(declared, own.origin)
        assert {e.name for e in model.effects} == {e.name for e in declared.effects} - {*kind.contains} | {kind.name}
        assert {*own.out_of(model, declared).effects} == {*declared.effects}
        for name, values in start.values.items():
            np.testing.assert_allclose(model.get(kind.name).values[name], values)


@pytest.mark.slow
def test_less_friction_in_one_direction_is_no_spring(tmp_path):
    """The declared friction is the mean of both directions, so one of them has less than is declared."""
    pytest.importorskip("mujoco")
    apart = np.array([0.0, 0.0, 4.0, 0.0, 0.6, 0.0])
    effects = [AsymmetricFriction(tau_plus=DRY + apart, tau_minus=DRY - apart), ViscousFriction(b=WET)]
    owned = base_model("ur5e").replaced(CoulombFriction(tau_c=DRY)).replaced(ViscousFriction(b=WET))
    calm = Instruments(noise=0.6, power_resolution=0.05)
    made = make_set(tmp_path / "set", "ur5e", effects, seed=3, instruments=calm, declared=owned)
    found = diagnose(read_set(made.folder), owned)
    document = found.document()
    assert document["verdict"] == "explained"
    assert [effect["name"] for effect in document["effects"]] == ["asymmetric_friction"]
    for name, truth in (("tau_plus", DRY + apart), ("tau_minus", DRY - apart)):
        low, high = np.transpose(document["effects"][0]["ci95"][name])
        assert ((low <= truth) & (truth <= high)).sum() >= 5  # of six intervals of 95 %
    found.save(tmp_path / "out")
    written = load_model(tmp_path / "out/model.toml")
    assert written.get("coulomb_friction") is None and written.get("asymmetric_friction") is not None
