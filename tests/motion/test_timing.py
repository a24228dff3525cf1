"""Minimum-time timings and the timing law: exact in time, inside every limit, and clear where there is none."""

from dataclasses import replace

import numpy as np
import pytest
from poses import GOAL, MIDDLE, START, without_jerk
from scipy.integrate import quad

from energy_opt.effects import (
    Armature,
    CoulombFriction,
    FrictionCurve,
    LoadFriction,
    Standby,
    StribeckFriction,
    ViscousFriction,
)
from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Planner
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.base import Violation
from energy_opt.motion.path import JointPath, straight, through
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.motion.plan.choice import within_limits
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.timing.toppra import fastest
from energy_opt.numerics.bspline import greville
from energy_opt.power import PowerModel
from energy_opt.robot import Robot, load_robot


def with_friction(model: PowerModel) -> PowerModel:
    added = (
        CoulombFriction(tau_c=3.0),
        ViscousFriction(b=2.0),
        LoadFriction(mu=0.1),
        Armature(inertia=0.2),
        StribeckFriction(tau_s=1.0, v_s=0.1),
    )
    return PowerModel(model.robot, model.effects + added)


def inside(robot: Robot, model: PowerModel, timing: Timing, jerk: bool = False) -> float:
    """The worst use of any limit, as a fraction beyond the bound, from the trajectory's rows and Pinocchio's torque."""
    trajectory = timing.trajectory(robot.joints)
    q, v, a, j = trajectory.sample(trajectory.denser(10))
    limits = robot.limits
    torque = Scorer(robot, model).drive(q, v, a, np.zeros(len(q)))[0]
    worst = [np.abs(v) / limits.velocity, np.abs(a) / limits.acceleration, np.abs(torque) / limits.effort]
    if jerk:
        worst.append(np.abs(j) / limits.jerk)
    return max(float(x.max()) for x in worst) - 1


def test_time_along_the_path_is_exact() -> None:
    knots = np.linspace(0, 1, 31)
    g = greville(knots)
    timing = Timing(straight([0.0], [1.0]), knots, 4 * g * (1 - g) * (1 + 0.3 * np.sin(20 * g)))

    def pace(x: float) -> float:  # s = x^2 takes away the singularity at rest
        return 2 * x / np.sqrt(timing.speed(np.array([x * x]))[0][0])

    half = sum(quad(pace, *np.sqrt(knots[k : k + 2]), epsabs=1e-12)[0] for k in range(15))
    assert timing.times[15] == pytest.approx(half, rel=1e-10)
    time = np.linspace(0, timing.duration, 501)
    s, speed, acceleration = timing.at(time)
    assert timing.time_at(s) == pytest.approx(time, abs=1e-8)
    assert speed**2 == pytest.approx(timing.speed(s)[0], abs=1e-12)
    assert acceleration[1:-1] == pytest.approx(timing.speed(s)[1][1:-1], abs=1e-9)
    assert timing.slowed(3.0).duration == pytest.approx(3.0, abs=1e-12)


@pytest.mark.parametrize("path", [straight(START, GOAL), through(np.array([START, MIDDLE, GOAL]))])
def test_rows_are_consistent_and_dense(path: JointPath) -> None:
    knots = np.linspace(0, 1, 41)
    g = greville(knots)
    timing = Timing(path, knots, 2 * g * (1 - g))
    trajectory = timing.trajectory(tuple("abcdefg"))
    assert len(trajectory.time) >= 200 and np.diff(trajectory.time).max() <= 0.004 + 1.1e-9
    assert trajectory.duration == pytest.approx(timing.duration, abs=0.51e-9)  # whole nanoseconds
    dense = trajectory.denser(10)
    q, v, a, _ = trajectory.sample(dense)
    s, rate, acceleration = timing.slowed(trajectory.duration).at(dense)
    np.testing.assert_array_equal(np.round(trajectory.time * 1e9) / 1e9, trajectory.time)
    assert q == pytest.approx(path(s), abs=1e-12)
    assert v == pytest.approx(path(s, 1) * rate[:, None], abs=1e-8)
    assert a == pytest.approx(path(s, 1) * acceleration[:, None] + path(s, 2) * rate[:, None] ** 2, abs=1e-5)


