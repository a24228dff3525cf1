"""The motion to record next: what is minimised, what it is judged by, limits, and that it settles what was open."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from hidden import Hidden, record

from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import main
from energy_opt.diagnosis import diagnose
from energy_opt.diagnosis.data.noise import Noise
from energy_opt.diagnosis.fit.posterior import Nuisance
from energy_opt.effects import (
    CopperLoss,
    CoulombFriction,
    LoadFriction,
    MeterDelay,
    MeterFilter,
    MeterGain,
    Payload,
    Standby,
    SupplyEfficiency,
    ViscousFriction,
)
from energy_opt.files import read_json
from energy_opt.formats import read_trajectory, table
from energy_opt.measured import read_set
from energy_opt.motion.limits.base import values_of
from energy_opt.next_motion.legs import PAUSE, contrast_functions, contrast_parameters
from energy_opt.next_motion.motion_search import propose
from energy_opt.next_motion.recordings import Prospect, recordings
from energy_opt.next_motion.rival_models import Rival, Slack, nearest, rivals_of, separations
from energy_opt.power import PowerModel
from energy_opt.robot import load_robot

SIX = [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]  # xx, xy, yy, xz, yz, zz
BASE = PowerModel("ur5", (Standby(power=92.6), CopperLoss(r_over_kt2=[0.004, 0.004, 0.005, 0.04, 0.04, 0.045])))


@pytest.fixture(scope="module")
def ur5():
    return load_robot("ur5")


def node(robot, seed=0):
    """A node's variables (z, q, v, a, T) away from kinks."""
    rng = np.random.default_rng(seed)
    duration = 1.7
    q, v, a = rng.normal(size=robot.n), rng.uniform(0.5, 1.5, robot.n), rng.normal(size=robot.n)
    return np.concatenate([q, v * duration, a * duration**2, [duration]]), q, v, a, duration


def plain(models):
    return [Rival(model) for model in models]


def hidden(**given):
    """What a diagnosis hands over, as far as the choice of rivals looks; its fits leave open no more than links."""
    none = np.zeros(0)
    world = SimpleNamespace(
        links=SimpleNamespace(basis=np.zeros((60, 0))),
        whiten=SimpleNamespace(noise=Noise(1.0)),
        samples=SimpleNamespace(step=0.1, body=load_robot("ur5").body),
    )
    fits = [
        SimpleNamespace(
            model=m, names=(), charts=(), numbers=(), places=(), count=0, weights=none, amounts=none,
            covariance=np.zeros((0, 0)), hessian=np.zeros((0, 0)), nuisance=Nuisance(0.03, 0.3), world=world,
        )
        for m in given.get("rivals", [BASE])
    ]  # fmt: skip
    return SimpleNamespace(rivals=tuple(fits), accepted=fits[0], idle=given.get("idle", ()), unseen=())


def parameters_of(models, weights):
    """What node functions take: all models' values and the weights, and behind them the plain width of kinks."""
    return np.concatenate([contrast_parameters(models, 6, weights), values_of(())])


def test_the_cost_is_the_weighted_square_of_the_difference(ur5):
    """Without copper loss, viscous friction adds sum b v^2 and nothing else; dry friction sum tau_c |v|."""
    b, dry = np.linspace(0.5, 3.0, 6), np.linspace(1.0, 2.0, 6)
    level = PowerModel("ur5", (Standby(power=92.6),))
    models = [level, level.replaced(ViscousFriction(b=b)), level.replaced(CoulombFriction(tau_c=dry))]
    functions = contrast_functions(models, ur5, np.zeros(6, dtype=int))
    z, _, v, _, duration = node(ur5)
    weights = np.array([0.3, 0.2, 0.7])
    cost, _ = functions.value(z, 0.5, parameters_of(models, weights))
    first, second = b @ v**2, dry @ np.abs(v)
    apart = weights @ np.array([first**2, second**2, (first - second) ** 2])
    assert float(cost) == pytest.approx(-duration / (duration + PAUSE) * apart, rel=2e-3)  # the smoothed sign


def test_a_lag_shows_by_how_fast_the_power_changes(ur5):
    models = [BASE.replaced(MeterDelay(delay=0.08)), BASE.replaced(MeterDelay(delay=0.02))]
    functions = contrast_functions(models, ur5, np.zeros(6, dtype=int))
    z, q, v, a, duration = node(ur5, 1)

    def power(t):  # at constant acceleration, by Pinocchio's torque
        speed = v + a * t
        tau = ur5.body.torque((q + v * t + a * t * t / 2)[None], speed[None], a[None])[0]
        return tau @ speed + BASE.get("copper_loss").values["r_over_kt2"] @ tau**2

    change = (power(1e-5) - power(-1e-5)) / 2e-5
    cost, _ = functions.value(z, 0.5, parameters_of(models, np.ones(1)))
    assert float(cost) == pytest.approx(-duration / (duration + PAUSE) * (0.06 * change) ** 2, rel=1e-6)


