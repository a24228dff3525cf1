"""Retiming: against closed forms, symmetries, limits, durations; what is called global and what local."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from poses import GOAL, MIDDLE, START, without_jerk

from energy_opt.effects import (
    BaseTilt,
    CopperLoss,
    CoulombFriction,
    Effect,
    GearEfficiency,
    LoadFriction,
    Payload,
    Regeneration,
    Standby,
    ViscousFriction,
)
from energy_opt.errors import Infeasible
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.path import JointPath, straight, through
from energy_opt.motion.retime.solve import GLOBAL_GAP, RetimeSolution, retime
from energy_opt.motion.timing.toppra import fastest
from energy_opt.power import PowerModel, source_method_2
from energy_opt.robot import Robot, load_robot

INERTIA, RESISTANCE = 0.8, 0.02
ONE_JOINT = f"""<robot name="wheel">
  <link name="base"/>
  <link name="rotor"><inertial><origin xyz="0 0 0"/><mass value="3"/>
    <inertia ixx="0.5" iyy="0.5" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="rotor"/><axis xyz="0 0 1"/>
    <limit lower="-6" upper="6" velocity="20" effort="100"/></joint>
</robot>"""


@pytest.fixture
def wheel(tmp_path: Path) -> Robot:
    """One joint about a vertical axis: gravity does no work, tau = I a. Neither acceleration nor jerk is bounded."""
    (tmp_path / "wheel.urdf").write_text(ONE_JOINT)
    robot, free = load_robot(str(tmp_path / "wheel.urdf")), np.full(1, np.inf)
    return replace(robot, limits=robot.limits.replace(acceleration=free, jerk=free))


def copper(power: float = 0.0) -> PowerModel:
    return PowerModel("wheel", (Standby(power=power), CopperLoss(r_over_kt2=RESISTANCE)))


def score(robot: Robot, model: PowerModel, found: RetimeSolution) -> float:
    return Scorer(robot, model).energy(found.trajectory).total


def slowed(robot: Robot, model: PowerModel, found: RetimeSolution) -> float:
    """Energy of the fastest timing, slowed evenly to the same duration."""
    timing = fastest(robot, model, found.timing.path).slowed(found.timing.duration)
    return Scorer(robot, model).energy(timing.trajectory(robot.joints)).total


def worst_use(robot: Robot, model: PowerModel, found: RetimeSolution) -> float:
    t = found.trajectory
    q, v, a, j = t.sample(t.denser(10))
    torque = Scorer(robot, model).drive(q, v, a, np.zeros(len(q)))[0]
    limits = robot.limits
    pairs = [(v, limits.velocity), (a, limits.acceleration), (j, limits.jerk), (torque, limits.effort)]
    return max(float((np.abs(value) / bound).max()) for value, bound in pairs) - 1


def test_one_joint_follows_the_cubic(wheel: Robot) -> None:
    angle, duration = 1.5, 1.2
    found = retime(wheel, copper(), straight([0.2], [0.2 + angle]), duration=duration)
    best = 12 * RESISTANCE * INERTIA**2 * angle**2 / duration**3
    assert 100 * found.gap <= GLOBAL_GAP and found.converged
    assert found.energy == pytest.approx(best, rel=2e-4) and found.energy >= best * (1 - 1e-9)
    assert score(wheel, copper(), found) == pytest.approx(found.energy, rel=1e-6)
    assert found.trajectory.duration == pytest.approx(duration, abs=1e-9)
    x = found.trajectory.time / duration
    assert found.trajectory.position[:, 0] == pytest.approx(0.2 + angle * x**2 * (3 - 2 * x), abs=1e-4 * angle)


def test_one_joint_stops_where_standby_and_copper_balance(wheel: Robot) -> None:
    angle, power = 1.5, 2.0
    found = retime(wheel, copper(power), straight([0.0], [angle]))
    # d/dT (P T + 12 r I^2 d^2 / T^3) = 0
    duration = (36 * RESISTANCE * INERTIA**2 * angle**2 / power) ** 0.25
    assert found.timing.duration == pytest.approx(duration, rel=1e-3)
    assert found.energy == pytest.approx(4 / 3 * power * duration, rel=2e-4)
    capped = retime(wheel, copper(power), straight([0.0], [angle]), max_duration=0.8 * duration)
    assert capped.trajectory.duration == pytest.approx(0.8 * duration, rel=1e-5)
    assert capped.energy > found.energy and 100 * capped.gap <= GLOBAL_GAP


def test_without_standby_a_free_duration_ends_somewhere(wheel: Robot) -> None:
    found = retime(wheel, copper(), straight([0.0], [1.0]))
    assert "still falls with the duration" in found.message
    shortest = fastest(wheel, copper(), found.timing.path).duration
    assert found.timing.duration == pytest.approx(50 * shortest, rel=1e-3)


@pytest.mark.parametrize("share", [1.2, 1.5, 2.5])
@pytest.mark.parametrize(
    "path", [straight(START, GOAL), straight(GOAL, START), through(np.array([START, MIDDLE, GOAL]))]
)
def test_exact_durations_beat_even_slowing(panda: Robot, model: PowerModel, path: JointPath, share: float) -> None:
    shortest = fastest(without_jerk(panda), model, path)
    found = retime(panda, model, path, shortest=shortest, duration=share * shortest.duration)
    assert found.converged
    assert found.trajectory.duration == pytest.approx(share * shortest.duration, abs=1e-9)
    assert score(panda, model, found) == pytest.approx(found.energy, rel=1e-5)
    assert found.energy <= slowed(panda, model, found) * (1 + 1e-9)
    assert worst_use(panda, model, found) < 1e-6
    assert found.lower_bound is not None and found.lower_bound <= found.energy
    assert found.gap < 0.02


def test_mirrored_in_time_the_loss_is_the_same(wheel: Robot) -> None:
    forth = retime(wheel, copper(1.0), straight([0.0], [1.3]), duration=1.1)
    back = retime(wheel, copper(1.0), straight([1.3], [0.0]), duration=1.1)
    assert forth.energy == pytest.approx(back.energy, rel=1e-7)


def test_gravity_makes_the_way_up_as_costly_as_the_way_down_plus_its_work(panda: Robot, model: PowerModel) -> None:
    """Reversing a motion keeps all torques of the source model, so that only the stored energy changes its sign."""
    duration = 1.5 * fastest(without_jerk(panda), model, straight(START, GOAL)).duration
    up = retime(panda, model, straight(START, GOAL), duration=duration)
    down = retime(panda, model, straight(GOAL, START), duration=duration)
    stored = Scorer(panda, model).stored(up.trajectory)
    assert up.energy - stored == pytest.approx(down.energy + stored, rel=1e-5)


def test_tilting_the_base_about_gravity_changes_nothing(panda: Robot, model: PowerModel) -> None:
    tilted = PowerModel("panda", (*model.effects, BaseTilt(roll=0.0, pitch=0.0)))
    plain = retime(panda, model, straight(START, GOAL), duration=1.4)
    assert retime(panda, tilted, straight(START, GOAL), duration=1.4).energy == pytest.approx(plain.energy, rel=1e-9)
    turned = START + [0.7, 0, 0, 0, 0, 0, 0], GOAL + [0.7, 0, 0, 0, 0, 0, 0]  # about the vertical first axis
    assert retime(panda, model, straight(*turned), duration=1.4).energy == pytest.approx(plain.energy, rel=1e-6)


def test_a_payload_costs(panda: Robot, model: PowerModel) -> None:
    loaded = PowerModel("panda", (*model.effects, Payload(mass=2.0, com=[0, 0, 0.1])))
    path = straight(START, GOAL)
    found = retime(panda, loaded, path, duration=1.6)
    assert found.energy > retime(panda, model, path, duration=1.6).energy
    assert score(panda, loaded, found) == pytest.approx(found.energy, rel=1e-5)


@pytest.mark.parametrize("level", ["bus", "joint"])
def test_without_regeneration_it_stays_global(panda: Robot, model: PowerModel, level: str) -> None:
    law = PowerModel("panda", (*model.effects, Regeneration(efficiency=0.2, level=level), CoulombFriction(tau_c=2.0)))
    found = retime(panda, law, straight(GOAL, START), max_duration=2.5)
    assert 100 * found.gap <= GLOBAL_GAP and found.converged
    assert score(panda, law, found) == pytest.approx(found.energy, rel=1e-4)
    assert found.energy <= slowed(panda, law, found)


@pytest.mark.parametrize("effect", [ViscousFriction(b=4.0), LoadFriction(mu=0.1), GearEfficiency(eta=0.8)])
def test_friction_that_may_spoil_convexity_is_local(panda: Robot, model: PowerModel, effect: Effect) -> None:
    law = PowerModel("panda", (*model.effects, effect))
    found = retime(panda, law, straight(START, GOAL), duration=1.6)
    assert found.lower_bound is None
    assert found.energy < slowed(panda, law, found)
    assert worst_use(panda, law, found) < 1e-6


def test_jerk_limits_hold_and_end_the_claim(panda: Robot, model: PowerModel) -> None:
    tight = replace(panda, limits=panda.limits.replace(jerk=panda.limits.jerk / 50))
    path = straight(START, GOAL)
    shortest = fastest(tight, model, path)
    found = retime(tight, model, path, max_duration=shortest.duration)
    assert found.converged and found.lower_bound is None
    assert found.timing.duration > fastest(without_jerk(tight), model, path).duration * 1.002
    assert worst_use(tight, model, found) < 1e-5
    assert found.energy <= slowed(tight, model, found) * (1 + 1e-6)


def test_end_speeds_are_kept(panda: Robot, model: PowerModel) -> None:
    path = straight(START, GOAL)
    shortest = fastest(without_jerk(panda), model, replace(path, start_speed=0.4, end_speed=0.2))
    for duration in (None, 1.4 * shortest.duration):
        found = retime(panda, model, path, shortest=shortest, duration=duration)
        assert found.converged
        assert found.trajectory.velocity[0] == pytest.approx(0.4 * (GOAL - START))
        assert found.trajectory.velocity[-1] == pytest.approx(0.2 * (GOAL - START))
        if duration:
            assert found.trajectory.duration == pytest.approx(duration, abs=1e-9)


@pytest.mark.parametrize(("share", "named", "power"), [(1.0, "acceleration", 2), (0.2, "velocity", 1)])
def test_too_short_a_duration_says_what_would_work(
    panda: Robot, model: PowerModel, share: float, named: str, power: int
) -> None:
    """And the limit that binds for most of the time: accelerations at high speed limits."""
    path, robot = straight(START, GOAL), without_jerk(panda)
    limits = joint_limits(replace(robot.limits, velocity=share * robot.limits.velocity))
    shortest = fastest(robot, model, path, limits=limits).duration
    for wish in ({"duration": 0.6 * shortest}, {"max_duration": 0.6 * shortest}):
        with pytest.raises(Infeasible, match="shortest duration") as caught:
            retime(panda, model, path, limits=limits, **wish)
        error = caught.value
        assert error.joint in panda.joints and error.limit == "duration"
        assert 0 < error.time < 0.6 * shortest and f"at {error.time:.4g} s" in str(error)
        assert error.shortest_duration == pytest.approx(shortest, rel=2e-3)
        assert f"{named} limit" in str(error)  # a speed is as many times too high as the time is too short
        ratio = error.shortest_duration / (0.6 * shortest)
        assert error.excess == pytest.approx(ratio**power - 1, rel=1e-3)
    assert error.shortest_duration is not None
    assert retime(panda, model, path, limits=limits, duration=error.shortest_duration * (1 + 1e-4)).converged


@pytest.mark.parametrize("length", [0.0, 1e-4])
def test_degenerate_moves(panda: Robot, model: PowerModel, length: float) -> None:
    goal = START + length * (GOAL - START) / np.linalg.norm(GOAL - START)
    found = retime(panda, model, straight(START, goal), duration=0.5)
    assert found.converged and found.trajectory.duration == pytest.approx(0.5, abs=1e-9)
    assert score(panda, model, found) == pytest.approx(found.energy, rel=1e-5)
    assert found.energy > 88.04 * 0.5


@pytest.mark.parametrize("direction", [np.eye(7)[0], np.eye(7)[3], np.ones(7)])
def test_tiny_moves_are_solved_at_free_duration(panda: Robot, model: PowerModel, direction: np.ndarray) -> None:
    planner = Planner(panda, model, Settings(compile="never"))
    result = planner.solve(Move(START, START + 1e-4 * direction, mode="retime"))
    assert result.status == "solved" and result.certificate.valid
    # TOPP-RA knows no jerk and is slowed until it holds: standing power is saved by being faster than that
    assert result.trajectory.duration < 0.8 * fastest(panda, model, straight(START, START + 1e-4 * direction)).duration
    toppra = result.baseline("toppra")
    assert toppra.valid
    assert result.energy.total <= toppra.energy.total


def test_a_long_move_at_six_times_the_minimum_time_is_solved(panda: Robot, model: PowerModel) -> None:
    room = 0.02 * (panda.limits.upper - panda.limits.lower)
    path = straight(panda.limits.lower + room, panda.limits.upper - room)
    shortest = fastest(panda, model, path)
    found = retime(panda, model, path, shortest=shortest, duration=6 * shortest.duration)
    assert found.converged and not found.message
    assert found.energy < 0.999 * slowed(panda, model, found)
    assert found.gap < 0.01
    assert worst_use(panda, model, found) < 1e-6


def test_with_a_jerk_limit_between_its_own_optimum_and_a_slowed_toppra(ur5: Robot) -> None:
    """The baseline is truly near time-optimal, and every duration from there on is solved, within limits."""
    jerk = np.full(ur5.n, np.inf)
    jerk[0] = 100.0
    robot = replace(ur5, limits=ur5.limits.replace(jerk=jerk))
    start, goal = np.array([0.3, -1.2, 1.0, -0.5, 0.4, 0.1]), np.array([-0.9, -0.4, 0.3, 0.6, -0.2, 0.5])
    model = source_method_2("ur5")
    planner = Planner(robot, model, Settings(compile="never"))
    quickest = planner.minimum_time(Move(start, goal, "retime"))
    slowed = fastest(robot, model, straight(start, goal)).duration
    assert quickest < 0.9 * slowed
    free = planner.solve(Move(start, goal, "retime"))
    assert free.baseline("toppra").valid and free.energy.total <= free.baseline("scaled").energy.total + 1e-9
    for duration in np.linspace(1.01 * quickest, 1.05 * slowed, 5):
        found = planner.solve(Move(start, goal, "retime", duration=duration))
        assert found.status == "solved" and found.certificate.valid
        assert found.trajectory.duration == pytest.approx(duration)
        assert found.baseline("scaled").valid and found.saving["joules"] >= -1e-9
    with pytest.raises(Infeasible) as short:
        planner.solve(Move(start, goal, "retime", duration=0.9 * quickest))
    assert short.value.shortest_duration == pytest.approx(quickest, rel=1e-3)