@pytest.mark.parametrize("frictional", [False, True])
@pytest.mark.parametrize("path", [straight(START, GOAL), through(np.array([START, MIDDLE, GOAL]))])
def test_limits_hold_between_the_grid_points(
    panda: Robot, model: PowerModel, path: JointPath, frictional: bool
) -> None:
    law = with_friction(model) if frictional else model
    timing = fastest(without_jerk(panda), law, path)
    assert inside(panda, law, timing) < 1e-6
    assert inside(panda, law, timing) > -1e-2  # something binds, or it would not be the fastest
    gentle = fastest(panda, law, path)
    assert inside(panda, law, gentle, jerk=True) < 1e-5
    assert gentle.duration < 1.1 * timing.duration


def test_one_joint_bangs_at_its_acceleration(panda: Robot, model: PowerModel) -> None:
    goal = START + [0, 0, 0, 0, 0, 0, 0.2]  # too short to reach the velocity limit: T = 2 sqrt(d / a)
    timing = fastest(without_jerk(panda), model, straight(START, goal))
    assert timing.duration == pytest.approx(2 * np.sqrt(0.2 / 20.0), rel=2e-3)


def test_end_speeds_are_met(panda: Robot, model: PowerModel) -> None:
    timing = fastest(without_jerk(panda), model, replace(straight(START, GOAL), start_speed=0.5, end_speed=0.3))
    assert np.sqrt(timing.control[[0, -1]]) == pytest.approx([0.5, 0.3])
    assert inside(panda, model, timing) < 1e-6
    assert timing.duration < fastest(without_jerk(panda), model, straight(START, GOAL)).duration


@pytest.mark.parametrize("length", [1e-4, 1e-2])
def test_tiny_moves_work(panda: Robot, model: PowerModel, length: float) -> None:
    direction = (GOAL - START) / np.linalg.norm(GOAL - START)
    timing = fastest(without_jerk(panda), model, straight(START, START + length * direction))
    step = float(np.diff(timing.trajectory(panda.joints).time).min())
    assert inside(panda, model, timing) < 1e-6 + 0.5e-9 / step  # rows are half a nanosecond beside the knots


def test_a_move_of_no_length_holds(panda: Robot, model: PowerModel) -> None:
    timing = fastest(panda, model, straight(START, START))
    assert timing.slowed(2.0).trajectory(panda.joints).duration == pytest.approx(2.0)


def test_too_heavy_to_hold_is_found_before_solving(panda: Robot, model: PowerModel) -> None:
    weak = replace(panda, limits=panda.limits.replace(effort=np.full(7, 5.0)))
    with pytest.raises(Infeasible, match="slow motion needs") as caught:
        fastest(weak, model, straight(START, GOAL))
    error = caught.value
    assert error.limit == "effort" and error.joint in panda.joints
    assert error.excess is not None and error.excess > 0 and error.position is not None
    d = PathDynamics(weak, model, straight(START, GOAL), np.array([error.position]))
    held = abs(d.G[0, panda.joints.index(error.joint)])
    assert held / 5.0 - 1 == pytest.approx(error.excess)


def test_a_goal_outside_the_limits_is_named(panda: Robot, model: PowerModel) -> None:
    with pytest.raises(Infeasible, match="panda_joint6") as caught:
        fastest(panda, model, straight(START, GOAL + [0, 0, 0, 0, 0, 5, 0]))
    assert caught.value.limit == "position" and caught.value.position == 1.0


