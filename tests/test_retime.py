"""Retiming: against closed forms, an independent cone program, symmetries and limits; bounds that can be trusted."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from energy_opt.effects import (
    BaseTilt,
    CopperLoss,
    CoulombFriction,
    Payload,
    Regeneration,
    Standby,
    SupplyEfficiency,
    ViscousFriction,
)
from energy_opt.errors import Infeasible
from energy_opt.motion.path import JointPath, straight, through
from energy_opt.motion.path_dynamics import PathDynamics, SharedByStructure
from energy_opt.motion.retime import RetimeSolution, retime
from energy_opt.motion.retime_bound import largest_price
from energy_opt.motion.retime_grid import lift, quadrature
from energy_opt.motion.retime_law import PathLaw
from energy_opt.motion.retime_limits import point_numbers
from energy_opt.motion.retime_points import Jerk, Torque
from energy_opt.motion.retime_problem import Program
from energy_opt.motion.retime_rows import CurvedRows, LinearRows, Rows
from energy_opt.motion.retime_terms import compressed, law_function
from energy_opt.motion.score import Scorer
from energy_opt.motion.timing import fastest
from energy_opt.motion.timing_law import Timing, greville
from energy_opt.power import PowerModel, source_method_2
from energy_opt.robot import Robot, load_robot

START = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
GOAL = np.array([1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4])
MIDDLE = (START + GOAL) / 2 + [0.1, -0.3, 0.2, 0.1, 0, 0.2, 0.3]
INERTIA, RESISTANCE = 0.8, 0.02
ONE_JOINT = f"""<robot name="wheel">
  <link name="base"/>
  <link name="rotor"><inertial><origin xyz="0 0 0"/><mass value="3"/>
    <inertia ixx="0.5" iyy="0.5" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="rotor"/><axis xyz="0 0 1"/>
    <limit lower="-6" upper="6" velocity="20" effort="100"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def panda() -> Robot:
    return load_robot("panda")


@pytest.fixture(scope="module")
def ur5() -> Robot:
    return load_robot("ur5")


@pytest.fixture(scope="module")
def model() -> PowerModel:
    return source_method_2()


@pytest.fixture
def wheel(tmp_path: Path) -> Robot:
    """One joint about a vertical axis: gravity does no work, tau = I a."""
    (tmp_path / "wheel.urdf").write_text(ONE_JOINT)
    return load_robot(str(tmp_path / "wheel.urdf"))


def copper(power: float = 0.0) -> PowerModel:
    return PowerModel("wheel", (Standby(power=power), CopperLoss(r_over_kt2=RESISTANCE)))


def score(robot: Robot, model: PowerModel, found: RetimeSolution) -> float:
    return Scorer(robot, model).energy(found.trajectory).total


def slowed(robot: Robot, model: PowerModel, found: RetimeSolution) -> float:
    """Energy of the fastest timing, slowed evenly to the same duration."""
    timing = found.fastest.slowed(found.timing.duration)
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
    assert found.kind == "global" and found.converged
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
    assert capped.energy > found.energy and capped.kind == "global"


def test_without_standby_a_free_duration_ends_somewhere(wheel: Robot) -> None:
    found = retime(wheel, copper(), straight([0.0], [1.0]))
    assert "still falls with the duration" in found.message
    assert found.timing.duration == pytest.approx(50 * found.fastest.duration, rel=1e-3)