def test_derivatives_of_the_cost(ur5):
    models = [
        BASE.replaced(ViscousFriction(b=2.0)).replaced(MeterGain(gain=1.05)),
        BASE.replaced(CoulombFriction(tau_c=1.0)).replaced(Payload(mass=1.0, com=[0, 0, 0.1])),
        BASE.replaced(MeterFilter(time_constant=0.1)),
    ]
    functions = contrast_functions(models, ur5, np.array([0, 1, 2, 0, 1, 2]))
    parameters = parameters_of(models, np.array([1e-3, 2e-3, 3e-3]))
    z, *_ = node(ur5, 2)
    _, slope = functions.cost(z, 0.4, parameters)
    lam, step = np.linspace(-0.2, 0.3, 6), 1e-6

    def gradient(x):
        _, jacobian = functions.limited(x, 0.4, parameters)
        return 0.7 * np.array(functions.cost(x, 0.4, parameters)[1]).ravel() + np.array(jacobian).T @ lam

    numeric, curvature = [], []
    for k in range(len(z)):
        e = step * (np.arange(len(z)) == k)
        up, down = (float(functions.value(z + s * e, 0.4, parameters)[0]) for s in (1, -1))
        numeric.append((up - down) / (2 * step))
        curvature.append((gradient(z + e) - gradient(z - e)) / (2 * step))
    np.testing.assert_allclose(np.array(slope).ravel(), numeric, rtol=1e-5, atol=1e-5)
    hessian = np.array(ca.DM(functions.curvature(z, 0.4, parameters, 0.7, lam)))
    np.testing.assert_allclose(hessian, curvature, rtol=1e-4, atol=1e-3)


@pytest.fixture(scope="module")
def proposed(ur5):
    models = [BASE.replaced(CoulombFriction(tau_c=1.2)), BASE.replaced(ViscousFriction(b=1.1))]
    return models, propose(plain(models), ur5, seed=1)


def test_the_next_motion_separates_more_than_the_straight_one(proposed):
    _, motion = proposed
    assert motion.difference > 1.3 * motion.straight > 0


def test_limits_hold_in_the_file(proposed, ur5, tmp_path):
    _, motion = proposed
    table.write(motion.trajectory, tmp_path / "next_motion.csv")
    read = read_trajectory(tmp_path / "next_motion.csv", ur5.joints)
    q, v, a, _ = read.sample(read.denser(7))
    limits = ur5.limits
    assert (q >= limits.lower).all() and (q <= limits.upper).all() and (np.abs(v) <= limits.velocity).all()
    extra = [np.sign(v) * 1.2, 1.1 * v]  # what the rivals' motors add to the rigid body's torque
    for added in extra:
        assert (np.abs(ur5.body.torque(q, v, a) + added) <= limits.effort * (1 + 1e-6)).all()
    assert np.abs(read.velocity[[0, -1]]).max() < 1e-9 and motion.certificate.valid
    # fast and slow, both ways: half of the samples in motion are slower than 40 % of the fastest
    share = (np.abs(v) / limits.velocity).max(axis=1)
    assert share.max() > 0.8 and np.mean((share > 0.02) & (share <= 0.4)) > 0.25


def test_the_difference_is_that_of_the_file(proposed, ur5):
    """Both powers written out by hand: mechanical, copper, standby."""
    _, motion = proposed
    time = np.arange(0.0, motion.trajectory.duration, 0.008)
    q, v, a, _ = motion.trajectory.sample(time)
    tau, r = ur5.body.torque(q, v, a), BASE.get("copper_loss").values["r_over_kt2"]
    dry, viscous = tau + 1.2 * np.sign(v), tau + 1.1 * v
    apart = np.sum(dry * v + r * dry**2, axis=1) - np.sum(viscous * v + r * viscous**2, axis=1)
    assert motion.difference == pytest.approx(np.sqrt(np.mean(apart**2)), rel=1e-3)


def test_effects_that_are_equal_at_the_meter_stay_equal(ur5):
    gain, supply = BASE.replaced(MeterGain(gain=1.25)), BASE.replaced(SupplyEfficiency(eta=0.8))
    assert propose(plain([gain, supply]), ur5) is None


def test_a_pair_that_is_the_same_does_not_hide_a_third(ur5):
    gain, supply = BASE.replaced(MeterGain(gain=1.25)), BASE.replaced(SupplyEfficiency(eta=0.8))
    motion = propose(plain([gain, supply, BASE.replaced(ViscousFriction(b=2.0))]), ur5)
    assert motion is not None and motion.difference >= motion.straight > 0.1


