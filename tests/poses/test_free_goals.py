"""What a pose leaves free is used: by estimates, up to tolerances, and among the variables of the program."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from tool_poses import by_pinocchio, pose_at

from energy_opt.front.given import source_model
from energy_opt.front.models import rivals_from
from energy_opt.motion import Move, Planner, Settings, Trajectory
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.candidates import task_of
from energy_opt.motion.reshape.model import AXES
from energy_opt.motion.reshape.open import Open
from energy_opt.motion.reshape.task import Line
from energy_opt.numerics.quadratic import Banded
from energy_opt.poses.estimate import straight
from energy_opt.poses.freedom import Bent, PosedGoal, improved, inside, used
from energy_opt.poses.inverse import ToolKinematics, solve
from energy_opt.poses.pose import Freedom
from energy_opt.robot import load_robot

Program = tuple[Planner, Move, Trajectory, PosedGoal]


def curvature(h: Banded, d: np.ndarray) -> float:
    """d' H d, entry by entry."""
    n = len(h.band)
    out = 2 * d[:n] @ h.border @ d[n:] + d[n:] @ h.corner @ d[n:]
    for row, column in zip(*np.tril_indices(n), strict=True):
        if row - column < h.band.shape[1]:
            out += (1 if row == column else 2) * h.band[column, row - column] * d[row] * d[column]
    return float(out)


def test_a_tolerance_is_used_up_to_its_bound_and_not_beyond(ur: ToolKinematics) -> None:
    q = np.array([0.4, -1.2, 1.4, -1.1, -1.3, 0.3])
    pose = pose_at(ur, q, tolerance=(5e-3, np.radians(2)))
    wanted = np.array([0.9, 0.5, -0.3, 0.2, 0.1, -0.4])
    better = improved(ur, pose, q, lambda rows: rows @ wanted, None)
    off = by_pinocchio(ur.robot, better) @ np.linalg.inv(by_pinocchio(ur.robot, q))
    at = np.linalg.norm(by_pinocchio(ur.robot, better)[:3, 3] - by_pinocchio(ur.robot, q)[:3, 3])
    assert 0.999 * 5e-3 < at <= 5e-3
    angle = np.linalg.norm(pin.log3(off[:3, :3]))
    assert 0.999 * np.radians(2) < angle <= np.radians(2)


def test_along_a_free_axis_the_cheapest_positions_are_found(ur: ToolKinematics) -> None:
    q = np.array([0.4, -1.2, 1.4, -1.1, -np.pi / 2, 0.3])
    pose = pose_at(ur, q, free=(Freedom("rz", -0.5, 0.2),))
    better = improved(ur, pose, q, lambda rows: (rows[:, 5] - 3.0) ** 2, None)
    assert abs(better[5] - q[5]) == pytest.approx(0.5, abs=1e-6) or abs(better[5] - q[5]) == pytest.approx(
        0.2, abs=1e-6
    )
    free = pose_at(ur, q, free=(Freedom("rz"),))
    assert improved(ur, free, q, lambda rows: (rows[:, 5] - 1.1) ** 2, None)[5] == pytest.approx(1.1, abs=1e-3)


def test_positions_at_the_edge_of_what_is_possible_are_improved_inwards(ur: ToolKinematics) -> None:
    """A neighbour that is too far for the time costs infinitely much: the slope is that towards the other one."""
    q = np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.2])
    pose = pose_at(ur, q, free=(Freedom.of("rz"),))

    def cost(rows: np.ndarray) -> np.ndarray:
        return np.where(rows[:, 5] < q[5] + 1e-4, (rows[:, 5] - q[5] + 0.4) ** 2, np.inf)

    assert improved(ur, pose, q, cost, None)[5] == pytest.approx(q[5] - 0.4, abs=1e-3)
    assert np.array_equal(improved(ur, pose, q, lambda rows: np.full(len(rows), np.inf), None), q)


