"""Dents of a front are found, and the mean of two motions is a motion between them."""

import numpy as np
import pytest

from energy_opt.fronts.dents import dents, mean_of
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.neighbour import Optimum
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import source_method_2
from energy_opt.robot import load_robot

HOME, WAY = np.array([0.0, 1.0, -1.0, 0.0, 0.0, 0.0]), np.array([0.5, 0.6, -0.4, 0.3, 0.2, -0.3])


def test_points_above_the_line_between_others_are_dents():
    d = np.linspace(1.0, 3.0, 9)
    convex = 2.0 + 1.0 / d
    assert dents(d, convex) == []
    bumped = convex.copy()
    bumped[4] += 0.1
    assert dents(d, bumped) == [(4, 3, 5)]
    bumped[5] += 0.12  # two beside each other hide behind one another, not behind the hull
    assert dents(d, bumped) == [(4, 3, 6), (5, 3, 6)]
    assert dents(d[:2], convex[:2]) == []


def moved(robot, duration, bow):
    """A cubic timing of a way that bows sideways."""
    time = np.linspace(0.0, duration, 101)
    x = time / duration
    s, v, a = x**2 * (3 - 2 * x), 6 * x * (1 - x) / duration, 6 * (1 - 2 * x) / duration**2
    side = bow * np.array([0, 1, 1, 0, 0, 0.0])
    q = HOME + np.outer(s, WAY) + np.outer(np.sin(np.pi * s) ** 2, side)
    slope, bend = np.pi * np.sin(2 * np.pi * s), 2 * np.pi**2 * np.cos(2 * np.pi * s)
    dq = np.outer(v, WAY) + np.outer(slope * v, side)
    return Trajectory(robot.joints, time, q, dq, np.outer(a, WAY) + np.outer(slope * a + bend * v**2, side))


def test_the_mean_of_two_motions_is_one_motion_between_them():
    robot = load_robot("z1")
    scorer = Scorer(robot, source_method_2("z1"))
    a, b = moved(robot, 2.0, 0.2), moved(robot, 4.0, -0.1)
    mean = mean_of(*(Optimum(t, scorer.energy(t), True) for t in (a, b)), 2.5, scorer.energy)
    expected = moved(robot, 2.5, 0.75 * 0.2 - 0.25 * 0.1)
    at = np.linspace(0.0, 2.5, 77)
    for ours, theirs in zip(mean.trajectory.sample(at)[:2], expected.sample(at)[:2], strict=True):
        assert ours == pytest.approx(theirs, abs=2e-5)
    assert mean.energy.total == pytest.approx(scorer.energy(expected).total, rel=1e-4)