def test_idle_joints_move_and_reach_useful_speed(ur5):
    idle = (1, 4)
    rivals = rivals_of(hidden(idle=idle), ur5.n)
    assert len(rivals) == 1 + 3 * len(idle) and len({r.model.structure for r in rivals}) == 1
    motion = propose(rivals, ur5)
    speed = np.abs(motion.trajectory.velocity).max(axis=0) / ur5.limits.velocity
    assert (speed[list(idle)] > 0.5).all() and motion.difference > motion.straight


def test_rivals_that_fit_equally_well_are_distinguished_as_they_are(ur5):
    rivals = [BASE.replaced(ViscousFriction(b=2.0)), BASE.replaced(CoulombFriction(tau_c=1.0))]
    assert [r.model for r in rivals_of(hidden(rivals=rivals, idle=(2,)), ur5.n)] == rivals


def test_the_same_seed_gives_the_same_motion(proposed, ur5):
    models, motion = proposed
    assert np.array_equal(propose(plain(models), ur5, seed=1).trajectory.position, motion.trajectory.position)


def test_differences_that_links_and_level_explain_do_not_count(ur5, proposed):
    """A payload against links: all of it where links are open, next to nothing left; and a level against a level."""
    payload = Payload(mass=0.8, com=[0.0, 0.03, 0.1])
    mass, com = payload.values["mass"][0], payload.values["com"]
    point = np.zeros((60, 1))
    point[50:, 0] = [mass, *mass * com, *(mass * (com @ com * np.eye(3) - np.outer(com, com)))[*SIX]]
    motion = proposed[1].trajectory

    def left(other, links, level):
        slack = Slack(np.zeros((len(BASE.values(6)), 1)), np.zeros(60), links, level, 0.01)
        apart = [Rival(BASE, slack), Rival(other)]
        return separations(apart, ur5.body, motion, 0.02)[0]

    shut = np.zeros((60, 1))
    loaded, higher = BASE.replaced(payload), BASE.replaced(Standby(power=95.0))
    assert left(loaded, shut, 0.0) > 1.0 and left(loaded, point, 0.0) < 0.1 * left(loaded, shut, 0.0)
    assert left(loaded, 0.002 * point, 0.0) > 0.5 * left(loaded, shut, 0.0)  # links that are known well hide little
    assert left(higher, shut, 0.0) == pytest.approx(2.4) and left(higher, shut, 2.0) < 0.05


def recorded(effect, robot_name, seed, noise, motions):
    """A short noisy session on an arm with an effect, and a function that records it and more, and diagnoses all."""
    pytest.importorskip("mujoco")
    from virtual_arms import draw_effect
    from virtual_motions import excitation
    from virtual_sets import arm, base_model

    from energy_opt.virtual_arm.plant import Plant
    from energy_opt.virtual_arm.simulate import Instruments, simulate

    robot, rng = arm(robot_name), np.random.default_rng([seed, 1])
    declared = base_model(robot_name)
    plant = Plant(declared.replaced(draw_effect(effect, robot_name, rng)))
    session = excitation(robot, rng, motions=motions, poses=2)

    def found(folder, more=()):
        noisy = Instruments(noise=noise, power_resolution=0.05)
        simulate([*session, *more], plant, robot, folder, seed=seed, instruments=noisy)
        return diagnose(read_set(folder, robot), declared)

    return robot, found


@pytest.mark.slow
def test_recorded_on_the_arm_it_settles_which_law_holds(tmp_path):
    """A short noisy run leaves open which law of friction holds; the proposed motion tells.

    Of this set the expected log odds after one recording are 6 to 20, where 3 are needed: motions differ by machine.
    """
    from energy_opt.virtual_arm.simulate import Reference

    robot, found = recorded(CoulombFriction, "xarm7", seed=4, noise=2.0, motions=1)
    before = found(tmp_path / "before")
    assert before.document()["verdict"] == "ambiguous" and ["coulomb_friction"] in before.document()["alternatives"]
    motion = propose(rivals_of(before.inference, robot.n), robot)
    assert motion.difference > motion.straight  # beyond what the numbers of either law can take up
    t, count = motion.trajectory, recordings(before.inference, motion.trajectory)
    assert count is not None
    takes = [Reference(f"next{k}", t.time, t.position, t.velocity) for k in range(1, count + 1)]
    after = found(tmp_path / "after", takes).document()
    assert after["verdict"] == "explained" and [x["name"] for x in after["effects"]] == ["coulomb_friction"]


