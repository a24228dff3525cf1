"""Sequential quadratic programming on reshaping problems: its derivatives, and that it agrees with IPOPT."""

from dataclasses import replace

import numpy as np
import pytest
from poses import GOAL, START
from test_program import everything

from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.reshape.curve import fitted
from energy_opt.motion.reshape.evaluation import Point
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.model import Model
from energy_opt.motion.reshape.nodes import node_functions
from energy_opt.numerics.bspline import Basis
from energy_opt.numerics.quadratic import Banded, Constraints


def dense(matrix: Banded) -> np.ndarray:
    n, width = matrix.band.shape
    out = np.zeros((n + matrix.border.shape[1],) * 2)
    for offset in range(min(width, n)):
        index = np.arange(n - offset)
        out[index + offset, index] = out[index, index + offset] = matrix.band[: n - offset, offset]
    out[:n, n:], out[n:, :n], out[n:, n:] = matrix.border, matrix.border.T, matrix.corner
    return out


def matrix_of(held: Constraints, size: int) -> np.ndarray:
    return np.array([held.times(d) for d in np.eye(size)]).T


def constraints_of(model: Model, point: Point) -> Constraints:
    return model.other_constraints(point, np.inf).joined(model.via_constraints(point))


@pytest.fixture(scope="module")
def built():
    robot, model = everything()
    limits = joint_limits(robot.limits.replace(acceleration=np.full(robot.n, 12.0), jerk=np.full(robot.n, 800.0)))
    return robot, model, limits, node_functions(model, robot.body, limits)


@pytest.mark.parametrize(
    ("free_acceleration", "vias", "moving", "fixed"),
    [(False, 0, False, True), (True, 0, True, False), (False, 2, True, False)],
)
def test_derivatives(built, free_acceleration: bool, vias: int, moving: bool, fixed: bool) -> None:
    robot, model, limits, nodes = built
    rng, n = np.random.default_rng(5), robot.n
    shape = Shape(n, Basis(11, 0.8), 3, free_acceleration, vias)
    speed = 0.3 * rng.normal(size=(2, n)) if moving else np.zeros((2, n))
    start, goal = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n)
    via = np.array([(start + goal) / 2 + 0.1] * vias).reshape(vias, n)
    ends = Ends(start, goal, speed[0], speed[1], via)
    u = np.linspace(0, 1, 40)
    line = start + np.outer(u, goal - start) + 0.2 * np.sin(np.pi * u)[:, None]
    curve = fitted(shape, u, line, ends, 1.4, np.linspace(0.3, 0.6, vias))
    durations = (1.4, 1.4) if fixed else (0.1, 9.0)
    work = Model(shape, nodes, ends, limits, model.values(n), durations)
    work.scale = 0.1
    point = work.at_curve(curve)
    size, h = work.shape.size + work.border, 1e-5
    step = np.eye(size) * h

    def at(d: np.ndarray):
        return work.at(*work.moved(point, d))

    ahead, behind = [at(d) for d in step], [at(-d) for d in step]
    slope = np.array([(a.cost - b.cost) / (2 * h) for a, b in zip(ahead, behind, strict=True)])
    assert np.allclose(work.gradient(point), slope, atol=2e-6 * max(1, np.abs(slope).max()))
    # the effort and via rows' curvature, weighted by multipliers, is part of the Hessian
    held = constraints_of(work, point)
    lam = rng.normal(size=held.count)
    known = work.multipliers(point, held.keys, lam)

    def lagrangian(p):
        out, rows = work.gradient(p), constraints_of(work, p)
        return out + matrix_of(rows, size).T @ lam if rows.count == held.count else out

    rows = np.array([lagrangian(a) - lagrangian(b) for a, b in zip(ahead, behind, strict=True)]) / (2 * h)
    found = dense(work.hessian(point, known))
    assert np.allclose(found, rows, atol=3e-5 * max(1, np.abs(rows).max()))
    moved = np.array([(a.via - b.via).ravel() / (2 * h) for a, b in zip(ahead, behind, strict=True)])
    if vias:
        by_row = np.array([held.times(d) for d in np.eye(size)])
        assert np.allclose(by_row[:, -n * vias :], moved, atol=1e-6)
    linear = work.linear_constraints(point, np.ones(len(point.linear), dtype=bool))
    if fixed:
        change = np.array([(a.linear - b.linear) / (2 * h) for a, b in zip(ahead, behind, strict=True)])
        assert np.allclose(np.array([linear.times(d) for d in np.eye(size)]), change, atol=1e-5)
    assert np.allclose(linear.sparse(work.shape.size).toarray(), matrix_of(linear, size), rtol=1e-12, atol=1e-12)


def test_a_row_linearised_in_time_stays_inside_of_the_limit(built) -> None:
    """|A x| <= b T^k with k > 1: what the linearised row allows holds the limit itself."""
    robot, model, limits, nodes = built
    n, shape = robot.n, Shape(robot.n, Basis(11, 0.8))
    ends = Ends(np.zeros(n), np.full(n, 0.8), np.zeros(n), np.zeros(n), np.zeros((0, n)))
    u = np.linspace(0, 1, 40)
    curve = fitted(shape, u, np.outer(u, ends.goal), ends, 0.5)
    work = Model(shape, nodes, ends, limits, model.values(n), (0.1, 9.0))
    point = work.at_curve(curve)
    rows = work.linear_constraints(point, np.ones(len(point.linear), dtype=bool))
    rng = np.random.default_rng(0)
    for _ in range(20):
        d = np.append(0.05 * rng.normal(size=work.shape.size), rng.uniform(-0.2, 0.4))
        share, allowed = work.at(*work.moved(point, d)).linear, rows.times(d)
        kept = np.where(point.linear > 0, allowed <= rows.ceiling, allowed >= rows.floor)
        of_its_side = np.sign(share) == np.sign(point.linear)
        assert np.all(np.abs(share)[kept & of_its_side] <= 1 + 1e-9)


@pytest.mark.parametrize("goal", [GOAL, START + 0.5])
def test_the_search_alone_and_polished_by_ipopt_agree(panda, model, goal) -> None:
    settings = Settings(starts=2, compile="never")
    move = Move(START, goal, duration=2.0)
    losses = [Planner(panda, model, replace(settings, solver=s)).solve(move).energy.loss for s in ("sqp", "ipopt")]
    assert losses[0] == pytest.approx(losses[1], rel=1e-4)
