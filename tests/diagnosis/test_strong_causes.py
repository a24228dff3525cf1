"""Few short motions, computed with Pinocchio: strong effects are not divided, and no neighbour of a law is missed."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from hidden import Hidden, record
from logs import lines, log, put

from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.data.noise import Noise
from energy_opt.diagnosis.data.recordings import take_samples
from energy_opt.diagnosis.fit.posterior import Nuisance, World, fit
from energy_opt.diagnosis.hypothesis.links import links_of
from energy_opt.diagnosis.hypothesis.terms import Scale, Term, chart
from energy_opt.diagnosis.search.effect_sets import Search
from energy_opt.diagnosis.search.kinks import elsewhere, usual_laws
from energy_opt.diagnosis.verdict.claims import Claim, widened
from energy_opt.diagnosis.verdict.plausible import is_far
from energy_opt.effects import CopperLoss, CoulombFriction, Standby
from energy_opt.measured import read_set
from energy_opt.power import PowerModel
from energy_opt.robot import load_robot
from energy_opt.tables import read_table, write_table

COPPER, STANDBY, NOISE = 0.01, 60.0, 0.6  # [W / (N m)^2], [W], [W]
MIDDLES = {
    "ur5e": np.array([0, -1.57, 1.57, -1.57, -1.57, 0]), "panda": np.array([0.0, -0.6, 0.0, -2.0, 0.0, 1.9, 0.6]),
}  # fmt: skip


def recorded(folder, friction, seed, count=8, settles=0.0, copper=COPPER, arm="ur5e", returns=True):
    """A set of `count` motions of an arm with quintic timing, and the declared model.

    Args:
        friction: (N, n) N m from v and the rigid torque. settles: [N m] standard deviation of the motors' torque that
            friction bears after a stop; it decays over 0.3 s. copper: (N,) W / (N m)^2, of which COPPER is declared.
        returns: True if negative power of all joints together is used again.
    """
    robot, middle = load_robot(arm), MIDDLES[arm]
    whole, rng = pinocchio.buildModelFromUrdf(str(robot.urdf)), np.random.default_rng(seed)
    fixed = [k for k, name in enumerate(whole.names) if k and name not in robot.joints]
    body = pinocchio.buildReducedModel(whole, fixed, pinocchio.neutral(whole))
    runs, data, start = "", body.createData(), 0.0
    for k in range(count):
        lasts = rng.uniform(0.8, 1.3)
        t = np.arange(0, lasts + 0.6, 0.008)
        x = np.clip((t - 0.3) / lasts, 0, 1)[:, None]
        s, s1, s2 = 10 * x**3 - 15 * x**4 + 6 * x**5, 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - x) * (1 - 2 * x)
        begin, way = middle + rng.uniform(-0.5, 0.5, robot.n), rng.uniform(-1.2, 1.2, robot.n)
        q, v, a = begin + way * s, way * s1 / lasts, way * s2 / lasts**2
        rigid = np.array([pinocchio.rnea(body, data, *row) for row in zip(q, v, a, strict=True)])
        since = np.where(t > 0.3 + lasts, t - 0.3 - lasts, np.inf)[:, None]
        tau = rigid + friction(v, rigid) + settles * rng.normal(size=robot.n) * np.exp(-since / 0.3)
        drive = (tau * v + copper * tau**2).sum(1)
        power = STANDBY + (drive if returns else np.maximum(drive, 0)) + NOISE * rng.normal(size=len(t))
        header = ",".join(["time", *(f"{joint}.position" for joint in robot.joints), "power"])
        put(folder / f"{k}.csv", lines(header, [t, *q.T, power]))
        runs += f'[[run]]\nfile = "{k}.csv"\nkind = "motion"\nstart = {start}\n'
        start += lasts + 2
    declared = PowerModel(arm, (Standby(power=STANDBY), CopperLoss(r_over_kt2=COPPER)))
    return read_set(log(folder, arm, runs)), declared


def diagnosed(*arguments, **options):
    """Document of a set that is `recorded` with these arguments."""
    return diagnose(*recorded(*arguments, **options)).document()


def sets_of(document):
    """Sets of effects that a diagnosis leaves possible."""
    return [{e["name"] for e in document["effects"]}, *map(set, document["alternatives"])]


@pytest.mark.slow
def test_strong_viscous_friction_is_one_cause(tmp_path):
    """A part of it was claimed as viscous friction that falls with time."""
    found = diagnosed(tmp_path, lambda v, tau: 6.0 * v, 5)  # at a wrist a third of its torque
    assert [e["name"] for e in found["effects"]] == ["viscous_friction"]


def test_declared_values_may_be_wrong_by_another_factor_for_each_joint(tmp_path):
    """Priors kept the declared ratios of the joints: the rest went with torque, and nothing was named."""
    copper = COPPER * np.array([10.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    found = diagnosed(tmp_path, lambda v, tau: 0 * v, 7, count=16, copper=copper)
    assert found["verdict"] == "explained" and [e["name"] for e in found["effects"]] == ["copper_loss"]
    for j in (0, 1, 2):  # the others bear too little torque
        low, high = found["effects"][0]["ci95"]["r_over_kt2"][j]
        assert low < copper[j] < high


@pytest.mark.parametrize(("times", "far"), [(10.0, False), (200.0, True)])
def test_a_declared_value_is_not_believed_to_be_hundreds_of_times_larger(tmp_path, times, far):
    """Brakes took 6 W while joints moved; claimed was a wrist's copper loss times 210: dry friction heats it."""
    copper = COPPER * np.array([1.0, 1.0, 1.0, 1.0, 1.0, times])
    measured, declared = recorded(tmp_path, lambda v, tau: 4 * np.sign(v), 3, copper=copper)
    declared = declared.replaced(CoulombFriction(tau_c=4.0))
    samples = take_samples(measured)
    scale, links = Scale.of(measured.robot.limits, samples.power), links_of(samples, declared)
    world = World.of(samples, declared, scale, links, Noise(samples.noise))
    own = chart(Term("copper_loss", declared=True), declared, scale, samples.n)
    f = widened(fit(world, Nuisance(0.003, 0.1), [own], [own.origin]))
    assert f.numbers[0][5] > 0.5 * times * COPPER
    assert is_far(f, Claim("copper_loss", 1000.0, f)) == far


