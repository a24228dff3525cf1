"""The reshaping program: every derivative by finite differences, patterns, and the ends that it keeps."""

import numpy as np
import pytest

from energy_opt.effects import CoulombFriction, Payload, Regeneration, ViscousFriction
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.reshape.curve import fitted
from energy_opt.motion.reshape.layout import Ends, Pattern, Shape
from energy_opt.motion.reshape.nlp import ReshapeProgram
from energy_opt.motion.reshape.nodes import OBJECTIVES, node_functions
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


def build(free_acceleration: bool, vias: int, moving: bool, objective: str = "energy", places=(), rng=RNG):
    robot, model = everything()
    n = robot.n
    shape = Shape(n, Basis(11, 0.8), 3, free_acceleration, vias)
    speed = 0.3 * rng.normal(size=(2, n)) if moving else np.zeros((2, n))
    start, goal = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n)
    via = np.array([(start + goal) / 2 + 0.1] * vias).reshape(vias, n)
    ends = Ends(start, goal, speed[0], speed[1], via)
    rows = np.array([(limit, site, (site + limit) % n) for limit in (1, 2, 3, 4) for site in (0, 2, 5, 7)])
    limits = joint_limits(robot.limits.replace(acceleration=np.full(n, 12.0), jerk=np.full(n, 800.0)))
    nodes = node_functions(model, robot.body, limits, objective)
    program = ReshapeProgram(
        Pattern(shape), nodes, ends, limits, rows, np.append(model.values(n), 1.0), 0.1, places=places
    )
    u = np.linspace(0, 1, 40)
    curve = fitted(shape, u, start + np.outer(u, goal - start) + 0.2 * np.sin(np.pi * u)[:, None], ends, 1.4)
    x = np.concatenate([curve.points[shape.pinned : -shape.pinned].ravel(), [1.4], np.full(vias, 0.45)])
    return program, x


def dense(pattern, values, shape):
    out = np.zeros(shape)
    rows, columns = pattern.get_triplet()
    out[rows, columns] = values
    return out


@pytest.mark.parametrize(
    ("free_acceleration", "vias", "moving"), [(False, 0, False), (True, 0, True), (False, 2, True)]
)
def test_derivatives(free_acceleration, vias, moving):
    program, x = build(free_acceleration, vias, moving)
    size, count, step = len(x), program.count, 1e-5
    multipliers, factor = RNG.normal(size=count), 1.3

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
        numeric[1][:, i] = (program.rows(ahead) - program.rows(behind)) / (2 * step)
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
    x = x + 0.1 * RNG.normal(size=len(x))
    x[program.pattern.time] = 1.7
    points, basis = program.points(x), program.shape.basis
    for u, q, v in ((0.0, program.ends.start, program.ends.v_start), (1.0, program.ends.goal, program.ends.v_goal)):
        at = np.array([u])
        assert np.allclose(basis.matrix(at) @ points, q, atol=1e-12)
        assert np.allclose(basis.matrix(at, 1) @ points / 1.7, v, atol=1e-10)
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
