"""The laws that follow the past, the free curve and the links, against formulas and sums of their own."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import energy_opt as eo
from energy_opt.effects import (
    BY_NAME,
    EXACT,
    AsymmetricFriction,
    CopperLoss,
    DcLink,
    FrictionCurve,
    IdleHold,
    IronLoss,
    LinkInertia,
    PowerLawFriction,
    PsuLoss,
    Regeneration,
    RunOffset,
    Signals,
    Standby,
    ThermalViscous,
)
from energy_opt.errors import BadInput
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel, load_model
from energy_opt.power.drive_law import rigid_torque
from energy_opt.robot import load_robot

SPEED, TORQUE = [0.0, 0.1, 0.5, 1.5], [0.8, 0.4, 0.6, 1.4]


def torque_of(effect, v, **past):
    n = len(v)
    x = Signals(ca.DM.zeros(n), ca.DM(v), ca.DM.zeros(n), ca.DM.zeros(n), ca.DM(past.pop("t", 0.0)), **past)
    return np.array(effect.torque(x, effect.named(ca.DM(effect.full(n)), n), EXACT)).ravel()


def test_the_curve_is_scipys_monotone_spline_and_goes_on_straight():
    from scipy.interpolate import PchipInterpolator

    v = np.linspace(-1.5, 1.5, 61)
    expected = PchipInterpolator(SPEED, TORQUE)(np.abs(v)) * np.sign(v)
    shown = torque_of(FrictionCurve(speed=SPEED, torque=TORQUE), v)
    np.testing.assert_allclose(shown, expected, atol=1e-12)
    far = torque_of(FrictionCurve(speed=SPEED, torque=TORQUE), np.array([2.5, 3.5]))
    assert far[1] - far[0] == pytest.approx(PchipInterpolator(SPEED, TORQUE).derivative()(1.5))
    falling = FrictionCurve(speed=[0, 1, 2], torque=[[3.0, 2.0, 1.0]])
    assert torque_of(falling, np.array([9.0])) == pytest.approx([1.0])


def test_a_curve_needs_speeds_that_ascend_from_nought():
    for speed in ([0.1, 0.5], [0.0, 0.5, 0.5], [0.0]):
        with pytest.raises(BadInput, match="ascend from 0"):
            FrictionCurve(speed=speed, torque=[[1.0] * len(speed)])
    with pytest.raises(BadInput, match="points"):
        FrictionCurve(speed=[0, 1], torque=[[1.0, 2.0, 3.0]])


def test_frictions_by_hand():
    v = np.array([-0.25, 0.0, 0.64])
    assert torque_of(AsymmetricFriction(tau_plus=0.5, tau_minus=0.3), v) == pytest.approx([-0.3, 0.0, 0.5])
    assert torque_of(PowerLawFriction(c=2.0, exponent=0.5), v) == pytest.approx([-1.0, 0.0, 1.6])
    warm = ThermalViscous(b=2.0, share=0.5, time_constant=10.0)
    assert torque_of(warm, v, t=10 * np.log(2)) == pytest.approx(2 * v * 0.75)
    assert torque_of(warm, v, warmth=ca.DM([1.0, 0.5, 0.0])) == pytest.approx(2 * v * [0.5, 0.75, 1.0])


@pytest.fixture(scope="module")
def swing():
    """A Panda that goes up and comes down again, then waits."""
    robot = load_robot("panda")
    time = np.linspace(0, 4, 401)
    u = np.clip(time / 3, 0, 1)
    share, rate = np.sin(np.pi * u) ** 2, np.where(time < 3, np.pi / 3 * np.sin(2 * np.pi * u), 0.0)
    bend = np.where(time < 3, 2 * np.pi**2 / 9 * np.cos(2 * np.pi * u), 0.0)
    start, way = np.array([0, 0.9, 0, -1.2, 0, 1.6, 0.7]), np.array([0, -0.9, 0, 0.2, 0, 0, 0])
    q, v, a = start + np.outer(share, way), np.outer(rate, way), np.outer(bend, way)
    return robot, Trajectory(robot.joints, time, q, v, a)


def energy(swing, *effects):
    robot, trajectory = swing
    return Scorer(robot, PowerModel("panda", (Standby(power=50.0), CopperLoss(r_over_kt2=1e-3), *effects))).energy(
        trajectory
    )


def test_a_link_gives_back_what_it_holds(swing):
    whole, none = energy(swing).total, energy(swing, Regeneration(efficiency=0.0)).total
    lost = none - whole
    assert lost > 3.0
    assert energy(swing, DcLink(capacity=0.0)).total == pytest.approx(none, abs=1e-9)
    assert energy(swing, DcLink(capacity=1e9)).total == pytest.approx(whole, abs=1e-9)
    # it comes down last and nothing moves afterwards: but for what the swing's own braking gives, nothing is used again
    small = energy(swing, DcLink(capacity=1.0)).total
    assert whole < small <= none


def test_a_store_by_hand():
    step, bus = np.full(6, 0.5), np.array([4.0, -6.0, -6.0, 2.0, 10.0, 10.0])
    supplied = DcLink.supplied(step, bus, 5.0)  # holds 3, then 5 of 6 J; gives 1, then 4 of 5 J
    assert supplied == pytest.approx([4.0, 0.0, 0.0, 0.0, 2.0, 10.0])


def test_only_one_says_what_becomes_of_negative_power():
    with pytest.raises(BadInput, match="both treat"):
        PowerModel("", (Regeneration(efficiency=0.5), DcLink(capacity=5.0)))


def test_a_hold_counts_after_the_motion_and_offsets_never(swing):
    base = energy(swing).total
    assert energy(swing, IdleHold(power=6.0, duration=0.5)).total - base == pytest.approx(3.0, abs=0.15)
    assert energy(swing, IdleHold(power=6.0, duration=5.0)).total - base == pytest.approx(6.0, abs=0.15)
    assert energy(swing, RunOffset(power=[3.0, -2.0])).total == pytest.approx(base, abs=1e-12)


def test_supply_and_iron_by_hand(swing):
    robot, trajectory = swing
    plain = Scorer(robot, PowerModel("", (Standby(power=50.0),))).filled(trajectory).power
    lossy = Scorer(robot, PowerModel("", (Standby(power=50.0), PsuLoss(affine=0.02, quadratic=1e-3)))).filled(
        trajectory
    )
    np.testing.assert_allclose(lossy.power, plain + 0.02 * np.abs(plain) + 1e-3 * plain**2, rtol=1e-12)
    iron = Scorer(robot, PowerModel("", (Standby(power=50.0), IronLoss(hysteresis=0.5, eddy=0.25)))).filled(trajectory)
    v = trajectory.velocity
    np.testing.assert_allclose(iron.power - plain, (0.5 * np.abs(v) + 0.25 * v**2).sum(axis=1), atol=1e-9)


def test_links_are_those_of_another_urdf(tmp_path):
    """The same torque as from a file whose inertials say the same."""
    import xml.etree.ElementTree as ET

    robot = load_robot("z1")
    tree = ET.parse(robot.urdf)
    child = {j.get("name"): j.find("child").get("link") for j in tree.getroot().findall("joint")}
    links = {link.get("name"): link for link in tree.getroot().findall("link")}
    mass = np.zeros(6)
    for j, joint in enumerate(robot.joints):
        inertial = links[child[joint]].find("inertial")
        if j in (1, 2, 4):  # links with nothing welded on
            inertial.find("mass").set("value", str(1.2 * float(inertial.find("mass").get("value"))))
            inertia = inertial.find("inertia")
            mass[j] = 1.0
            for key, value in inertia.attrib.items():
                inertia.set(key, str(1.2 * float(value)))
    tree.write(tmp_path / "other.urdf")
    plain = robot.body.tree()
    shift = [0.2 * on * link.mass for on, link in zip(mass, plain, strict=True)]
    turn = [0.2 * on * link.inertia[np.ix_([0, 1, 2], [0, 1, 2])][[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
            for on, link in zip(mass, plain, strict=True)]  # fmt: skip
    model = PowerModel("z1", (LinkInertia(mass=shift, com=np.zeros((6, 3)), inertia=turn),))
    rng = np.random.default_rng(0)
    q, v, a = rng.uniform(-1, 1, (5, 6)), rng.normal(size=(5, 6)), rng.normal(size=(5, 6))
    expected = load_robot(str(tmp_path / "other.urdf"), lock=robot.locked).body.torque(q, v, a)
    np.testing.assert_allclose(rigid_torque(model, robot.body, q, v, a), expected, rtol=1e-9, atol=1e-9)
    assert np.abs(expected - robot.body.torque(q, v, a)).max() > 0.1
    assert replace(robot, body=robot.body).body.with_links(
        *(np.stack([getattr(link, k) for link in plain]) for k in ("mass", "lever", "inertia"))
    ).plain is robot.body  # fmt: skip


def test_a_urdf_with_an_impossible_inertia_takes_deviations_of_its_links() -> None:
    """Such an inertia is used unchanged; a model of diagnose deviates from it."""
    panda = load_robot("panda").body
    mass, lever, inertia = (np.stack([getattr(x, k) for x in panda.tree()]) for k in ("mass", "lever", "inertia"))
    inertia[-1] = np.diag([-1e-10, 1e-3, 1e-3])
    odd = panda.with_links(mass, lever, inertia)
    np.testing.assert_array_equal(odd.tree()[-1].inertia, inertia[-1])


@pytest.mark.parametrize(("mass", "moment"), [(-100.0, 0.0), (0.0, -50.0)])
def test_links_that_no_body_has_are_refused(tmp_path, mass: float, moment: float) -> None:
    """By the plan and by check, with the file and the link: a negative mass would give energy."""
    path = tmp_path / "model.toml"
    links = LinkInertia(mass=mass, com=[np.zeros(3)], inertia=[[moment, 0, moment, 0, 0, moment]])
    PowerModel("z1", (links,)).save(path)
    with pytest.raises(BadInput, match=r"model.toml: the link of joint1 would have .* kg m\^2; expected 0 or more"):
        eo.optimize("z1", path, start=[0, 0.5, -0.5, 0, 0, 0], goal=[0.2, 0.5, -0.5, 0, 0, 0])
    (faults,) = eo.check(path).faults.values()
    assert "the link of joint1 would have" in faults[0]


def test_files_hold_them_all(tmp_path):
    model = PowerModel(
        "z1",
        (
            FrictionCurve(speed=SPEED, torque=[TORQUE] * 6), AsymmetricFriction(tau_plus=1.0, tau_minus=[0.5] * 6),
            PowerLawFriction(c=0.5, exponent=0.6), ThermalViscous(b=1.0, share=0.4, time_constant=60.0),
            PsuLoss(affine=0.02, quadratic=1e-4), IronLoss(hysteresis=0.1, eddy=0.2), DcLink(capacity=6.0),
            IdleHold(power=5.0, duration=1.0), RunOffset(power=[1.0, -1.0, 0.5]),
            LinkInertia(mass=[0.1] * 6, com=np.full((6, 3), 0.01), inertia=np.full((6, 6), 1e-3)),
        ),
    )  # fmt: skip
    model.save(tmp_path / "model.toml")
    assert load_model(tmp_path / "model.toml").effects == model.effects


def test_retiming_stays_convex_where_it_does():
    convex = {name for name, kind in BY_NAME.items() if kind.convex_in_retiming}
    assert {"asymmetric_friction", "dc_link", "link_inertia"} <= convex
    assert not convex & {"friction_curve", "power_law_friction", "thermal_viscous", "psu_loss", "iron_loss"}
