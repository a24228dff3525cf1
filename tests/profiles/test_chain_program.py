"""Chains of standard moves against ruckig and their own closed forms, and the program that chooses them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import ruckig
from poses import GOAL, START

from energy_opt.motion.dense import Dense
from energy_opt.motion.judge.certificate import certify
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.base import Limit, PlaceConstraints, Violation
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.reshape.nodes import node_functions
from energy_opt.numerics import ipopt
from energy_opt.power import PowerModel
from energy_opt.profiles import (
    Chain,
)
from energy_opt.profiles.profile_program import SHARP, Program, lobatto
from energy_opt.robot import Robot


def test_a_chain_of_one_move_is_ruckigs_profile() -> None:
    """Position, velocity and acceleration over time, of all joints at once."""
    start, goal = np.array([0.3, -1.0]), np.array([1.5, -1.4])
    rise, ramp, cruise = 4 / 20, 4 / 20 + 1 / 4, 1.2 / 1 - 0.45  # [s] over 1.2 rad at 1 rad/s, 4 rad/s^2, 20 rad/s^3
    curve = Chain(np.stack([start, goal]), np.array([ramp + cruise]), np.full(2, ramp), np.full(2, rise)).trajectory(
        ("a", "b")
    )
    given = ruckig.InputParameter(1)
    given.current_position, given.target_position = [0.3], [1.5]
    given.max_velocity, given.max_acceleration, given.max_jerk = [1.0], [4.0], [20.0]
    theirs = ruckig.Trajectory(1)
    ruckig.Ruckig(1).calculate(given, theirs)
    time = np.linspace(0, curve.duration, 300)
    q, v, a, _ = curve.sample(time)
    expected = np.array([theirs.at_time(t) for t in time])[:, :, 0]
    for ours, column in zip((q, v, a), expected.T, strict=True):
        assert ours[:, 0] == pytest.approx(column, abs=1e-6)
    assert q[:, 1] == pytest.approx(-1.0 - (q[:, 0] - 0.3) / 3, abs=1e-12)  # joints together


def bent(smooth: bool = True) -> Chain:
    rng = np.random.default_rng(3)
    corners = np.linspace(START, GOAL, 3) + rng.normal(size=(3, 7)) * [[0.0], [0.1], [0.0]]
    ramps = np.array([0.41, 0.5, 0.33])
    return Chain(corners, np.array([0.8, 0.7]), ramps, np.array([0.1, 0.12, 0.08]) if smooth else np.full(3, SHARP))


@pytest.mark.parametrize("smooth", [True, False])
def test_a_chains_rows_are_the_profile(smooth: bool) -> None:
    """Continuous, as fast as its closed forms say, and inside the triangle of its corners at the blend."""
    chain = bent(smooth)
    curve = chain.trajectory(tuple("abcdefg"))
    assert curve.duration == pytest.approx(chain.duration, rel=1e-15) and (np.diff(curve.time) > 0).all()
    time = np.linspace(0, chain.duration, 4001)
    q, v, a, jerk = curve.sample(time)
    rounding = 1.01 * time[1] ** 2 * np.abs(jerk).max() / 6  # of central differences
    np.testing.assert_allclose(np.gradient(q, time, axis=0)[1:-1], v[1:-1], atol=rounding)
    assert np.abs(v).max(axis=0) == pytest.approx(np.abs(chain.velocities).max(axis=0), rel=1e-9)
    assert np.abs(a).max(axis=0) == pytest.approx(np.abs(chain.accelerations).max(axis=0), rel=1e-9)
    peak = np.abs(chain.accelerations / chain.rises[:, None]).max(axis=0)
    assert np.abs(jerk).max(axis=0) == pytest.approx(peak, rel=1e-6)
    np.testing.assert_allclose(q[[0, -1]], [START, GOAL], atol=1e-12)
    middle = chain.ramps[0] / 2 + chain.spans[0]
    before = curve.sample(np.array([middle - chain.ramps[1] / 2]))[0][0]
    after = curve.sample(np.array([middle + chain.ramps[1] / 2]))[0][0]
    np.testing.assert_allclose(before, chain.corners[1] - chain.velocities[0] * chain.ramps[1] / 2, atol=1e-12)
    np.testing.assert_allclose(after, chain.corners[1] + chain.velocities[1] * chain.ramps[1] / 2, atol=1e-12)
    blend = curve.sample(np.linspace(middle - 0.25, middle + 0.25, 50))[0]
    triangle = np.stack([before, chain.corners[1], after])
    weights = np.linalg.lstsq(np.vstack([triangle.T, np.ones(3)]), np.vstack([blend.T, np.ones(50)]), rcond=None)[0]
    assert weights.min() > -1e-9 and np.abs(triangle.T @ weights - blend.T).max() < 1e-9


def test_lobatto_is_exact() -> None:
    for count in (4, 6, 8):
        x, w = lobatto(count)
        for degree in range(2 * count - 2):
            assert w @ x**degree == pytest.approx(1 / (degree + 1), rel=1e-12)


@pytest.fixture(scope="module")
def program(panda: Robot, model: PowerModel) -> Program:
    nodes = node_functions(model, panda.body, joint_limits(panda.limits))
    return Program(1, True, nodes, (START, GOAL), joint_limits(panda.limits), model.values(7), (1.0, 3.0))


def test_the_programs_energy_is_the_judges(program: Program, panda: Robot, model: PowerModel) -> None:
    """Less the change of stored energy, which no moves avoid; and its rows are the judge's shares of the bounds."""
    chain = bent()
    curve = chain.trajectory(panda.joints)
    scorer = Scorer(panda, model)
    energy = scorer.energy(curve)
    x = program.unknowns(chain)
    assert program.cost(x) == pytest.approx(energy.total - energy.stored, rel=1e-8)
    rows = program.constraints(x)
    limit = certify(curve, scorer, joint_limits(panda.limits))
    shares = np.abs(rows[6 : 6 + 7 * (2 + 3 + 3)])  # after 2 + 3 orders and the duration
    assert max(shares[:14]) - 1 == pytest.approx(limit.max_violation["velocity"], abs=1e-9)
    effort = np.abs(rows[6 + 56 :]).max() - 1
    assert effort == pytest.approx(limit.max_violation["effort"], abs=2e-3)  # nodes are not where it is largest


