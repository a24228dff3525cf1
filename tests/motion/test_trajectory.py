"""Trajectories: the curve between rows, and the energy of a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from energy_opt.effects import BY_NAME
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.standstills import standstills
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel, source_method_2
from energy_opt.robot import PointMass, load_robot

JOINTS = ("a", "b")


def wave(rows: int) -> Trajectory:
    """sin(t) and t^5 / 100 - t^2 over 2 s."""
    t = np.linspace(1.0, 3.0, rows)
    q = np.column_stack([np.sin(t), t**5 / 100 - t**2])
    v = np.column_stack([np.cos(t), t**4 / 20 - 2 * t])
    a = np.column_stack([-np.sin(t), t**3 / 5 - 2])
    return Trajectory(JOINTS, t, q, v, a)


def test_the_curve_is_the_quintic_through_the_rows() -> None:
    curve = wave(21)
    t = np.linspace(1.0, 3.0, 501)
    q, v, a, jerk = curve.sample(t)
    np.testing.assert_allclose(q[:, 1], t**5 / 100 - t**2, atol=1e-12)  # a quintic is met exactly
    np.testing.assert_allclose(v[:, 1], t**4 / 20 - 2 * t, atol=1e-11)
    np.testing.assert_allclose(a[:, 1], t**3 / 5 - 2, atol=1e-9)
    np.testing.assert_allclose(jerk[:, 1], 3 * t**2 / 5, atol=1e-7)
    np.testing.assert_allclose(q[:, 0], np.sin(t), atol=1e-10)  # error of order h^6
    rows = curve.sample(curve.time)
    for got, expected in zip(rows, (curve.position, curve.velocity, curve.acceleration), strict=False):
        np.testing.assert_allclose(got, expected, atol=1e-12)


def test_denser_grid_holds_the_rows() -> None:
    curve = wave(6)
    grid = curve.denser(10)
    assert len(grid) == 51 and (np.diff(grid) > 0).all()
    np.testing.assert_array_equal(grid[::10], curve.time)


def test_slowing_keeps_the_path() -> None:
    curve = wave(11)
    slow = curve.slowed(5.0)
    assert slow.duration == pytest.approx(5.0)
    share = np.linspace(0, 1, 40)
    q, v, a, _ = curve.sample(curve.time[0] + share * curve.duration)
    q2, v2, a2, _ = slow.sample(slow.time[0] + share * slow.duration)
    np.testing.assert_allclose(q2, q, atol=1e-12)
    np.testing.assert_allclose(v2 * 2.5, v, atol=1e-11)
    np.testing.assert_allclose(a2 * 2.5**2, a, atol=1e-9)


def swing(name: str, seconds: float = 1.5) -> Trajectory:
    """A rest-to-rest quintic of all joints of a robot, away from its first limits."""
    robot = load_robot(name)
    middle = (np.nan_to_num(robot.limits.lower, neginf=-1) + np.nan_to_num(robot.limits.upper, posinf=1)) / 2
    x = np.linspace(0, 1, 101)[:, None]
    shape, slope, bend = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - 3 * x + 2 * x**2)
    delta = np.linspace(0.3, 0.6, robot.n) * (-1) ** np.arange(robot.n)
    q, v, a = middle + shape * delta, slope * delta / seconds, bend * delta / seconds**2
    return Trajectory(robot.joints, x[:, 0] * seconds, q, v, a)


@pytest.mark.parametrize("name", ["panda", "ur5e", "kinova"])
def test_energy_of_the_source_model_against_a_plain_sum(name: str) -> None:
    """Trapezoids over 20001 samples of tau.v + r |tau|^2 + p0, with nothing of the scorer in them."""
    robot, motion = load_robot(name), swing(name)
    model = PowerModel(name, (BY_NAME["standby"](power=88.04), BY_NAME["copper_loss"](r_over_kt2=0.0036)))
    energy = Scorer(robot, model).energy(motion)
    t = np.linspace(0, motion.duration, 20001)
    q, v, a, _ = motion.sample(t)
    tau = robot.body.torque(q, v, a)
    power = np.sum(tau * v, axis=1) + 0.0036 * np.sum(tau**2, axis=1) + 88.04
    assert energy.total == pytest.approx(np.sum((power[1:] + power[:-1]) / 2 * np.diff(t)), rel=1e-7)
    assert energy.standby == pytest.approx(88.04 * 1.5, rel=1e-12)
    assert energy.loss == pytest.approx(energy.by_effect["copper_loss"], rel=1e-6, abs=1e-7)
    assert energy.stored == pytest.approx(energy.by_effect["mechanical"], abs=1e-7)  # between two states of rest


def test_energy_adds_up_with_every_effect() -> None:
    model = PowerModel(
        "panda",
        (
            BY_NAME["standby"](power=80.0),
            BY_NAME["copper_loss"](r_over_kt2=0.004),
            BY_NAME["coulomb_friction"](tau_c=1.5),
            BY_NAME["viscous_friction"](b=2.0),
            BY_NAME["armature"](inertia=0.2),
            BY_NAME["gravity_spring"](stiffness=3.0, rest=0.1),
            BY_NAME["payload"](mass=2.0, com=[0.0, 0.02, 0.1]),
            BY_NAME["base_tilt"](roll=0.1, pitch=-0.2),
            BY_NAME["regeneration"](efficiency=0.4, level="joint"),
            BY_NAME["inverter_loss"](c=0.1),
            BY_NAME["motion_power"](power=6.0),
            BY_NAME["supply_efficiency"](eta=0.9),
        ),
    )
    energy = Scorer(load_robot("panda"), model).energy(swing("panda"))
    assert set(energy.by_effect) == {e.name for e in model.effects} | {"mechanical"}
    assert sum(energy.by_effect.values()) == pytest.approx(energy.total, rel=1e-12)
    assert energy.standby + energy.stored + energy.loss == pytest.approx(energy.total, rel=1e-12)


@pytest.mark.parametrize(
    "effect", [{"armature": {"inertia": 0.3}}, {"gravity_spring": {"stiffness": 5.0, "rest": 0.4}}]
)
def test_what_only_stores_energy_loses_none(effect: dict[str, dict[str, float]]) -> None:
    """Rotors and springs give back what they take: without losses the work is the change of stored energy."""
    model = PowerModel("ur5e", tuple(BY_NAME[name](**values) for name, values in effect.items()))
    energy = Scorer(load_robot("ur5e"), model).energy(swing("ur5e"))
    assert energy.loss == pytest.approx(0.0, abs=1e-6) and abs(energy.stored) > 1


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_turning_gravity_and_robot_together_changes_nothing(name: str) -> None:
    """A rolled base, and one pitched as far with the upright first joint a quarter turn on, feel alike."""
    robot, motion = load_robot(name), swing(name)
    turned = replace(motion, position=motion.position + np.pi / 2 * np.eye(robot.n)[0])
    tilt, model = BY_NAME["base_tilt"], source_method_2(name)
    rolled = Scorer(robot, model.replaced(tilt(roll=0.3, pitch=0.0))).energy(motion)
    pitched = Scorer(robot, model.replaced(tilt(roll=0.0, pitch=0.3))).energy(turned)
    upright = Scorer(robot, model).energy(motion)
    assert pitched.total == pytest.approx(rolled.total, rel=1e-12)
    assert abs(upright.total - rolled.total) > 0.1
    assert Scorer(robot, model).energy(turned).total == pytest.approx(upright.total, rel=1e-12)


def test_the_dense_grid_is_the_curve_itself():
    """What is sampled for all rows at once is what is sampled place by place; its integral is Gauss'."""
    motion, robot = swing("panda"), load_robot("panda")
    scorer = Scorer(robot, source_method_2())
    for factor in (2, 10):
        dense, time = scorer.dense(motion, factor), motion.denser(factor)
        sampled = motion.sample_denser(factor)
        assert all((x == y).all() for x, y in zip((dense.q, dense.v, dense.a), sampled[:3], strict=True))
        for here, there in zip(sampled, motion.sample(time), strict=True):
            assert np.abs(here - there).max() <= 1e-9 * (1 + np.abs(there).max())
        tau, power, _ = scorer.drive(*motion.sample(time)[:3], time - time[0])
        assert np.allclose(dense.effort, tau, atol=1e-9) and np.allclose(dense.power, power, atol=1e-7)
    x, w = np.polynomial.legendre.leggauss(4)
    step = np.diff(motion.time)
    time = (motion.time[:-1, None] + step[:, None] * (x + 1) / 2).ravel()
    power = scorer.drive(*motion.sample(time)[:3], time - time[0])[1]
    assert scorer.energy(motion).total == pytest.approx((step[:, None] * w / 2).ravel() @ power, rel=1e-9)


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_inverse_dynamics_of_many_states_is_that_of_each(name):
    body, rng = load_robot(name).body, np.random.default_rng(1)
    q, v, a = rng.normal(size=(3, 200, body.n))
    load = PointMass(1.5, np.array([0.0, 0.02, 0.1]))
    for payload, gravity in ((None, None), (load, np.array([1.0, 0.0, -9.0]))):
        each = np.vstack([body.torque(*state, payload, gravity) for state in zip(q, v, a, strict=True)])
        assert np.array_equal(body.torque(q, v, a, payload, gravity), each)


