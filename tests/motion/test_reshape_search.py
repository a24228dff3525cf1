"""The search among local optima: one of every valley is compared, and at the move's own duration."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from poses import GOAL, START

from energy_opt import optimize
from energy_opt.batches.tables import random_moves
from energy_opt.conditions import ToolAcceleration
from energy_opt.effects import CoulombFriction
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.path import straight
from energy_opt.motion.plan.candidates import task_of
from energy_opt.motion.reshape.curve import Curve, Outcome
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.search import Reshaper
from energy_opt.motion.reshape.starts import valleys
from energy_opt.motion.reshape.task import Line, Task, at_most
from energy_opt.numerics.bspline import Basis
from energy_opt.power import source_method_2
from energy_opt.robot import load_robot

SHAPE = Shape(1, Basis(12))
NOTHING = np.zeros(0)
TASK = Task(Ends(*4 * [np.zeros(1)], np.zeros((0, 1))), (), NOTHING, (1.0, 1.0), 0.0)


def two_wells(points, duration, task):
    """Costs with minima 1 and 2 at control points of -1 and 1, flat to the left of -1."""
    x = np.maximum(points.mean(axis=(1, 2)), -1.0)
    return 1.5 + x / 2 + 4 * (1 - x * x) ** 2, {}


def outcome(x, broken=0.0):
    curve = Curve(SHAPE, np.full((12, 1), x), 1.0, NOTHING)
    cost = float(two_wells(curve.points[None], 1.0, TASK)[0][0])
    return Outcome(curve, cost, broken, True, "", 1)


def test_a_ridge_parts_valleys_and_distance_does_not():
    level = SimpleNamespace(shares=two_wells)
    far, low, high, broken = outcome(-5.0), outcome(-1.0), outcome(1.0), outcome(0.99, broken=0.5)
    assert [o.cost for o in valleys(level, TASK, [high, low, far])] == [1.0, 2.0]
    assert list(valleys(level, TASK, [broken, high])) == [high, broken]  # what breaks a limit answers for nothing


@pytest.mark.slow
def test_the_best_optimum_is_found_where_few_control_points_rank_it_third():
    """At this seed the answer was 69 % above: three optima of one valley had been kept, at half as long a duration."""
    robot = load_robot("ur5")
    named = random_moves(robot, 10, 5)[1]
    planner = Planner(robot, source_method_2("ur5"), Settings(seed=1, compile="never"))
    move = Move(named.start, named.goal, duration=3.433276775595123)
    assert planner.solve(move).energy.loss <= 7.15


@pytest.mark.slow
def test_searches_under_dry_friction_find_what_wide_kinks_lead_to():
    """With friction on every joint Newton's steps from a kink lead nowhere: the search begins with wide kinks, and
    makes nodes convex one by one. IPOPT took 1,000 iterations to 13.09 J; another start's answer was 18.5 J."""
    robot = load_robot("ur5e")
    named = random_moves(robot, 1, 3)[0]
    model = source_method_2("ur5e") + CoulombFriction(tau_c=0.02 * robot.limits.effort)
    result = Planner(robot, model, Settings(starts=2, compile="never")).solve(
        Move(named.start, named.goal, duration=2.0)
    )
    assert result.status == "solved" and result.energy.loss < 17.3


@pytest.mark.slow
def test_friction_of_a_slow_move_is_not_rounded_away():
    """A move in 60 times its shortest duration: kinks rounded as for a fast one lead to 98 J."""
    start, goal = [-2.801, -0.005, 0.383, -3.554, -2.655, 3.229], [-3.239, -2.791, 1.69, 0.919, -0.988, 0.086]
    result = optimize("ur5e", "careful", start=start, goal=goal, duration=97.0, starts=2, self_collision=False)
    assert result.status == "solved" and result.energy.loss < 87