def check_derivatives(program: Program) -> None:
    """Gradient and Hessian of the Lagrangian against differences."""
    x = program.unknowns(bent())
    lam = np.random.default_rng(0).normal(size=len(program.row_bounds[0]))

    def slope(x: np.ndarray) -> np.ndarray:
        return 1.3 * program.gradient(x) + lam @ program.jacobian(x).reshape(program.size, -1).T

    step = 1e-6 * np.eye(program.size)

    def lagrangian(x: np.ndarray) -> float:
        return 1.3 * program.cost(x) + float(lam @ program.constraints(x))

    numeric = np.array([(lagrangian(x + e) - lagrangian(x - e)) / 2e-6 for e in step])
    np.testing.assert_allclose(slope(x), numeric, rtol=1e-6, atol=1e-7 * np.abs(numeric).max())
    numeric = np.array([(slope(x + e) - slope(x - e)) / 2e-6 for e in step])
    upper = program.hessian(x, 1.3, lam)
    got = np.zeros((program.size, program.size))
    got.T[np.tril_indices(program.size)] = upper  # columns of the upper triangle one after another
    np.testing.assert_allclose(np.triu(got), np.triu(numeric), atol=1e-6 * np.abs(numeric).max())


def test_the_programs_derivatives(program: Program) -> None:
    check_derivatives(program)


class Low(Limit):
    """Joint 2 stays below a height at all of some places: numeric rows, as distances between bodies are."""

    name, unit = "low", "rad"
    height = -0.35

    def worst(self, x: Dense) -> Violation:
        k = int(np.argmax(x.q[:, 1]))
        return Violation(self.name, float(x.q[k, 1] - self.height), x.joints[1], float(x.time[k]), 0.0, 0.0)

    def places(self, curve: Callable[[np.ndarray], np.ndarray]) -> PlaceConstraints:
        u = np.linspace(0.05, 0.6, 23)
        assert curve(u).shape == (23, 7)
        return LowRows(u, self.height)


class LowRows:
    """sin(q_2) - sin(height) <= 0, so that the rows have curvature of their own."""

    def __init__(self, u: np.ndarray, height: float) -> None:
        self.u, self.place, self.keys = u, np.arange(len(u)), np.arange(len(u))
        self.lower, self.upper = np.full(len(u), -np.inf), np.zeros(len(u))
        self._height = np.sin(height)

    def value(self, q: np.ndarray) -> np.ndarray:
        return np.sin(q[:, 1]) - self._height

    def gradient(self, q: np.ndarray) -> np.ndarray:
        return np.cos(q[:, 1])[:, None] * np.eye(7)[1]

    def hessian(self, q: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        return (-multipliers * np.sin(q[:, 1]))[:, None, None] * np.outer(np.eye(7)[1], np.eye(7)[1])


def test_numeric_rows_have_exact_derivatives_and_are_held(panda: Robot, model: PowerModel) -> None:
    limits = (*joint_limits(panda.limits), Low())
    nodes = node_functions(model, panda.body, limits)
    program = Program(1, True, nodes, (START, GOAL), limits, model.values(7), (1.5, 1.5), bent())
    assert len(program.placed) == 1
    check_derivatives(program)
    x = program.unknowns(bent())
    inside = np.linspace(0.05, 0.6, 23)
    curve = bent().trajectory(panda.joints)
    assert bent().along(inside) == pytest.approx(curve.sample(inside * curve.duration)[0], abs=1e-12)
    assert program.constraints(x)[-23:] == pytest.approx(np.sin(bent().along(inside)[:, 1]) - np.sin(-0.35))
    answer = ipopt.solve(program, x, program.box, program.row_bounds, {"max_iter": 200, "tol": 1e-6})
    free = Program(1, True, nodes, (START, GOAL), limits, model.values(7), (1.5, 1.5))
    loose = ipopt.solve(free, x, free.box, free.row_bounds, {"max_iter": 200, "tol": 1e-6})
    assert answer.success and loose.success
    assert program.constraints(answer.x)[-23:].max() <= 1e-7 < program.constraints(loose.x)[-23:].max()
    assert program.cost(answer.x) > free.cost(loose.x)
