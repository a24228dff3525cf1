"""The program of a retiming: against an independent cone program; its derivatives, convexity and bounds."""

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from poses import GOAL, MIDDLE, START, without_jerk

from energy_opt.batches.tables import random_moves
from energy_opt.effects import (
    CopperLoss,
    CoulombFriction,
    Effect,
    GearEfficiency,
    GravitySpring,
    LoadFriction,
    PsuLoss,
    Regeneration,
    Standby,
    SupplyEfficiency,
    ViscousFriction,
)
from energy_opt.motion import Move, Planner
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.joint import Effort, JerkAlongPath
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.path import JointPath, straight, through
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.motion.retime.bound import largest_price
from energy_opt.motion.retime.fastest import minimum_time
from energy_opt.motion.retime.nlp import CurvedConstraints, LinearConstraints, PathConstraints, RetimeProgram
from energy_opt.motion.retime.points import PathLaw, Symbolic
from energy_opt.motion.retime.program import Retiming
from energy_opt.motion.retime.quadrature import lift, quadrature
from energy_opt.motion.retime.solve import GLOBAL_GAP, retime
from energy_opt.motion.retime.sums import compressed, law_function, point_numbers
from energy_opt.motion.timing import toppra
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.timing.toppra import fastest
from energy_opt.numerics.bspline import greville
from energy_opt.power import Mixture, PowerModel, drive_function
from energy_opt.power.known import named_model
from energy_opt.power.structure import SharedByStructure
from energy_opt.robot import Robot, load_robot


