"""Ways around what stands between start and goal, in a world whose free poses are known in closed form."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene_files import read_scene
from energy_opt.motion.initial_paths import InitialPath, find_paths
from energy_opt.motion.initial_paths.find import Ends
from energy_opt.motion.initial_paths.polyline import Rounding, between
from energy_opt.motion.initial_paths.room import KEPT, LOOKED, Room
from energy_opt.motion.path import JointPath
from energy_opt.robot import load_robot

START, GOAL = np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
STEP = np.full(3, 0.05)


@dataclass
class Wall:
    """A wall across the first joint's zero, 0.2 rad thick, with a round hole; poses further out are free."""

    hole: np.ndarray
    radius: float
    margin: float = 0.01
    asked: list[np.ndarray] = field(default_factory=list)

    def room(self, q: np.ndarray) -> np.ndarray:
        """How far poses (N, 3) are from the wall, at most their true distance in rad, negative inside."""
        before = np.abs(q[:, 0]) - 0.1
        within = self.radius - np.linalg.norm(q[:, 1:] - self.hole, axis=1)
        return np.maximum(before, within)

    def clear(self, q: np.ndarray) -> bool:
        self.asked.append(q)
        return bool(self.room(q[None])[0] > self.margin)

    def unproven(self, path: JointPath) -> float | None:
        s = np.linspace(0, 1, 4001)
        bad = np.flatnonzero(self.room(path(s)) <= self.margin / 2)
        return float(s[bad[0]]) if bad.size else None


class Post(Wall):
    """A post around the third joint's axis, thick enough to be passed on either side."""

    def room(self, q: np.ndarray) -> np.ndarray:
        return np.linalg.norm(q[:, :2], axis=1) - 0.4


class Burrow(Wall):
    """Poses of five joints; only a bent burrow enters the half where the first is positive. The goal is at its end."""

    def __init__(self, radius: float) -> None:
        super().__init__(np.zeros(4), radius)
        t = np.linspace(0, 1.5, 60)
        self.axis = np.stack([t, 0.5 * np.sin(3 * t), 0.5 * np.cos(3 * t) - 0.5, 0 * t, 0 * t], axis=1)

    def room(self, q: np.ndarray) -> np.ndarray:
        off = np.linalg.norm(q[:, None] - self.axis, axis=2).min(axis=1)
        return np.maximum(-q[:, 0], self.radius - off)


def found_paths(
    wall: Wall, planner: str = "none", seed: int = 0, count: int = 1, half: float = 2.0
) -> list[InitialPath]:
    ends = Ends.of(START, GOAL, np.full(3, -half), np.full(3, half), np.ones(3))
    return find_paths(wall, ends, STEP, planner=planner, seed=seed, count=count)


def test_a_free_straight_line_is_the_path() -> None:
    (found,) = found_paths(Wall(np.zeros(2), 0.5))
    assert found.source == "straight" and found.length == pytest.approx(2.0)


@pytest.mark.parametrize("seed", range(3))
def test_lines_of_our_own_bend_through_a_hole(seed: int) -> None:
    wall = Wall(np.array([0.8, 0.3]), 0.4)
    (found,) = found_paths(wall, seed=seed)
    path = found.path
    assert found.source == "own" and wall.unproven(path) is None
    assert np.allclose(path.start, START, atol=1e-12) and np.allclose(path.goal, GOAL, atol=1e-12)
    inner = path.knots[1:-1]
    for order in range(3):  # C^2: timing wants it
        assert np.allclose(
            path(inner - 1e-9, order), path(inner, order), atol=1e-4 * max(1, np.abs(path(inner, order)).max())
        )
    assert 2.0 <= found.length < 2.6  # the hole's near edge alone asks for 0.4 sideways on either side
    (again,) = found_paths(wall, seed=seed)
    assert np.array_equal(again.path.coefficients, path.coefficients)


def test_what_our_own_lines_do_not_reach_a_planner_does_seeded() -> None:
    pytest.importorskip("ompl")
    wall = Wall(np.array([1.7, -1.7]), 0.15)
    assert found_paths(wall, "none") == []
    found = [found_paths(wall, "auto", seed) for seed in (0, 5, 0)]
    assert all(one.source == "ompl" and wall.unproven(one.path) is None for (one,) in found)
    first, other, again = (one.path for (one,) in found)
    assert np.array_equal(first.coefficients, again.coefficients)
    assert not np.array_equal(first.coefficients, other.coefficients)


def test_a_planner_ends_when_it_is_stopped() -> None:
    """A deadline did not end it: it checked some hundred thousand poses."""
    pytest.importorskip("ompl")
    wall = Wall(np.array([1.9, -1.9]), 0.02)
    ends = Ends.of(START, GOAL, np.full(3, -2.0), np.full(3, 2.0), np.ones(3))
    own = Wall(wall.hole, wall.radius)
    assert find_paths(own, ends, STEP, planner="none") == []
    assert find_paths(wall, ends, STEP, stopped=lambda: len(wall.asked) > len(own.asked) + 200) == []
    assert len(wall.asked) < len(own.asked) + 400