DRY, VISCOUS = np.array([1.5, 2.0, 1.1, 0.5, 0.5, 0.4]), np.array([1.5, 1.9, 1.2, 0.5, 0.4, 0.4])  # N m, N m s/rad


@pytest.mark.slow
def test_dry_and_viscous_friction_are_among_the_answers_where_one_law_imitates_both(tmp_path):
    """The search ended at power-law friction, from which no exchange of one effect reaches the two."""
    found = diagnosed(tmp_path, lambda v, tau: DRY * np.sign(v) + VISCOUS * v, 2, count=7)
    assert {"coulomb_friction", "viscous_friction"} in sets_of(found)


PANDA_DRY = np.array([0.7, 1.0, 0.7, 1.1, 0.6, 0.4, 0.4])  # N m
PANDA_VISCOUS = np.array([1.1, 1.2, 0.9, 1.0, 0.5, 0.4, 0.3])  # N m s/rad


def test_friction_without_use_of_negative_power_is_found_where_other_effects_imitate_them_together(tmp_path):
    """The search ended at other effects: the three laws were never fitted as the only ones."""
    measured, declared = recorded(
        tmp_path, lambda v, tau: PANDA_DRY * np.sign(v) + PANDA_VISCOUS * v, 1, arm="panda", returns=False
    )
    samples = take_samples(measured)
    scale, links = Scale.of(measured.robot.limits, samples.power), links_of(samples, declared)
    found = Search(World.of(samples, declared, scale, links, Noise(samples.noise)))
    charts = [chart(Term(name), declared, scale, samples.n) for name in ("gravity_spring", "power_law_friction")]
    start, no_links = [c.origin for c in charts], np.zeros(links.basis.shape[1])
    other = found.fitted(charts, start, [], Nuisance(0.025, 0.01), no_links)
    true = {"coulomb_friction", "viscous_friction", "regeneration"}
    tried = [other, *elsewhere(found, other)]
    assert true not in [{*f.names} for f in tried]
    assert {*max([*tried, *usual_laws(found, other)], key=found.score).names} == true


def gears(v, tau):
    """Friction of gears and joints: 82 % of the power pass, either way."""
    lost = np.where(tau * v > 0, tau * (1 / 0.82 - 1), np.where(v == 0, 0.0, tau * (0.82 - 1)))
    return lost + DRY * np.sign(v)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "count", "settles"), [(4, 9, 5.0), (17, 6, 2.5)])
def test_power_that_settles_after_stops_is_no_cause(seed, count, settles, tmp_path):
    """Load friction and brakes that engage were claimed; where few stops differed much, all was unexplained."""
    found = diagnosed(tmp_path, gears, seed, count, settles)
    assert {"coulomb_friction", "gear_efficiency"} in sets_of(found)
    assert found["verdict"] in ("explained", "ambiguous")


@pytest.mark.slow
def test_dry_and_viscous_friction_are_judged_together_where_a_little_more_than_the_noise_is_left(tmp_path):
    """25 Hz, steps of 1e-4 rad: 0.03 % of the squares was left. Neither was claimed, as either is much of both."""
    dry, drag = np.array([6, 7, 5, 1.2, 1.0, 0.9]), np.array([7, 8, 6, 1.5, 1.3, 1.2])

    def friction(v):
        return dry * np.tanh(v / 0.005) + drag * v

    made = record(tmp_path / "set", Hidden("ur5e"), friction=friction, runs=1, legs=2, rest=0.8, noise=0.4, seed=2)
    rows = read_table(made / "0.csv")
    steps = [1e-4 if name.endswith("position") else 1e-5 for name in rows]
    thinned = [np.round(column[::4] / step) * step for column, step in zip(rows.values(), steps, strict=True)]
    write_table(made / "0.csv", list(rows), thinned)
    declared = PowerModel("ur5e", (Standby(power=60.0), CopperLoss(r_over_kt2=0.004)))
    d = diagnose(read_set(made), declared).document()
    assert d["verdict"] in ("partly", "ambiguous", "explained") and d["usable"]
    found = {row["name"]: row["parameters"] for row in d["effects"]}
    assert found.keys() == {"coulomb_friction", "viscous_friction"}
    assert np.allclose(found["coulomb_friction"]["tau_c"][:3], dry[:3], rtol=0.2)
    assert np.allclose(found["viscous_friction"]["b"][:3], drag[:3], rtol=0.2)