@pytest.mark.parametrize("path", [straight(START, GOAL), through(np.array([START, MIDDLE, GOAL]))])
@pytest.mark.parametrize("mode", ["free", "exact"])
def test_against_a_cone_program(ur5: Robot, path: JointPath, mode: str) -> None:
    """The same spline space and limits at the same points, posed for cvxpy and solved by Clarabel."""
    cp = pytest.importorskip("cvxpy")
    model = PowerModel("ur5", (Standby(power=88.04), CopperLoss(r_over_kt2=0.0036), CoulombFriction(tau_c=2.0)))
    path = JointPath(path.knots, path.coefficients[:, :, :6])  # the first six coordinates, on a six-axis arm
    shortest = fastest(ur5, model, path, grid=60, jerk=False)
    duration = 1.1 * shortest.duration
    found = retime(ur5, model, path, shortest=shortest, duration=duration if mode == "exact" else None)
    assert found.kind == "global"

    grid = quadrature(shortest.knots, (True, True))
    d = PathDynamics(ur5, model, path, grid.s)
    maps = lift(shortest.knots, grid.s).maps
    first = lift(shortest.knots, grid.s).first
    count, m, n = len(shortest.control), len(grid.s), 6
    to_a, to_b = np.zeros((m, count)), np.zeros((m, count))
    for k in range(3):
        to_a[np.arange(m), first + k] = maps[0, :, k]
        to_b[np.arange(m), first + k] = maps[1, :, k]
    c, root, u = cp.Variable(count), cp.Variable(m), cp.Variable(m)
    unit = shortest.control.max()
    a, b = unit * (to_a @ c), unit * (to_b @ c)
    friction = 2.0 * np.sign(d.q1)
    tau = [cp.multiply(d.M[:, j], a) + cp.multiply(d.C[:, j], b) + d.G[:, j] + friction[:, j] for j in range(n)]
    constraints = [c[0] == 0, c[-1] == 0, b >= 0, root <= cp.sqrt(to_b @ c)]
    for j in range(n):
        constraints += [cp.abs(tau[j] / ur5.limits.effort[j]) <= 1]
        constraints += [cp.multiply((d.q1[:, j] / ur5.limits.velocity[j]) ** 2, b) <= 1]
    # u >= |tau / size|^2 / root as a rotated cone
    size = 50.0
    stacked = cp.vstack([*(2 * x / size for x in tau), u - root])
    constraints += [cp.SOC(u + root, stacked, axis=0)]
    clock = grid.weight / np.sqrt(unit)
    time = clock @ cp.inv_pos(root)
    accuracy = {"tol_gap_rel": 1e-7, "tol_gap_abs": 1e-7, "tol_feas": 1e-7}
    work = grid.weight @ sum(cp.multiply(d.q1[:, j], tau[j]) for j in range(n))
    loss = work + 0.0036 * size**2 * (clock @ u)
    if mode == "exact":
        constraints.append(time <= duration)
        problem = cp.Problem(cp.Minimize(loss), constraints)
        best = problem.solve(solver="CLARABEL", **accuracy) + 88.04 * duration
    else:
        best = cp.Problem(cp.Minimize(loss + 88.04 * time), constraints).solve(solver="CLARABEL", **accuracy)
    assert found.energy == pytest.approx(best, rel=1e-4)


def test_the_bound_is_below_everything_that_is_feasible(ur5: Robot, model: PowerModel) -> None:
    path = straight([0.3, -1.2, 1.0, 0.2, 0.4, 0.0], [-0.5, -0.6, 0.4, 1.0, -0.2, 0.5])
    duration = 1.3 * fastest(ur5, model, path, jerk=False).duration
    found = retime(ur5, model, path, duration=duration)
    assert found.lower_bound is not None and found.gap_percent is not None
    assert found.kind == "global" and found.gap_percent < 0.01
    scorer, rng = Scorer(ur5, model), np.random.default_rng(0)
    g = greville(found.timing.knots)
    for _ in range(20):
        wave = sum(rng.normal(scale=0.03) * np.sin(k * np.pi * g) for k in range(1, 6))
        other = Timing(path, found.timing.knots, found.timing.control * np.exp(wave)).slowed(duration)
        assert scorer.energy(other.trajectory(ur5.joints)).total > found.lower_bound