def test_a_bent_motion_costs_what_it_did_and_changes_as_the_straight_moves_do(ur: ToolKinematics) -> None:
    """Of a straight quintic, bent to another end, the straight quintic to that end is left."""
    scorers = [Scorer(ur.robot, rivals_from(["source-method-2"], None, ur.robot)[0][0].model)]
    start, goal, other = np.zeros(6), np.full(6, 0.5), np.full(6, 0.5) + 0.1 * np.eye(6)[2]
    x = np.linspace(0, 1, 200)[:, None]
    way, time = goal - start, 2.0 * x[:, 0]
    rows = Trajectory(
        ur.robot.joints, time, start + way * (x**3 * (10 - 15 * x + 6 * x**2)),
        way * (30 * x**2 * (1 - x) ** 2) / 2.0, way * (60 * x * (1 - x) * (1 - 2 * x)) / 4.0,
    )  # fmt: skip
    bent = Bent(scorers, rows, fixed=True)
    assert bent(None, goal[None])[0] == pytest.approx(scorers[0].energy(rows).total, rel=1e-4)
    expected = straight(scorers, start[None], other[None], np.array([2.0]))[0]
    assert bent(None, other[None])[0] == pytest.approx(expected, rel=1e-3)
    assert bent(start[None], other[None])[0] == bent(None, other[None])[0]


def test_potential_energy_is_that_of_pinocchio(ur: ToolKinematics) -> None:
    q = np.random.default_rng(4).uniform(-1.5, 1.5, (5, 6))
    model = pin.buildModelFromUrdf(str(ur.robot.urdf))
    data = model.createData()
    expected = [pin.computePotentialEnergy(model, data, row) for row in q]
    assert np.diff(Scorer(ur.robot, source_model(ur.robot)).potential(q)) == pytest.approx(np.diff(expected), abs=1e-9)


@pytest.fixture(scope="module")
def program() -> Program:
    """A Panda's move to a pose, its sketch, and its goal with the redundancy as its freedom."""
    robot = load_robot("panda")
    tool, planner = ToolKinematics(robot), Planner(robot, source_model(robot), Settings(starts=1))
    start, goal = np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]), np.array([0.9, 0.2, 0.3, -1.6, -0.4, 1.9, 0.1])
    move = Move(start, goal, "reshape", 2.0)
    return planner, move, planner.sketch(move), PosedGoal(tool, pose_at(tool, goal), goal, planner.scorer.potential)


def test_derivatives_by_the_goal_are_those_of_differences(program: Program) -> None:
    planner, move, sketch, goal = program
    context = planner.context(move)
    task = replace(task_of(context, move, sketch.duration, move.duration), open=Open(goal=goal))
    level = context.reshaper("energy").fine(0)
    model = task.model(level)
    point = model.at_curve(task.curve(level.shape, Line.of(sketch)))
    along = np.zeros(model.shape.size + model.border)
    along[model.shape.size :][model.toward] = 1.0

    def cost(step: float) -> float:
        return model.at(*model.moved(point, step * along)).cost

    assert model.gradient(point) @ along == pytest.approx((cost(1e-4) - cost(-1e-4)) / 2e-4, rel=1e-5)
    bend = (cost(4e-3) + cost(-4e-3) - 2 * cost(0.0)) / 16e-6
    assert curvature(model.hessian(point, {}), along) == pytest.approx(bend, rel=1e-2)


@pytest.fixture(scope="module")
def through(program: Program) -> tuple[Move, Open]:
    """The same move, begun at a pose and through one, all with the redundancy as their freedom."""
    planner, move, sketch, goal = program
    tool, via = ToolKinematics(planner.robot), sketch.sample(np.array([0.9]))[0][0] + 0.1
    start, on_way = (PosedGoal(tool, pose_at(tool, q), q, planner.scorer.potential) for q in (move.start, via))
    return replace(move, via=(via,)), Open(start, goal, (on_way,))


def test_derivatives_by_start_and_via_point_are_those_of_differences(
    program: Program, through: tuple[Move, Open]
) -> None:
    planner, sketch = program[0], program[2]
    move, open_ = through
    context = planner.context(move)
    task = replace(task_of(context, move, sketch.duration, move.duration), open=open_)
    level = context.reshaper("energy").fine(1)
    model = task.model(level)
    point = model.at_curve(task.curve(level.shape, Line.of(sketch)))
    force, rng = np.zeros(7 + AXES), np.random.default_rng(2)
    force[:6] = rng.normal(size=6)
    pull = force[: len(point.passed[0].slope)] @ point.passed[0].slope
    hessian, gradient = model.hessian(point, {"via": force}), model.gradient(point)

    def lagrangian(step: np.ndarray) -> tuple[float, float]:
        at = model.at(*model.moved(point, step))
        return at.cost, float(at.via[0] @ pull)

    assert model.border == 3
    for column in range(3):  # the start's freedom, the goal's, the via point's time
        step = np.zeros(model.shape.size + 3)
        step[: model.shape.size] = 0.1 * rng.normal(size=model.shape.size) if column == 2 else 0.0
        step[model.shape.size + column] = 1.0 if column < 2 else 0.02
        (here, pulled), *around = (lagrangian(size * step) for size in (0.0, 1e-4, -1e-4, 4e-3, -4e-3))
        assert gradient @ step == pytest.approx((around[0][0] - around[1][0]) / 2e-4, rel=1e-4, abs=1e-5)
        bend = sum(map(sum, around[2:])) - 2 * (here + pulled)
        assert curvature(hessian, step) == pytest.approx(bend / 16e-6, rel=2e-2)