def test_a_long_motion_is_judged_block_by_block_to_the_same_end(panda, model, monkeypatch):
    from energy_opt.effects import WindingTemperature
    from energy_opt.motion.judge import certificate, energy
    from energy_opt.motion.limits.registry import joint_limits

    t = np.linspace(5, 8, 301)  # time does not begin at 0: laws of time go on from block to block
    waves = np.arange(1, 8)
    x = t[:, None] * waves
    q = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785]) + 0.1 * np.sin(x)
    motion = Trajectory(panda.joints, t, q, 0.1 * waves * np.cos(x), -0.1 * waves**2 * np.sin(x))
    scorer = Scorer(panda, model + WindingTemperature(rate=0.3, time_constant=2.0))
    whole = certificate.certify(motion, scorer, joint_limits(panda.limits))
    monkeypatch.setattr(energy, "BLOCK", 170)
    parts = certificate.certify(motion, scorer, joint_limits(panda.limits))
    assert parts.max_violation == pytest.approx(whole.max_violation, abs=2e-10)  # of peaks that recur, either
    assert (parts.samples, parts.proven, parts.peak_power) == (whole.samples, whole.proven, whole.peak_power)


def test_a_mean_over_time_is_smoother_and_nowhere_faster() -> None:
    """Against a fine numerical mean; a jump of the acceleration becomes a jerk of that over the width."""
    x = np.linspace(0, 1, 41)[:, None]
    q, v, a = x**2 * (3 - 2 * x), 6 * x * (1 - x), 6 - 12 * x
    there = Trajectory(("a",), x[:, 0], q, v, a)
    width = 0.02
    out = there.averaged(width)
    assert out.duration == pytest.approx(1.02, abs=1e-12) and (np.diff(out.time) > 0).all()
    for at in (0.003, 0.0137, 0.5, 1.004, 1.017):
        s = np.linspace(at - width, at, 200_001)
        mean = np.trapezoid(there.sample(np.clip(s, 0, 1))[0][:, 0], s) / width
        assert out.sample(np.array([at]))[0][0, 0] == pytest.approx(mean, abs=1e-10)
    _, v1, a1, j1 = out.sample(out.denser(10))
    assert np.abs(v1).max() <= 1.5 and np.abs(a1).max() <= 6 * (1 + 1e-9)
    assert np.abs(j1).max() == pytest.approx(6 / width, rel=1e-3)