def test_prices_beyond_the_largest_spoil_convexity(panda: Robot, model: PowerModel) -> None:
    path = through(np.array([START, MIDDLE, GOAL]))
    d = PathDynamics(panda, model, path, np.linspace(0.01, 0.99, 41))
    numbers, shared = point_numbers(d, np.zeros(41)), np.append(model.values(7), [2.0, 1.0])
    k = compressed(SharedByStructure(model), 7, numbers, shared)
    assert k is not None
    upper = np.full(41, 3.0)
    price = largest_price(k, upper)
    assert price > 88.04  # holding and gravity leave room above standby
    z = ca.SX.sym("z", 2)
    coefficients, of_price = ca.SX.sym("k", 9), ca.SX.sym("price")
    power = ca.dot(coefficients[:6], ca.vertcat(1, z[0], z[1], z[0] ** 2, z[0] * z[1], z[1] ** 2))
    share = (power - of_price) / ca.sqrt(z[1])
    hessian = ca.Function("hessian", [z, coefficients, of_price], [ca.hessian(share, z)[0]])

    def smallest(of: float) -> float:
        values = [
            np.linalg.eigvalsh(
                np.array(hessian([-k[1, i] / (2 * k[3, i]) - k[4, i] * b / (2 * k[3, i]), b], k[:, i], of))
            )[0]
            for i in range(41)
            for b in np.linspace(0.02, 3.0, 40)
        ]
        return min(values)

    assert smallest(price - 1e-3) > -1e-9
    assert smallest(price + 0.5) < -1e-6


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (CoulombFriction(tau_c=1.0), ViscousFriction(b=3.0), SupplyEfficiency(eta=0.8)),
    ],
)
def test_nine_monomials_are_the_law(panda: Robot, model: PowerModel, effects: tuple) -> None:
    law = PowerModel("panda", model.effects + effects)
    shared_by, n = SharedByStructure(law), 7
    d = PathDynamics(panda, law, through(np.array([START, MIDDLE, GOAL])), np.linspace(0.01, 0.99, 25))
    numbers, shared = point_numbers(d, np.zeros(25)), np.append(law.values(n), [1.7, 1.0])
    k = compressed(shared_by, n, numbers, shared)
    assert k is not None
    rng = np.random.default_rng(3)
    a, b = rng.uniform(-20, 20, 25), rng.uniform(1e-3, 2, 25)
    values = np.repeat(shared[:, None], 25, axis=1)
    power = np.array(law_function(shared_by, n)(np.stack([a, b]), numbers, values)[0]).ravel()
    root = np.sqrt(b)
    again = sum(x * y for x, y in zip(k, [1, a, b, a * a, a * b, b * b, root, root * a, root * b], strict=True))
    assert again == pytest.approx(power, rel=1e-7)


def test_a_clamped_law_is_not_compressed(panda: Robot, model: PowerModel) -> None:
    law = PowerModel("panda", (*model.effects, Regeneration(efficiency=0.0)))
    d = PathDynamics(panda, law, straight(GOAL, START), np.linspace(0.01, 0.99, 25))
    numbers, shared = point_numbers(d, np.zeros(25)), np.append(law.values(7), [1.7, 1.0])
    assert compressed(SharedByStructure(law), 7, numbers, shared) is None


