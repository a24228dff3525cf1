"""Limits one by one: exact excess, rows in reshaping and along a path, against computations of the tests' own."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from poses import GOAL, MIDDLE, START
from test_program import build, dense

from energy_opt.motion import Planner, Settings
from energy_opt.motion.judge.certificate import certify
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.base import Limit, Violation
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.limits.via import PASSED, ViaPoints
from energy_opt.motion.reshape.curve import Curve, Outcome, fitted
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.nodes import node_functions
from energy_opt.motion.reshape.task import Level, Task
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.bspline import Basis
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

PLACES = np.linspace(0.02, 0.98, 33)


@dataclass
class Ball:
    """A toy of numeric rows: |q - centre|^2 >= radius^2, two rows at every place (the second one half as steep)."""

    u: np.ndarray
    centre: np.ndarray
    radius: float

    def __post_init__(self) -> None:
        count = len(self.u)
        self.place = np.repeat(np.arange(count), 2)
        self.factor = np.tile([1.0, 0.5], count)
        self.lower, self.upper = np.full(2 * count, 1.0) * self.factor, np.full(2 * count, np.inf)
        self.keys = np.arange(2 * count)

    def value(self, q: np.ndarray) -> np.ndarray:
        return self.factor * np.sum((q - self.centre) ** 2, axis=1)[self.place] / self.radius**2

    def gradient(self, q: np.ndarray) -> np.ndarray:
        return self.factor[:, None] * 2 * (q - self.centre)[self.place] / self.radius**2

    def hessian(self, q: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        total = np.bincount(self.place, multipliers * self.factor, len(self.u))
        return total[:, None, None] * 2 * np.eye(q.shape[1]) / self.radius**2


class OutsideBall(Limit):
    """The limit that asks for them; it counts how often it was asked."""

    name, unit = "ball", "rad"

    def __init__(self, centre: np.ndarray, radius: float, u: np.ndarray = PLACES) -> None:
        self.centre, self.radius, self.u, self.asked = centre, radius, u, 0

    def places(self, curve) -> Ball:
        self.asked += 1
        assert curve(np.array([0.0])).shape == (1, len(self.centre))
        return Ball(self.u, self.centre, self.radius)

    def worst(self, x) -> Violation:
        near = np.linalg.norm(x.q - self.centre, axis=1)
        k = int(near.argmin())
        return Violation(self.name, 1 - float(near[k]) / self.radius, "the arm", float(x.time[k]), near[k], self.radius)


def test_numeric_constraints_enter_jacobian_and_hessian() -> None:
    rng = np.random.default_rng(5)
    ball = Ball(np.array([0.0, 0.31, 0.31, 0.77, 1.0]), rng.normal(size=6), 0.7)
    program, x = build(True, 1, False, own=[OutsideBall(ball.centre, 0.7, ball.u)], rng=rng)
    count, size = len(program.constraints(x)), len(x)
    first = count - len(ball.place)
    multipliers = np.zeros(count)
    multipliers[first:] = rng.normal(size=len(ball.place))
    lower, upper = program.bounds
    assert lower[first:] == pytest.approx(ball.lower) and (upper[first:] == np.inf).all()

    def jacobian(x: np.ndarray) -> np.ndarray:
        return dense(program.jacobian_pattern, program.jacobian(x), (count, size))

    upper = dense(program.hessian_pattern, program.hessian(x, 0.0, multipliers), (size, size))
    exact = jacobian(x)[first:], upper + np.triu(upper, 1).T
    step, found = 1e-6, (np.zeros((10, size)), np.zeros((size, size)))
    for i in range(size):
        ahead, behind = x + step * np.eye(size)[i], x - step * np.eye(size)[i]
        found[0][:, i] = (program.constraints(ahead) - program.constraints(behind))[first:] / (2 * step)
        found[1][:, i] = (jacobian(ahead) - jacobian(behind)).T @ multipliers / (2 * step)
    for ours, theirs in zip(exact, found, strict=True):
        assert np.abs(theirs).max() > 0.1
        assert ours == pytest.approx(theirs, rel=1e-6, abs=1e-6 * np.abs(theirs).max())


def test_a_limit_of_numeric_constraints_is_kept_by_a_solve(panda: Robot, model: PowerModel) -> None:
    rest = np.zeros(7)
    ends = Ends(START, GOAL, rest, rest, np.zeros((0, 7)))
    own = joint_limits(panda.limits)
    level = Level(Shape(7, Basis(14, 0.8)), node_functions(model, panda.body, own))
    u = np.linspace(0, 1, 60)
    share = u**3 * (10 - 15 * u + 6 * u**2)
    line = START + np.outer(share, GOAL - START)
    bent = fitted(level.shape, u, line + np.outer(np.sin(np.pi * u) ** 2, MIDDLE - START), ends, 2.0)
    task = Task(ends, own, model.values(7), (2.0, 2.0), 0.0)

    def solved(task: Task, curve: Curve) -> Outcome:
        return task.polished(level, task.descended(task.model(level), curve, 60, trust=0.2, tolerance=1e-5, give=1e-6))

    free = solved(task, bent)
    ball = OutsideBall(free.curve.position(np.array([0.5]))[0] + 0.02, 0.3)  # in the way, not about its centre
    held = solved(replace(task, limits=(*own, ball)), free.curve)
    near = [
        np.linalg.norm(found.curve.position(np.linspace(0.02, 0.98, 33)) - ball.centre, axis=1).min()
        for found in (free, held)
    ]
    assert free.converged and held.converged and near[0] < 0.1
    assert near[1] > 0.3 - 1e-6 and held.broken < 1e-6 and ball.asked >= 1


def passing(time: np.ndarray, position: np.ndarray) -> Trajectory:
    """A trajectory through rows, its derivatives by differences."""
    velocity = np.gradient(position, time, axis=0)
    names = tuple(f"j{k}" for k in range(position.shape[1]))
    return Trajectory(names, time, position, velocity, np.gradient(velocity, time, axis=0))


def test_via_points_are_looked_for_in_order_and_between_samples(panda: Robot, model: PowerModel) -> None:
    time = np.linspace(0, 2, 201)
    share = (time / 2) ** 3 * (10 - 15 * time / 2 + 6 * (time / 2) ** 2)
    trajectory = passing(time, START + np.outer(share, GOAL - START))
    scorer = Scorer(panda, model)

    def excess(*points: np.ndarray) -> float:
        violation = certify(trajectory, scorer, [ViaPoints(np.stack(points))]).violation
        return float(violation)

    def at(when: float) -> np.ndarray:
        return trajectory.sample(np.array([when]))[0][0]

    assert excess(at(0.73111), at(1.2007)) < -0.99  # to the rounding
    off = at(1.0) + 0.3 * np.eye(7)[3]
    fine = trajectory.sample(np.linspace(0, 2, 400_001))[0]
    nearest = fine[np.linalg.norm(fine - off, axis=1).argmin()]
    assert excess(off) == pytest.approx(np.abs(nearest - off).max() / PASSED - 1, rel=1e-5)
    assert excess(at(1.2007), at(0.73111)) > 1000  # the wrong way round


def test_a_path_and_a_warm_start_that_miss_the_via_point_are_no_answers(panda: Robot, model: PowerModel) -> None:
    from energy_opt.motion import Move
    from energy_opt.motion.path import straight

    planner = Planner(panda, model, Settings(starts=1, controls=16, compile="never"))
    plain = planner.solve(Move(START, GOAL, duration=1.6))
    move = Move(START, GOAL, duration=1.6, path=straight(START, GOAL), via=(MIDDLE,))
    result = planner.solve(move, warm=[plain.trajectory])
    dense = result.trajectory.sample(np.linspace(0, result.trajectory.duration, 200_001))[0]
    assert np.abs(dense - MIDDLE).max(axis=1).min() < 2 * PASSED
    assert result.certificate.max_violation["via"] <= 0
    assert planner.certify(plain.trajectory, move).max_violation["via"] > 10
