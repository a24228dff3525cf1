"""The program that IPOPT polishes by: every derivative by finite differences, patterns, and the ends that it keeps."""

import numpy as np
import pytest

from energy_opt.effects import CoulombFriction, Payload, Regeneration, ViscousFriction
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.reshape.curve import fitted
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.model import Model
from energy_opt.motion.reshape.nodes import OBJECTIVES, node_functions
from energy_opt.motion.reshape.polish import PolishProgram
from energy_opt.numerics.bspline import Basis
from energy_opt.power import source_method_2
from energy_opt.robot import load_robot

RNG = np.random.default_rng(3)


def everything():
    robot = load_robot("ur5")
    model = source_method_2("ur5")
    for effect in (
        CoulombFriction(tau_c=0.8),
        ViscousFriction(b=0.4),
        Payload(mass=1.2, com=[0.02, 0.0, 0.05]),
        Regeneration(efficiency=0.3, level="joint"),
    ):
        model = model.replaced(effect)
    return robot, model


def build(free_acceleration: bool, vias: int, moving: bool, objective: str = "energy", own=(), rng=RNG, fixed=False):
    """A program about a curve that is taken as the one to begin with, with some constraints of every kind."""
    robot, model = everything()
    n = robot.n
    shape = Shape(n, Basis(11, 0.8), 3, free_acceleration, vias)
    speed = 0.3 * rng.normal(size=(2, n)) if moving else np.zeros((2, n))
    start, goal = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n)
    via = np.array([(start + goal) / 2 + 0.1] * vias).reshape(vias, n)
    ends = Ends(start, goal, speed[0], speed[1], via)
    limits = joint_limits(robot.limits.replace(acceleration=np.full(n, 12.0), jerk=np.full(n, 800.0)))
    nodes = node_functions(model, robot.body, limits, objective)
    durations = (1.4, 1.4) if fixed else (0.1, 9.0)
    problem = Model(shape, nodes, ends, (*limits, *own), model.values(n), durations)
    problem.scale = 0.1
    u = np.linspace(0, 1, 40)
    line = start + np.outer(u, goal - start) + 0.2 * np.sin(np.pi * u)[:, None]
    point = problem.at_curve(fitted(shape, u, line, ends, 1.4, np.full(vias, 0.45)))
    side, hot = np.zeros(len(point.linear)), np.zeros(point.hot.shape, dtype=bool)
    side[::5], hot[::4, 1], hot[::3, 4] = np.sign(point.linear[::5]), True, True
    program = PolishProgram(problem, point, side, hot)
    x = 0.05 * rng.normal(size=shape.size + problem.border)
    return program, x


def dense(pattern, values, shape):
    out = np.zeros(shape)
    rows, columns = pattern.get_triplet()
    out[rows, columns] = values
    return out


@pytest.mark.parametrize(
    ("free_acceleration", "vias", "moving", "fixed"),
    [(False, 0, False, True), (False, 0, False, False), (True, 0, True, False), (False, 2, True, False)],
)
def test_derivatives(free_acceleration, vias, moving, fixed):
    program, x = build(free_acceleration, vias, moving, fixed=fixed)
    size, count, step = len(x), len(program.constraints(x)), 1e-6
    multipliers, factor = np.abs(RNG.normal(size=count)), 1.3  # bounds on one side have no others

    def jacobian(x):
        return dense(program.jacobian_pattern, program.jacobian(x), (count, size))

    upper = dense(program.hessian_pattern, program.hessian(x, factor, multipliers), (size, size))
    hessian = upper + np.triu(upper, 1).T
    gradient = program.gradient(x).copy()
    jac = jacobian(x)
    numeric = [np.zeros(size), np.zeros((count, size)), np.zeros((size, size))]
    for i in range(size):
        ahead, behind = x.copy(), x.copy()
        ahead[i] += step
        behind[i] -= step
        numeric[0][i] = (program.cost(ahead) - program.cost(behind)) / (2 * step)
        numeric[1][:, i] = (program.constraints(ahead) - program.constraints(behind)) / (2 * step)
        slopes = [factor * program.gradient(y) + jacobian(y).T @ multipliers for y in (ahead, behind)]
        numeric[2][:, i] = (slopes[0] - slopes[1]) / (2 * step)
    for exact, approximate in zip((gradient, jac, hessian), numeric, strict=True):
        assert np.abs(exact - approximate).max() <= 2e-6 * np.abs(approximate).max()


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_gradient_of_every_objective(objective):
    program, x = build(False, 0, False, objective)
    direction = RNG.normal(size=len(x))
    step = 1e-6
    slope = (program.cost(x + step * direction) - program.cost(x - step * direction)) / (2 * step)
    assert program.gradient(x) @ direction == pytest.approx(slope, rel=1e-5)


def test_ends_are_kept_whatever_the_unknowns():
    program, x = build(False, 0, True)
    point = program.at(x + 0.1 * RNG.normal(size=len(x)))
    problem, points, basis = program.model, point.points, program.model.shape.basis
    for u, q, v in ((0.0, problem.ends.start, problem.ends.v_start), (1.0, problem.ends.goal, problem.ends.v_goal)):
        at = np.array([u])
        assert np.allclose(basis.matrix(at) @ points, q, atol=1e-12)
        assert np.allclose(basis.matrix(at, 1) @ points / point.duration, v, atol=1e-10)
        assert np.allclose(basis.matrix(at, 2) @ points, 0, atol=1e-8)


def test_polygon_bounds_the_derivative():
    basis = Basis(15)
    points = RNG.normal(size=(15, 1))
    for order in (1, 2, 3):
        polygon = basis.polygon(order) @ points
        curve = basis.matrix(np.linspace(0, 1, 500), order) @ points
        assert curve.max() <= polygon.max() * (1 + 1e-12) + 1e-12
        assert curve.min() >= polygon.min() * (1 + 1e-12) - 1e-12
        assert np.ptp(polygon) < 3 * np.ptp(curve)