def test_a_mean_over_microseconds_late_in_a_cycle_keeps_the_jerk() -> None:
    """Errors of time are errors of position times so many per width: the jerk came to 25 times what it is."""
    end, acceleration, width = 9.1979, 0.00655, 8.1e-5
    time = np.linspace(0, end, 2300)
    a, v = np.full((2300, 1), acceleration), acceleration * (time - end)[:, None]
    out = Trajectory(("a",), time, 1.872117 + v**2 / acceleration / 2, v, a).on_nanoseconds().averaged(width)
    jerk = out.sample(np.linspace(end + 1e-7, end + width - 1e-7, 50))[3]
    assert np.abs(jerk).max() == pytest.approx(acceleration / width, rel=0.02)


def test_a_mean_over_time_is_exactly_at_rest_with_the_motion() -> None:
    x = np.linspace(0, 1, 41)[:, None]
    q, v, a = x**2 * (3 - 2 * x) / 3 + 0.1, 2 * x * (1 - x), 2 - 4 * x
    time = np.concatenate([x[:, 0], 1 + x[1:, 0], 2 + x[1:, 0]])  # there, a wait of a second, and on
    waits = np.zeros((40, 1))
    q = np.vstack([q, np.repeat(q[-1:], 40, axis=0), q[1:] + 1 / 3])
    out = Trajectory(("a",), time, q, np.vstack([v, waits, v[1:]]), np.vstack([a * (x < 1), waits, a[1:]])).averaged(
        0.02
    )
    inside = (out.time >= 1.025) & (out.time <= 1.97)
    assert inside.sum() > 70 and (out.position[inside] == q[40]).all() and not out.velocity[inside].any()
    assert out.time[(out.position == q[40]).all(axis=1)].min() > 1 and not out.acceleration[inside].any()