@pytest.mark.parametrize("seed", range(3))
def test_a_planner_finds_the_end_of_a_narrow_burrow(seed: int) -> None:
    pytest.importorskip("ompl")
    burrow = Burrow(0.15)
    ends = Ends.of(np.full(5, -1.0), burrow.axis[-1], np.full(5, -2.5), np.full(5, 2.5), np.ones(5))
    (found,) = find_paths(burrow, ends, np.full(5, 0.05), seed=seed)
    assert found.source == "ompl" and burrow.unproven(found.path) is None


@pytest.mark.parametrize(("clearance", "least"), [(0.0004, 0.0012), (0.002, 0.006), (0.02, 0.024)])
def test_poses_of_paths_keep_a_small_clearance_with_a_small_margin(
    clearance: float, least: float, tmp_path: Path
) -> None:
    """They kept 2 mm more at least, which closed the ways of an arm of a fifth of the size."""
    robot = load_robot("panda")
    scene = tmp_path / "scene.yaml"
    scene.write_text("objects: [{name: table, type: box, size: [0.8, 0.8, 0.2], position: [0.8, 0, 0.1]}]")
    cell = Cell(robot, CellRequest(clearance=clearance, self_collision=False), read_scene(scene))
    ends = np.array([[0, -0.785, 0, -2.356, 0, 1.571, 0.785], [1.0, -0.785, 0, -2.356, 0, 1.571, 0.785]])
    room, lowered = Room(cell, ends), np.linspace(ends[0], ends[0] + np.array([0, 1.8, 0, 0, 0, 0, 0]), 8001)
    first = next(q for q in lowered if not room.clear(q))
    assert min(d for _, d in cell.distances(first, 0.1)) == pytest.approx(least, abs=3e-4)


@pytest.mark.parametrize("clearance", [0.0005, 0.002, 0.05])
def test_the_check_of_poses_agrees_with_distances(clearance: float, tmp_path: Path) -> None:
    """Distances are the package's own; the check is coal's, which compares bounding boxes first."""
    robot = load_robot("panda")
    scene = tmp_path / "scene.yaml"
    scene.write_text("objects: [{name: block, type: box, size: [0.3, 0.2, 0.5], position: [0.5, 0, 0.3]}]")
    cell = Cell(robot, CellRequest(floor=-0.02, clearance=clearance), read_scene(scene))
    poses = np.random.default_rng(0).uniform(robot.limits.lower, robot.limits.upper, (400, robot.n))
    near = np.array([min((d for _, d in cell.distances(q, 0.2)), default=0.2) for q in poses])
    free = poses[np.argsort(-near)[:2]]
    room = Room(cell, free)
    clear = np.array([room.clear(q) for q in poses])
    kept = clearance + min(KEPT, clearance)
    margin = kept + min(LOOKED[0] * kept, LOOKED[1])
    assert 20 < clear.sum() < 380
    assert clear[near > margin + 1e-4].all() and not clear[near < margin - 1e-4].any()


def test_a_search_without_a_path_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ompl")
    monkeypatch.setattr("energy_opt.motion.initial_paths.find.POSES", 1_000)
    wall = Wall(np.array([9.0, 9.0]), 0.1)
    assert found_paths(wall, "auto") == []
    # two attempts each of 1,000, 2,000, 4,000, 8,000 and 16,000 poses, and our own lines
    assert 62_000 < len(wall.asked) < 74_000


def test_several_paths_are_different() -> None:
    found = found_paths(Post(np.zeros(2), 0.0), count=3)
    assert len(found) >= 2 and [w.length for w in found] == sorted(w.length for w in found)
    s = np.linspace(0, 1, 21)
    assert all(np.abs(a.path(s) - b.path(s)).max() > 0.1 for a, b in zip(found, found[1:], strict=False))


def test_rounding_leaves_a_line_only_near_corners_and_can_be_tightened() -> None:
    points = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [3.0, 1.0]])
    rounding = Rounding(points)
    before = rounding.reach.copy()
    assert np.allclose(before, 0.45) and rounding.tighter(2.1 / 4) and np.allclose(rounding.reach, [0.225, 0.45])
    assert not rounding.tighter(0.2)
    path = rounding.path()
    s = np.linspace(0, 1, 1001)
    line = np.column_stack([np.interp(4 * s, [0, 2, 3, 4], q) for q in points.T])
    off = np.linalg.norm(path(s) - line, axis=1)
    near = (np.abs(4 * s - 2) < 0.225) | (np.abs(4 * s - 3) < 0.45)
    assert off[~near].max() < 1e-12 and 0.02 < off[near].max() < 0.2
    assert Rounding.regular(path) and not Rounding.regular(Rounding(np.array([[0.0], [1.0], [0.0]])).path())


def test_a_line_is_looked_at_coarse_before_fine_and_everywhere() -> None:
    a, b = np.zeros(2), np.array([1.0, -0.5])
    seen = [float(q[0]) for q in between(a, b, np.array([0.1, 0.1]))]
    assert np.allclose(np.sort(seen), np.arange(1, 10) / 10) and 0.4 <= seen[0] <= 0.8
    assert not list(between(a, a + 0.05, np.full(2, 0.1)))