@pytest.mark.slow
def test_no_step_of_start_or_via_point_leads_to_a_cheaper_answer(program: Program, through: tuple[Move, Open]) -> None:
    planner, sketch = program[0], program[2]
    move, open_ = through
    fixed = planner.score(planner.settle(move, sketch, Open(goal=open_.goal))[0]).total
    answer, via = planner.settle(move, sketch, open_)
    assert planner.score(answer).total < fixed - 0.1
    best = replace(move, start=answer.position[0], goal=answer.position[-1], via=via)
    for q, place in ((move.start, best.start), (move.via[0], via[0])):
        assert np.abs(by_pinocchio(planner.robot, place) - by_pinocchio(planner.robot, q)).max() < 1e-8
    least = planner.score(planner.settle(best, answer)[0]).total
    for size in (0.05, -0.05):
        start = open_.start.reached(best.start, size * open_.start.along(best.start)[0])
        on_way = open_.via[0].reached(via[0], size * open_.via[0].along(via[0])[0])
        for other in (replace(best, start=start), replace(best, via=(on_way,))):
            assert planner.score(planner.settle(other, answer)[0]).total > least - 1e-5


@pytest.mark.parametrize(("name", "inside"), [("ur5e", True), ("panda", False)])
def test_no_step_along_the_freedom_leads_to_a_cheaper_answer(name: str, inside: bool, program: Program) -> None:
    """By motions that are solved anew, each to an end moved along what the pose leaves free."""
    planner, move, sketch, goal = program
    if inside:  # the other one ends at the limit of a joint
        robot = load_robot(name)
        tool, planner = ToolKinematics(robot), Planner(robot, source_model(robot), Settings(starts=1))
        move = Move(
            np.array([0.2, -1.5, 1.4, -1.4, -1.5, 0.1]), np.array([1.1, -1.2, 1.6, -1.0, -1.2, 0.9]), "reshape", 1.5
        )
        goal = PosedGoal(tool, pose_at(tool, move.goal, free=(Freedom("rx"),)), move.goal, planner.scorer.potential)
        sketch = planner.sketch(move)
    answer, _ = planner.settle(move, sketch, Open(goal=goal))
    q = answer.position[-1]

    def energy(step: np.ndarray) -> float:
        return planner.solve(replace(move, goal=goal.reached(q, step)), [answer]).energy.total

    along, here = goal.along(q)[0], energy(np.zeros(len(q)))
    assert here == pytest.approx(planner.score(answer).total, abs=2e-2)
    plus, minus = energy(5e-3 * along), energy(-5e-3 * along)
    if inside:
        ends = [goal.reached(move.goal, step * goal.along(move.goal)[0]) for step in (5e-3, -5e-3)]
        before = [planner.solve(replace(move, goal=end)).energy.total for end in ends]
        assert abs(plus - minus) < 0.01 * abs(before[0] - before[1])
    else:
        limits = planner.robot.limits
        assert np.minimum(q - limits.lower, limits.upper - q).min() < 1e-9
    assert min(plus, minus) > here - 1e-5


def test_a_tolerance_is_used_where_a_free_range_has_ended(ur: ToolKinematics) -> None:
    """At the end of a free shift, turning the pose shifts the tool: what is taken of the tolerance leaves room."""
    q = np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.2])
    free = (Freedom.of("rz:-30:30"), Freedom.of("x:-40:40"))
    pose = pose_at(ur, q, free=free, tolerance=(1e-3, np.radians(1)))
    shift = np.eye(4)
    shift[0, 3] = 0.04
    end, error = solve(ur, replace(pose, matrix=pose.matrix @ shift, free=()), q[None])
    assert error[0] < 1e-9
    for slope in np.random.default_rng(3).normal(size=(8, 6)):
        found = used(ur, pose, end[0], lambda rows, slope=slope: rows @ slope)
        assert found is not None and slope @ found[1] < slope @ end[0]
        assert inside(ur, pose, found[1])