@pytest.mark.parametrize("general", [False, True])
def test_derivatives_of_the_program(panda: Robot, model: PowerModel, general: bool) -> None:
    """Cost, time, torque and jerk rows against central differences."""
    knots = np.linspace(0, 1, 12)
    grid = quadrature(knots, (True, True))
    path = through(np.array([START, MIDDLE, GOAL]))
    d = PathDynamics(panda, model, path, grid.s)
    rough = (ViscousFriction(b=4.0), Regeneration(efficiency=0.2)) if general else ()
    law = PathLaw.of(PowerModel("panda", (*model.effects, *rough)), d, 1.3, np.zeros(len(grid.s)))
    assert (law.coefficients is None) == general
    at, several = lift(knots, grid.s), lift(knots, np.array([0.1, 0.52, 0.97]), "abw")
    shared_by = SharedByStructure(law.model)
    places = np.array([1, 7, 20])
    numbers, values = point_numbers(d, np.zeros(len(grid.s)))[:, places], np.append(law.model.values(7), [1.3, 1.0])
    torque = Torque.of(shared_by, numbers, values, np.full((3, 7), 0.02))
    factors = np.random.default_rng(5).normal(size=(3, 3))
    linear = LinearRows(at.part(places), *np.random.default_rng(6).normal(size=(3, 3)), np.ones(3))
    curved = CurvedRows(at.part(places), torque, 7), CurvedRows(several, Jerk(factors), 1)
    cost = law.cost(grid.weight, 1.3, 0.01, -0.3, 4.0)
    whole = Program(at, grid.weight, cost, np.array([0.02, 0.3]), 0.8, Rows(linear, curved))
    g = greville(knots)[1:-1]
    x = 4 * g * (1 - g) + 0.05
    multipliers = np.random.default_rng(7).normal(size=1 + whole.rows_held.count)
    step = 1e-6

    def differences(of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        return np.stack([(of(x + step * e) - of(x - step * e)) / (2 * step) for e in np.eye(len(x))], axis=-1)

    def dense(pattern: ca.Sparsity, values: np.ndarray) -> np.ndarray:
        return np.array(ca.DM(pattern, ca.DM(values)))

    def gradient(x: np.ndarray) -> np.ndarray:
        return 0.6 * whole.gradient(x) + dense(whole.jacobian_pattern, whole.jacobian(x)).T @ multipliers

    assert differences(lambda x: np.array(whole.cost(x))) == pytest.approx(whole.gradient(x), rel=1e-5, abs=1e-7)
    jacobian = dense(whole.jacobian_pattern, whole.jacobian(x))
    assert differences(whole.rows) == pytest.approx(jacobian, rel=1e-5, abs=1e-7)
    hessian = dense(whole.hessian_pattern, whole.hessian(x, 0.6, multipliers))
    whole_hessian = hessian + np.triu(hessian, 1).T
    assert differences(gradient) == pytest.approx(whole_hessian, rel=1e-4, abs=1e-5 * np.abs(hessian).max())


@pytest.mark.parametrize("share", [1.2, 1.5, 2.5])
@pytest.mark.parametrize(
    "path", [straight(START, GOAL), straight(GOAL, START), through(np.array([START, MIDDLE, GOAL]))]
)
def test_exact_durations_beat_even_slowing(panda: Robot, model: PowerModel, path: JointPath, share: float) -> None:
    shortest = fastest(panda, model, path, jerk=False)
    found = retime(panda, model, path, shortest=shortest, duration=share * shortest.duration)
    assert found.converged
    assert found.trajectory.duration == pytest.approx(share * shortest.duration, abs=1e-9)
    assert score(panda, model, found) == pytest.approx(found.energy, rel=1e-5)
    assert found.energy <= slowed(panda, model, found) * (1 + 1e-9)
    assert worst_use(panda, model, found) < 1e-6
    assert found.lower_bound is not None and found.lower_bound <= found.energy
    assert found.gap_percent is not None and found.gap_percent < 2


def test_energy_over_duration_is_convex(ur5: Robot, model: PowerModel) -> None:
    path = straight([0.3, -1.2, 1.0, 0.2, 0.4, 0.0], [-0.5, -0.6, 0.4, 1.0, -0.2, 0.5])
    shortest = fastest(ur5, model, path, jerk=False)
    durations = shortest.duration * np.linspace(1.05, 1.6, 6)
    energy = [retime(ur5, model, path, shortest=shortest, max_duration=t).energy for t in durations]
    exact = [retime(ur5, model, path, shortest=shortest, duration=t) for t in durations]
    assert all(e.kind == "global" for e in exact)
    assert (np.diff([e.energy for e in exact], 2) > -1e-6).all()
    assert (np.diff(energy) <= 1e-6).all()
    assert all(e.energy >= free * (1 - 1e-5) for e, free in zip(exact, energy, strict=True))


def test_mirrored_in_time_the_loss_is_the_same(wheel: Robot) -> None:
    forth = retime(wheel, copper(1.0), straight([0.0], [1.3]), duration=1.1)
    back = retime(wheel, copper(1.0), straight([1.3], [0.0]), duration=1.1)
    assert forth.energy == pytest.approx(back.energy, rel=1e-7)


def test_gravity_makes_the_way_up_as_costly_as_the_way_down_plus_its_work(panda: Robot, model: PowerModel) -> None:
    """Reversing a motion keeps all torques of the source model, so that only the stored energy changes its sign."""
    duration = 1.5 * fastest(panda, model, straight(START, GOAL), jerk=False).duration
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
    assert found.kind == "global" and found.converged
    assert score(panda, law, found) == pytest.approx(found.energy, rel=1e-4)
    assert found.energy <= slowed(panda, law, found)


def test_viscous_friction_is_local_and_claims_no_gap(panda: Robot, model: PowerModel) -> None:
    law = PowerModel("panda", (*model.effects, ViscousFriction(b=4.0)))
    found = retime(panda, law, straight(START, GOAL), duration=1.6)
    assert found.kind == "local" and found.lower_bound is None and found.gap_percent is None
    assert found.energy < slowed(panda, law, found)
    assert worst_use(panda, law, found) < 1e-6


def test_jerk_limits_hold_and_end_the_claim(panda: Robot, model: PowerModel) -> None:
    tight = replace(panda, limits=panda.limits.replace(jerk=panda.limits.jerk / 50))
    path = straight(START, GOAL)
    shortest = fastest(tight, model, path)
    found = retime(tight, model, path, max_duration=shortest.duration)
    assert found.converged and found.kind == "local" and found.lower_bound is None
    assert found.timing.duration > fastest(tight, model, path, jerk=False).duration * 1.002
    assert worst_use(tight, model, found) < 1e-5
    assert found.energy <= slowed(tight, model, found) * (1 + 1e-6)


def test_end_speeds_are_kept(panda: Robot, model: PowerModel) -> None:
    path = straight(START, GOAL)
    shortest = fastest(panda, model, path, start_speed=0.4, end_speed=0.2, jerk=False)
    for duration in (None, 1.4 * shortest.duration):
        found = retime(panda, model, path, shortest=shortest, duration=duration)
        assert found.converged
        assert found.trajectory.velocity[0] == pytest.approx(0.4 * (GOAL - START))
        assert found.trajectory.velocity[-1] == pytest.approx(0.2 * (GOAL - START))
        if duration:
            assert found.trajectory.duration == pytest.approx(duration, abs=1e-9)


def test_too_short_a_duration_says_what_would_work(panda: Robot, model: PowerModel) -> None:
    path = straight(START, GOAL)
    shortest = fastest(panda, model, path, jerk=False).duration
    for wish in ({"duration": 0.6 * shortest}, {"max_duration": 0.6 * shortest}):
        with pytest.raises(Infeasible, match="shortest duration") as caught:
            retime(panda, model, path, **wish)
        error = caught.value
        assert error.joint in panda.joints and error.limit == "duration"
        assert error.excess is not None and error.excess > 0.1
        assert error.shortest_duration == pytest.approx(shortest, rel=2e-3)
    assert error.shortest_duration is not None
    assert retime(panda, model, path, duration=error.shortest_duration * (1 + 1e-4)).converged


@pytest.mark.parametrize("length", [0.0, 1e-4])
def test_degenerate_moves(panda: Robot, model: PowerModel, length: float) -> None:
    goal = START + length * (GOAL - START) / np.linalg.norm(GOAL - START)
    found = retime(panda, model, straight(START, goal), duration=0.5)
    assert found.converged and found.trajectory.duration == pytest.approx(0.5, abs=1e-9)
    assert score(panda, model, found) == pytest.approx(found.energy, rel=1e-5)
    assert found.energy > 88.04 * 0.5
