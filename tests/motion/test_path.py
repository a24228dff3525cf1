"""Paths: what they pass through, how smooth they are."""

import numpy as np
import pytest

from energy_opt.motion.judge.certificate import certify
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.path import JointPath, of_trajectory, straight, through
from energy_opt.motion.retime.fastest import minimum_time
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.bspline import greville
from energy_opt.power import source_method_2
from energy_opt.robot import load_robot

WAYPOINTS = np.array([[0.0, 0.1], [0.7, 0.6], [1.1, -0.2], [1.5, -0.9]])


def derivatives_agree(path: JointPath, inside: np.ndarray) -> None:
    step = 1e-6
    for order in (1, 2, 3):
        slope = (path(inside + step, order - 1) - path(inside - step, order - 1)) / (2 * step)
        assert slope == pytest.approx(path(inside, order), rel=1e-6, abs=1e-6)


def test_straight_runs_evenly() -> None:
    path = straight([0.0, 1.0], [1.0, -1.0])
    s = np.array([0.0, 0.25, 1.0])
    assert path(s) == pytest.approx(np.array([[0, 1], [0.25, 0.5], [1, -1]]))
    assert path(s, 1) == pytest.approx(np.tile([1.0, -2.0], (3, 1)))
    assert not path(s, 2).any() and not path(s, 3).any()


def test_through_meets_every_waypoint_and_is_twice_continuous() -> None:
    path = through(WAYPOINTS)
    assert path(path.knots) == pytest.approx(WAYPOINTS)
    inner = path.knots[1:-1]
    for order in range(3):
        assert path(inner - 1e-12, order) == pytest.approx(path(inner + 1e-12, order), abs=1e-8)
    derivatives_agree(path, np.array([0.05, 0.3, 0.55, 0.9]))


def test_through_passes_over_repeated_waypoints() -> None:
    repeated = np.repeat(WAYPOINTS, [2, 1, 3, 1], axis=0)
    s = np.linspace(0, 1, 9)
    assert through(repeated)(s) == pytest.approx(through(WAYPOINTS)(s))


@pytest.mark.parametrize("points", [[[0.3, 0.2]], [[0.3, 0.2], [0.3, 0.2]]])
def test_a_path_of_no_length_does_not_move(points: list[list[float]]) -> None:
    path = through(np.array(points))
    assert not path.moves
    assert path.start == pytest.approx([0.3, 0.2]) and path.goal == pytest.approx([0.3, 0.2])


def test_a_tenth_of_a_milliradian_is_a_move() -> None:
    assert straight([0.0], [1e-4]).moves


def timed(start: float, goal: float) -> Trajectory:
    """A trajectory along the waypoints, with the given path speeds at its ends."""
    knots = np.linspace(0, 1, 60)
    g = greville(knots)
    control = start**2 + (goal**2 - start**2) * g + 2 * g * (1 - g) * (1.2 + np.sin(7 * g))
    return Timing(through(WAYPOINTS), knots, control).trajectory(("a", "b"))


@pytest.mark.parametrize(("start", "goal"), [(0.0, 0.0), (0.6, 0.0), (0.4, 0.9)])
def test_a_trajectorys_path_follows_it_and_keeps_its_end_velocities(start: float, goal: float) -> None:
    trajectory = timed(start, goal)
    path = of_trajectory(trajectory)
    s = np.linspace(0, 1, 400)
    dense = path(np.linspace(0, 1, 20001))
    assert max(np.linalg.norm(dense - q, axis=1).min() for q in trajectory.position) < 1e-4
    assert path(np.zeros(1), 1)[0] * path.start_speed == pytest.approx(trajectory.velocity[0], abs=1e-9)
    assert path(np.ones(1), 1)[0] * path.end_speed == pytest.approx(trajectory.velocity[-1], abs=1e-9)
    assert (np.linalg.norm(path(s, 1), axis=1) > 0.5).all()


def test_standing_still_on_the_way_leaves_no_trace() -> None:
    moving = timed(0.0, 0.0)
    wait = 0.5

    def padded(x: np.ndarray) -> np.ndarray:
        return np.concatenate([np.repeat(x[:1], 5, axis=0), x, np.repeat(x[-1:], 5, axis=0)])

    rest = np.linspace(0, wait, 6)
    time = np.concatenate([rest[:-1], moving.time + wait, moving.time[-1] + wait + rest[1:]])
    a = moving.acceleration.copy()
    a[[0, -1]] = 0
    waiting = Trajectory(moving.joints, time, padded(moving.position), padded(moving.velocity), padded(a))
    s = np.linspace(0, 1, 50)
    assert of_trajectory(waiting)(s) == pytest.approx(of_trajectory(moving)(s), abs=1e-3)


@pytest.mark.parametrize("end", [0.05, 0.5])
def test_the_path_of_a_straight_trajectory_is_as_fast_as_the_line(end: float) -> None:
    """Its points were spread unevenly by linear interpolation: 1 to 3 % slower, with jerks up to twice the limit."""
    robot, t = load_robot("z1"), np.arange(0.0, 2.5 + 1e-9, 0.02)
    x, by = (t / 2.5)[:, None], end * np.array([1.0, -0.5, 0.8, 0.3, -0.6, 0.2])
    start = np.array([0.1, 1.2, -1.0, 0.2, 0.1, 0.0])
    q, v = start + by * (10 * x**3 - 15 * x**4 + 6 * x**5), by * (30 * x**2 - 60 * x**3 + 30 * x**4) / 2.5
    path = of_trajectory(Trajectory(robot.joints, t, q, v, by * (60 * x - 180 * x**2 + 120 * x**3) / 2.5**2))
    limits, model = joint_limits(robot.limits), source_method_2(robot)
    fastest, line = (minimum_time(robot, model, p, limits) for p in (path, straight(start, start + by)))
    assert fastest.duration == pytest.approx(line.duration, rel=1e-4)
    assert certify(fastest.trajectory(robot.joints), Scorer(robot, model), limits).violation < 1e-3
