"""Paths: what they pass through, how smooth they are."""

import numpy as np
import pytest

from energy_opt.motion.path import JointPath, of_trajectory, straight, through
from energy_opt.motion.timing.law import Timing
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.bspline import greville

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