def test_a_search_is_not_repeated_from_where_it_led_to_nothing_better(monkeypatch):
    """The second descent costs less and breaks its limits more. Twenty equal ones took minutes near a least time."""
    descents = []

    def descended(self, model, guess, *rest, **named):
        descents.append(guess)
        first = len(descents) == 1
        return replace(outcome(1.0 if first else -1.0, 1e-3 if first else 2e-3), converged=False)

    monkeypatch.setattr(Task, "descended", descended)
    monkeypatch.setattr(Task, "polished", lambda self, level, found: found)
    reshaper = Reshaper(SimpleNamespace(kinked=False), 1, 12, True, polished=False)
    monkeypatch.setattr(reshaper, "_level", lambda shape: None)
    monkeypatch.setattr(Task, "model", lambda self, level: None)
    found = reshaper.solved(outcome(1.0).curve, TASK)
    assert len(descents) == 2 and found.broken == 1e-3


@pytest.mark.slow
def test_a_search_with_kinks_continues_while_it_improves():
    """A slow and short move under published friction, which ended as not converged."""
    start = [-0.892177, -0.634797, -1.505717, -0.271708, -0.177188, -1.580148]
    goal = [-0.893169, -0.594056, -1.650017, -0.204278, -0.210586, -1.440509]
    via = [-0.880687, -0.580030, -1.558168, -0.189328, -0.200243, -1.540328]
    found = optimize(robot="ur10e", start=start, goal=goal, via=[via], duration=3.829)
    assert found.status == "solved", found.message


def test_a_step_that_is_corrected_holds_its_via_point_once():
    """Via points at two linearisations at once left no step: the search stopped with 2.7035 J, its path in a detour."""
    start = [0.771896, 0.672325, 0.243215, 0.909219, -1.436149, -1.065632]
    goal = [0.812997, 0.701066, 0.210269, 1.037274, -1.515227, -1.156208]
    via = [0.728005, 0.740156, 0.278774, 0.907118, -1.419359, -1.146870]
    found = optimize(
        "ur5", model="source-method-2", start=start, goal=goal, via=[via], mode="reshape", duration=0.7,
        end_acceleration="free", conditions=[ToolAcceleration(4.106)], self_collision=False,
    )  # fmt: skip
    assert found.status == "solved" and found.energy.loss < 2.69


def test_the_answer_is_an_optimum_that_ipopt_cannot_better(panda, model):
    """The search alone comes to the same as IPOPT from there, at a saddle of the search too (see `sqp.SADDLE`)."""
    planner = Planner(panda, model, Settings(starts=2, compile="never", solver="sqp"))
    move = Move(START, GOAL, duration=2.0)
    context = planner.context(move)
    reshaper, task = context.reshaper("energy"), task_of(context, move, 2.0, 2.0)
    found = reshaper.search(task, [Line.along(straight(START, GOAL), 2.0)], 2, 0, lambda: False).best
    polished = task.polished(reshaper.fine(0), found)
    assert polished.converged and task.cost(found) < task.cost(polished) * (1 + 1e-6)


def test_a_search_whose_cost_still_falls_goes_on() -> None:
    """A hanging arm: 240 iterations each saved a little, and the search ended as if no step lowered the energy."""
    result = optimize(
        load_robot("panda"), start=START, goal=GOAL, duration=2.0, base=(0, 0, 2, np.pi, 0, 0.5), self_collision=False
    )
    assert result.status == "solved"
    losses = [model["loss"] for model in result.models[:2]]
    assert np.mean(losses) < 3.7  # 3.76 where it had ended


def test_costs_below_zero_are_compared_as_others() -> None:
    """The rounded clamp of power takes slow falls below zero: then no outcome was near the best, which is itself."""
    assert at_most(2.0, 1.5) == 3.0 and at_most(-2.0, 1.5) == -1.0
    curve = Curve(SHAPE, np.zeros((12, 1)), 1.0, NOTHING)
    held, broken = (Outcome(curve, -1.0, excess, True, "", 1) for excess in (0.0, 0.1))
    assert TASK.promise(held) < TASK.promise(broken)


def test_a_search_without_iterations_left_says_so() -> None:
    move = Move(START, GOAL, duration=2.0)
    context = Planner(load_robot("panda"), source_method_2()).context(move)
    task, level = task_of(context, move, 1.0, 2.0), context.reshaper("energy").fine(0)
    line = Line.along(straight(START, GOAL), 2.0)
    short = task.descended(task.model(level), task.curve(level.shape, line), 3, trust=0.01, tolerance=1e-6)
    assert not short.converged and short.iterations >= 3 and "all its iterations were spent" in short.why