def test_a_mean_over_microseconds_has_no_pause() -> None:
    x = np.linspace(0, 1, 41)[:, None]
    out = Trajectory(("a",), x[:, 0], x**2 * (3 - 2 * x), 6 * x * (1 - x), 6 - 12 * x).averaged(4e-6)
    inside = (out.time > 0.01) & (out.time < 0.99)
    assert out.velocity[inside].min() > 0.05


def test_energy_follows_samples_that_are_changed_in_place() -> None:
    robot = load_robot("ur5")
    time = np.linspace(0.0, 1.0, 51)[:, None] * np.ones(robot.n)
    motion = Trajectory(robot.joints, time[:, 0], 0.5 * time**2, time.copy(), np.ones_like(time))
    scorer = Scorer(robot, source_method_2())
    before = scorer.energy_of(scorer.dense(motion)).total
    motion.position[:] *= 0.5
    motion.velocity[:] *= 0.5
    motion.acceleration[:] *= 0.5
    again = Trajectory(robot.joints, time[:, 0].copy(), 0.25 * time**2, 0.5 * time, np.full_like(time, 0.5))
    after = scorer.energy_of(scorer.dense(motion)).total
    assert after == scorer.energy(again).total != before


def test_a_gentle_start_is_no_standstill() -> None:
    """Its first 0.2 s are slower than a thousandth of the top speed; a wait before it ends where it begins."""
    t = np.linspace(0, 2, 401)
    u, wait = t / 2, np.linspace(0, 0.5, 101)[:-1]
    q, v, a = (x[:, None] for x in (u**4, 2 * u**3, 3 * u**2))
    assert len(standstills(Trajectory(("a",), t, q, v, a))) == 0
    still = np.zeros((len(wait), 1))
    both = Trajectory(("a",), np.r_[wait, 0.5 + t], *(np.vstack([still, x]) for x in (q, v, a)))
    assert standstills(both) == pytest.approx(np.array([[0.0, 0.5]]))