@pytest.mark.slow
def test_laws_that_are_too_alike_are_not_said_to_be_settled_by_a_recording(tmp_path):
    """Whether friction goes with the load or gears lose a share: both laws are the same to first order.

    Links that are half a per cent lighter make up for most of what differs: after three recordings log odds were 3.4
    where 4.0 are needed, after six, which settle no more, 3.8 where 4.5 are needed.
    """
    robot, found = recorded(LoadFriction, "panda", seed=5, noise=3.0, motions=2)
    before = found(tmp_path / "set")
    assert sorted(before.document()["alternatives"]) == [["gear_efficiency"], ["load_friction"]]
    motion = propose(rivals_of(before.inference, robot.n), robot)
    assert motion.difference > motion.straight and recordings(before.inference, motion.trajectory) is None
    before.declared.save(tmp_path / "set" / "declared.toml")
    assert main(["diagnose", str(tmp_path / "set"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    document = read_json(tmp_path / "out" / "diagnosis.json")
    assert any("Even 5 recordings may not decide" in said for said in document["remarks"])
    assert document["usable"] and "good enough" in document["next_step"]  # either law plans as well
    assert any(said.startswith("To tell the alternatives apart, record") for said in document["remarks"])
    assert not any("under all these" in said for said in document["remarks"])  # they differ by load alone
    assert (tmp_path / "out" / document["next_motion"]).is_file()


@pytest.mark.slow
def test_a_set_without_motions_says_how_often_to_record_one(tmp_path):
    """It asked for a motion, of unknown number."""
    record(tmp_path / "set", Hidden("ur5e"), legs=0, rest=2.0)
    assert main(["diagnose", str(tmp_path / "set"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    document = read_json(tmp_path / "out" / "diagnosis.json")
    assert document["verdict"] == "insufficient"
    assert any("Record next_motion.csv next" in said and "at least once" in said for said in document["remarks"])


def test_errors_that_repeats_share_limit_what_they_tell():
    """Of readings 2 W apart with 1 W of noise: log odds of 2 each and recording; with errors of as much 1 at first."""
    reading, none = np.zeros(10), np.zeros((10, 0))

    def odds(weight, count):
        same, other = (Prospect(0.0, reading + x, none, 1.0, np.full(10, weight)) for x in (0.0, 2.0))
        return same.after(reading, count) - other.after(reading, count)

    assert [odds(1.0, n) for n in (0, 1, 5)] == pytest.approx([0.0, 20.0, 100.0])
    assert [odds(0.5**0.5, n) for n in (0, 1, 5, 1000)] == pytest.approx([0.0, 10.0, 100 / 6, 20.0], rel=2e-3)


def test_a_rivals_nearest_numbers_are_within_their_bounds(ur5, proposed):
    """An open friction that would resemble another law most below zero stays at zero."""
    motion = proposed[1].trajectory
    known, open_ = BASE, BASE.replaced(ViscousFriction(b=0.1))
    lower = known.replaced(Standby(power=60.0))
    values = np.zeros((len(open_.values(6)), 6))
    values[-6:] = 5.0 * np.eye(6)
    slack = Slack(values, np.zeros(60), np.zeros((60, 6)), 0.0, 0.01)
    near = nearest([Rival(lower), Rival(open_, slack)], ur5.body, motion, 0.02, 0)
    assert (near[1].get("viscous_friction").full(6) >= 0).all()


def test_rivals_with_open_numbers_are_distinguished_where_these_resemble_each_other_most(ur5, proposed):
    """Viscous friction whose size is open against one that is known: nothing is left to tell, with any size."""
    motion = proposed[1].trajectory
    known, open_ = BASE.replaced(ViscousFriction(b=2.0)), BASE.replaced(ViscousFriction(b=1.0))
    values = np.zeros((len(open_.values(6)), 6))
    values[-6:] = 5.0 * np.eye(6)
    slack = Slack(values, np.zeros(60), np.zeros((60, 6)), 0.0, 0.01)
    near = nearest([Rival(known), Rival(open_, slack)], ur5.body, motion, 0.02, 0)
    assert near[0] == known
    np.testing.assert_allclose(near[1].get("viscous_friction").full(6), 2.0, rtol=0.1)


def test_an_arm_without_collision_bodies_is_clear(ur5, tmp_path):
    urdf = re.sub(r"<collision.*?</collision>", "", Path(ur5.urdf).read_text(), flags=re.DOTALL)
    (tmp_path / "bare.urdf").write_text(urdf)
    bare = load_robot(str(tmp_path / "bare.urdf"))
    time, still = np.linspace(0, 1, 11), np.zeros((11, 6))
    assert load_cell(bare, CellRequest()).prove(time, still, still, still).proven
