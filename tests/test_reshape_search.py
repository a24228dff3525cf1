"""The search among local optima: one of every valley is compared, and at the move's own duration."""

from types import SimpleNamespace

import numpy as np
import pytest

from energy_opt.bench.moves import random_moves
from energy_opt.effects import CoulombFriction
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.reshape.curve import Curve, Multipliers, Outcome
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.level import Level
from energy_opt.motion.reshape.starts import valleys
from energy_opt.motion.reshape.task import Task
from energy_opt.numerics import ipopt
from energy_opt.numerics.bspline import Basis
from energy_opt.power import source_method_2
from energy_opt.robot import load_robot

SHAPE = Shape(1, Basis(12))
NOTHING = np.zeros(0)
TASK = Task(Ends(*4 * [np.zeros(1)], np.zeros((0, 1))), (), NOTHING, (1.0, 1.0), 0.0)


def two_wells(curve, parameters, limits):
    """A cost with minima 1 and 2 at control points of -1 and 1, flat to the left of -1."""
    x = max(float(curve.points.mean()), -1.0)
    return 1.5 + x / 2 + 4 * (1 - x * x) ** 2, {}


def outcome(x, broken=0.0):
    curve = Curve(SHAPE, np.full((12, 1), x), 1.0, NOTHING)
    cost = two_wells(curve, NOTHING, ())[0]
    return Outcome(curve, cost, broken, True, "", 1, NOTHING, Multipliers(NOTHING, NOTHING, NOTHING))


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
def test_searches_under_dry_friction_are_carried_to_their_ends(monkeypatch):
    """With friction on every joint a coarse search took more steps than it was given, and optima were told apart by
    where they had been left."""
    robot, ends = load_robot("panda"), []
    named = random_moves(robot, 5, 1)[4]
    model = source_method_2("panda") + CoulombFriction(tau_c=0.02 * robot.limits.effort)
    solve = Level.solve

    def noted(self, *args, **kwargs):
        ends.append(solve(self, *args, **kwargs))
        return ends[-1]

    monkeypatch.setattr(Level, "solve", noted)
    Planner(robot, model, Settings(starts=2, compile="never")).solve(Move(named.start, named.goal, duration=2.0))
    assert max(end.iterations for end in ends) > 60 and all(end.converged for end in ends)


def test_where_ipopt_spends_its_iterations_steps_of_sequential_programming_answer(monkeypatch):
    """Under dry friction every start and every round of one spent all its iterations, up to a minute and more, and the
    answer was the worse for it: 175 J where other starts' curves took 138 J."""
    robot, spent, solve = load_robot("ur5e"), [], ipopt.solve
    named = random_moves(robot, 1, 3)[0]
    move = Move(named.start, named.goal, duration=2.0)
    settings = Settings(starts=4, compile="never")
    usual = Planner(robot, source_method_2("ur5e"), settings).solve(move)

    def noted(*args, **kwargs):
        answer = solve(*args, **kwargs)
        spent.append(answer.status == ipopt.EXHAUSTED)
        return answer

    monkeypatch.setattr(ipopt, "solve", noted)
    monkeypatch.setattr("energy_opt.motion.reshape.starts.ITERATIONS", 3)
    result = Planner(robot, source_method_2("ur5e"), settings).solve(move)
    assert result.status == "solved" and result.energy.loss <= 1.01 * usual.energy.loss
    assert sum(spent) == 1  # the first start's; the others begin with sequential quadratic programming