def test_an_end_speed_beyond_the_limits_is_named(panda: Robot, model: PowerModel) -> None:
    with pytest.raises(Infeasible) as caught:
        fastest(panda, model, replace(straight(START, GOAL), end_speed=50.0))
    assert caught.value.joint in panda.joints and caught.value.limit in ("velocity", "acceleration", "effort")


@pytest.mark.parametrize("seed", range(4))
def test_the_fastest_timing_of_a_curve_holds_the_limits_between_its_samples(panda: Robot, model, seed: int) -> None:
    """Accelerations exceeded their bounds by some millionths: jobs with steps that do not stop had no fastest cycle."""
    low, high = panda.limits.lower, panda.limits.upper
    points = low + (high - low) * np.random.default_rng(seed).uniform(0.25, 0.75, (4, 7))
    move, planner = Move(points[0], points[-1], "retime", path=through(points)), Planner(panda, model)
    fastest_motion = planner.slowed(move, planner.minimum_time(move))
    assert fastest_motion is not None and planner.certify(fastest_motion).violation <= 1e-6


def test_the_fastest_timing_around_a_post_is_slowed_until_it_holds_the_limits_at_the_sharp_bends() -> None:
    """The acceleration peaks at a bend between two points of the program, 0.4 % above its bound: it is slowed."""
    ur5e = load_robot("ur5e")
    start, goal = np.array([0.4, -1.3, 1.2, -2.1, -1.6, -1.1]), np.array([-1.1, -1.2, 1.8, -2.1, -1.6, -2.7])
    share = np.array([[0.0, 0.3, 0.33, 0.36, 0.4, 0.45, 0.5, 1.0]]).T
    around = 0.4 * np.exp(-(((share - 0.36) / 0.05) ** 2)) * [0.0, -1.0, 0.5, 0.3, 0.0, 0.0]
    path = through(start + share * (goal - start) + around)
    move, planner = Move(start, goal, "retime", path=path), Planner(ur5e, PowerModel("ur5e", (Standby(power=90.0),)))
    motion = planner.timing(move).trajectory(ur5e.joints)
    *_, v, a, j = motion.sample(motion.denser(10))
    worst = [np.abs(v) / ur5e.limits.velocity, np.abs(a) / ur5e.limits.acceleration, np.abs(j) / ur5e.limits.jerk]
    assert 0.98 < np.max(worst) < 1 + 1e-6


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_timing_slightly_too_fast_is_slowed_until_it_holds(order: int) -> None:
    timing = Timing(straight([0.0], [1.0]), np.array([0.0, 0.5, 1.0]), np.array([0.0, 1.0, 1.0, 0.0]))
    enough = 1.01 * timing.duration

    def judge(at: Timing) -> Certificate:
        return Certificate(2, (Violation("a", (enough / at.duration) ** order - 1, "j", 0.0, 1.0, 1.0),), 0.0)

    assert enough <= within_limits(timing, judge).duration < 1.01 * enough


@pytest.mark.parametrize(
    ("torque", "effort", "path"),
    [
        ([0, 8, 8], 38, straight(START, GOAL)), ([2, 2, 10], 38, straight(START, GOAL)),
        ([6, 2, 6], 37, straight(START, GOAL)), ([1, 3, 6], 40, straight(GOAL, START)),
        ([6, 3, 1], 44, straight(GOAL, START)), ([8, 0, 0], 46, straight(GOAL, START)),
    ],
)  # fmt: skip
def test_friction_near_the_effort_limit_is_timed(
    panda: Robot, model: PowerModel, torque: list[float], effort: float, path: JointPath
) -> None:
    """All were refused, some by blaming the acceleration: a tangent at high speed overstates friction at low speed."""
    robot = replace(panda, limits=panda.limits.replace(effort=np.array([effort] * 4 + [12.0] * 3)))
    loaded = model.replaced(FrictionCurve(speed=[0.0, 0.3, 1.0], torque=[torque] * 7))
    timing = fastest(robot, loaded, path)
    assert inside(robot, loaded, timing) < 1e-6 and timing.duration < 2
