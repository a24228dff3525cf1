"""Laws that contain a declared effect: friction that differs by direction, and friction that falls with warmth."""

from __future__ import annotations

import numpy as np
import pytest
from hidden import COPPER, STANDBY, Hidden, record
from virtual_sets import base_model, make_set

from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.data.noise import Noise
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.diagnosis.fit.candidates import candidates
from energy_opt.diagnosis.fit.posterior import Nuisance, World, fit
from energy_opt.diagnosis.hypothesis.links import links_of
from energy_opt.diagnosis.hypothesis.terms import Scale, Term, chart
from energy_opt.diagnosis.search.effect_sets import Search, root
from energy_opt.diagnosis.search.kinks import elsewhere
from energy_opt.effects import (
    AsymmetricFriction,
    CopperLoss,
    CoulombFriction,
    DailyFriction,
    Regeneration,
    Standby,
    TemperatureFriction,
    ThermalViscous,
    ViscousFriction,
)
from energy_opt.measured import read_set
from energy_opt.power import PowerModel, load_model
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


@pytest.fixture(scope="module")
def start(tmp_path_factory):
    """Fit of a declared model with dry friction, and regeneration that returns nothing."""
    measured = read_set(record(tmp_path_factory.mktemp("sets") / "set", Hidden("ur5e"), runs=2, legs=1, seed=3))
    effects = (
        Standby(power=STANDBY),
        CopperLoss(r_over_kt2=COPPER),
        CoulombFriction(tau_c=DRY),
        Regeneration(efficiency=0.0),
    )
    declared, samples = PowerModel("ur5e", effects), take_samples(measured)
    scale = Scale.of(measured.robot.limits, samples.power)
    return root(World.of(samples, declared, scale, links_of(samples, declared), Noise(0.5)), Nuisance(0.03, 0.1))


def test_a_store_may_take_the_place_of_declared_regeneration(start):
    """It was no candidate if the declared model says how much negative power is used again, as `careful` does."""
    stores = [c.chart for c in candidates(start) if c.chart.term.name == "dc_link"]
    assert stores
    for c in stores:
        model = c.into(start.model, c.origin)
        assert model.get("dc_link") is not None and model.get("regeneration") is None
        assert c.out_of(model, start.world.declared).get("regeneration") is not None


def test_declared_friction_fitted_anew_is_compared_with_a_law_that_contains_it(start):
    """Asymmetric friction was `explained` where dry friction is larger than declared: no exchange reached this."""
    term = Term("asymmetric_friction", (), (*(DRY / 9), *(DRY / 9)), instead=("coulomb_friction",))
    own, found = chart(term, start.world.declared, start.world.scale, len(DRY)), Search(start.world)
    contained = fit(start.world, start.nuisance, [own], [own.origin])
    assert [f.names for f in elsewhere(found, contained)] == [("coulomb_friction",)]