@pytest.mark.parametrize("path", [straight(START, GOAL), through(np.array([START, MIDDLE, GOAL]))])
@pytest.mark.parametrize("mode", ["free", "exact"])
def test_against_a_cone_program(ur5: Robot, path: JointPath, mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same spline space and limits at the same points, posed for cvxpy and solved by Clarabel."""
    cp = pytest.importorskip("cvxpy")
    model = PowerModel("ur5", (Standby(power=88.04), CopperLoss(r_over_kt2=0.0036), CoulombFriction(tau_c=2.0)))
    path = JointPath(path.knots, path.coefficients[:, :, :6])  # the first six coordinates, on a six-axis arm
    ends = np.full(6, np.inf)  # the cone program knows neither acceleration nor jerk limits
    ur5 = replace(ur5, limits=ur5.limits.replace(acceleration=ends, jerk=ends))
    monkeypatch.setattr(toppra, "INTERVALS", 60)  # with more, the cone program's answer is less accurate
    shortest = fastest(ur5, model, path)
    duration = 1.1 * shortest.duration
    found = retime(ur5, model, path, shortest=shortest, duration=duration if mode == "exact" else None)
    assert 100 * found.gap <= GLOBAL_GAP

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
    duration = 1.3 * fastest(without_jerk(ur5), model, path).duration
    found = retime(ur5, model, path, duration=duration)
    assert found.lower_bound is not None and found.gap < 1e-4
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
    shared_by = law.shared_by
    places = np.array([1, 7, 20])
    numbers, values = (
        point_numbers(d, np.zeros(len(grid.s)))[:, places],
        np.append(law.shared_by.model.values(7), [1.3, 1.0]),
    )
    torque = Symbolic.of(shared_by, 7, Effort(np.ones(7)), numbers, values, np.full((3, 7), 0.02))
    factors = np.random.default_rng(5).normal(size=(3, 3))
    linear = LinearConstraints(at.part(places), *np.random.default_rng(6).normal(size=(3, 3)), np.ones(3))
    curved = CurvedConstraints(at.part(places), torque, 7), CurvedConstraints(several, JerkAlongPath(factors), 1)
    cost = law.cost(grid.weight, 1.3, 0.01, -0.3, 4.0)
    whole = RetimeProgram(at, grid.weight, cost, np.array([0.02, 0.3]), 0.8, PathConstraints(linear, curved))
    g = greville(knots)[1:-1]
    x = 4 * g * (1 - g) + 0.05
    multipliers = np.random.default_rng(7).normal(size=1 + whole.held_constraints.count)
    step = 1e-6

    def differences(of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        return np.stack([(of(x + step * e) - of(x - step * e)) / (2 * step) for e in np.eye(len(x))], axis=-1)

    def dense(pattern: ca.Sparsity, values: np.ndarray) -> np.ndarray:
        return np.array(ca.DM(pattern, ca.DM(values)))

    def gradient(x: np.ndarray) -> np.ndarray:
        return 0.6 * whole.gradient(x) + dense(whole.jacobian_pattern, whole.jacobian(x)).T @ multipliers

    assert differences(lambda x: np.array(whole.cost(x))) == pytest.approx(whole.gradient(x), rel=1e-5, abs=1e-7)
    jacobian = dense(whole.jacobian_pattern, whole.jacobian(x))
    assert differences(whole.constraints) == pytest.approx(jacobian, rel=1e-5, abs=1e-7)
    hessian = dense(whole.hessian_pattern, whole.hessian(x, 0.6, multipliers))
    whole_hessian = hessian + np.triu(hessian, 1).T
    assert differences(gradient) == pytest.approx(whole_hessian, rel=1e-4, abs=1e-5 * np.abs(hessian).max())


def test_energy_over_duration_is_convex(ur5: Robot, model: PowerModel) -> None:
    path = straight([0.3, -1.2, 1.0, 0.2, 0.4, 0.0], [-0.5, -0.6, 0.4, 1.0, -0.2, 0.5])
    shortest = fastest(without_jerk(ur5), model, path)
    durations = shortest.duration * np.linspace(1.05, 1.6, 6)
    energy = [retime(ur5, model, path, shortest=shortest, max_duration=t).energy for t in durations]
    exact = [retime(ur5, model, path, shortest=shortest, duration=t) for t in durations]
    assert all(100 * e.gap <= GLOBAL_GAP for e in exact)
    assert (np.diff([e.energy for e in exact], 2) > -1e-6).all()
    assert (np.diff(energy) <= 1e-6).all()
    assert all(e.energy >= free * (1 - 1e-5) for e, free in zip(exact, energy, strict=True))


def test_friction_under_load_is_convex_alone_but_not_beside_a_spring(panda: Robot) -> None:
    """Midpoints of random pairs: energy per length P / sqrt(b) by the exact laws, along a direction q' at one point."""
    rng, count, n = np.random.default_rng(0), 20000, panda.n
    slope, inertial, centrifugal = rng.normal(size=(3, n, count))
    gravity = rng.normal(size=(n, count)) * 10.0 ** rng.integers(-2, 2, count)
    q = rng.normal(size=(n, count))
    a = 4 * rng.normal(size=(2, count))
    b = 10 ** rng.uniform(-3, 0.6, (2, count))

    def share_above_midpoint(*effects: Effect) -> float:
        law = PowerModel("panda", (Standby(power=10.0), CopperLoss(r_over_kt2=0.5), *effects))
        values = np.repeat(law.values(n)[:, None], count, axis=1)
        drive = drive_function(law, n)[0]

        def share(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            tau = inertial * a + centrifugal * b + gravity
            power = drive(q, slope * np.sqrt(b), slope * a, tau, np.zeros((1, count)), values)[1]
            return np.array(power).ravel() / np.sqrt(b)

        ends = share(a[0], b[0]), share(a[1], b[1])
        excess = share(a.mean(axis=0), b.mean(axis=0)) - (ends[0] + ends[1]) / 2
        return float((excess / (np.abs(ends[0]) + np.abs(ends[1]))).max())

    load, gear = LoadFriction(mu=0.3), GearEfficiency(eta=0.6)
    for effects in ((load,), (gear,), (load, gear, CoulombFriction(tau_c=1.0)), (load, Regeneration(efficiency=0.2))):
        assert share_above_midpoint(*effects) < 1e-9
    for effect in (load, gear):
        assert share_above_midpoint(effect, GravitySpring(stiffness=20.0, rest=0.0)) > 1e-3
        assert not effect.convex_in_retiming


def test_a_price_of_time_needs_few_iterations(panda: Robot) -> None:
    """With T <= longest as a curved constraint, whose slack is far from its bound, IPOPT took 177 iterations here."""
    model = Mixture.of([named_model(name, panda) for name in ("source-method-2", "careful")])
    path = straight([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], [0.9, 0.1, 0.2, -1.9, 0.0, 2.0, 0.9])
    limits = joint_limits(panda.limits)
    quickest = minimum_time(panda, model, path, limits)
    work = Retiming(panda, model, quickest, limits)
    found = work.optimise(quickest, price=60.0, longest=10 * quickest.duration, floor=1e-6)
    assert found.solved and work.tally.iterations < 130
    slowed = [quickest.slowed(duration) for duration in np.linspace(quickest.duration, 1.5, 20)]
    least = min(work.energy(timing) - 60.0 * timing.duration for timing in slowed)
    assert found.energy - 60.0 * found.timing.duration < least


@pytest.mark.parametrize("name", ["panda", "ur5"])
@pytest.mark.parametrize("more", [(), (CoulombFriction(tau_c=3.0), Regeneration(efficiency=0.7))])
def test_newton_steps_find_the_least_cost_that_ipopt_finds(name: str, more: tuple[Effect, ...]) -> None:
    """Cost for any duration, from the fastest timing and from one that is slower."""
    robot = load_robot(name)
    base, limits = named_model("source-method-2", robot), joint_limits(robot.limits)
    model = PowerModel(robot.name, (*base.effects, *more))
    for move in random_moves(robot, 2, 4):
        quickest = minimum_time(robot, model, straight(np.array(move.start), np.array(move.goal)), limits)
        work = Retiming(robot, model, quickest, limits)
        price = work.convex_price()
        reference = work.optimise(quickest, price=price, longest=np.inf, floor=1e-6)
        assert reference.solved
        least = reference.energy - price * reference.timing.duration
        near = 1e-2 if more else 1e-3  # kinks are smoothed, in units of the timing
        for share in (1.0, 2.0):
            start = quickest.slowed(share * quickest.duration)
            found = work.relax(start, price=price, longest=1e6, floor=1e-6)
            assert found.solved and found.bound is not None
            assert least + 1e-6 * reference.energy > found.bound > least - near * abs(least)  # as the grid resolves
            assert found.energy - price * found.timing.duration < least + near * abs(least)


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_newton_steps_hold_a_duration_that_ipopt_holds(name: str) -> None:
    """In at most 1.02 times the shortest duration, which all moves use up; the bound proves it."""
    robot = load_robot(name)
    model, limits = named_model("source-method-2", robot), joint_limits(robot.limits)
    for move in random_moves(robot, 3, 4):
        quickest = minimum_time(robot, model, straight(np.array(move.start), np.array(move.goal)), limits)
        longest = 1.02 * quickest.duration
        start = quickest.slowed(longest)
        work = Retiming(robot, model, quickest, limits)
        price = work.convex_price()
        reference = work.optimise(start, price=price, longest=longest, floor=1e-6, bounded=True)
        found = work.relax(start, price=price, longest=longest, floor=1e-6)
        assert reference.solved and found.solved and found.bound is not None
        assert found.timing.duration <= longest * (1 + 1e-7)
        least = reference.energy - price * reference.timing.duration
        value = found.energy - price * found.timing.duration
        assert abs(value - least) < 1e-5 * reference.energy
        assert value - 1e-4 * reference.energy < found.bound <= value + 1e-7 * reference.energy


def test_narrow_kinks_need_few_iterations() -> None:
    """Braking power that is partly lost, and losses of the supply: with the kinks' own curvature it took 644."""
    robot = load_robot("ur5e")
    model = named_model("source-method-2", robot).replaced(Regeneration(efficiency=0.3))
    planner = Planner(robot, model.replaced(PsuLoss(affine=0.05, quadratic=1e-4)))
    start, goal = np.array([[-1.58, -1.66, -0.42, -1.09, 0.52, 0.32], [0.18, 1.76, -1.45, -0.39, 1.1, 1.12]])
    found = planner.solve(Move(start, goal, "retime", duration=1.68))
    assert found.status == "solved" and found.solver.iterations < 200
