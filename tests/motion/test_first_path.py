"""First paths of real moves among real things: free as the proof says, and as poses far denser than its own say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene, SceneObject, Shape
from energy_opt.cell.scene_files import read_scene
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion.initial_paths import ompl
from energy_opt.motion.initial_paths.room import Room, steps
from energy_opt.motion.judge.clearance import clearance_along
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path import JointPath, straight, through
from energy_opt.motion.plan.planner import Planner
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

MBM = Path(__file__).parents[3] / "shared" / "data" / "mbm"
HOME = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
OVER = np.array([1.2, 0.2, 0.0, -1.9, 0, 2.1, 0.785])


def post(x: float, y: float) -> SceneObject:
    pose = np.eye(4)
    pose[:3, 3] = [x, y, 0.3]
    return SceneObject("post", (Shape("cylinder", (0.05, 1.2)),), pose)


@pytest.fixture(scope="module")
def cell(panda: Robot) -> Cell:
    """A post between the two poses, as far from the base as the hand."""
    return Cell(panda, CellRequest(), Scene((post(0.42, 0.3),)))


def planner(cell: Cell, model: PowerModel, initial_paths: int = 2) -> Planner:
    return Planner(cell.robot, model, Settings(initial_paths=initial_paths), cell=cell)


def free(cell: Cell, path: JointPath) -> bool:
    """By the proof, and by exact distances at poses far denser than the path's own."""
    dense = path(np.linspace(0, 1, 300))
    return clearance_along(cell, path).proven and not any(cell.distances(q, 0.001) for q in dense)


def test_a_way_around_a_post_is_free_and_the_straight_line_is_not(cell: Cell, model: PowerModel) -> None:
    with pytest.raises(Infeasible, match=r"the given path is not free: .*post") as caught:
        planner(cell, model).first_path(Move(HOME, OVER, "retime", path=straight(HOME, OVER)))
    assert caught.value.limit == "clearance" and 0 < (caught.value.position or 0) < 1
    move, source, others = planner(cell, model).first_path(Move(HOME, OVER, duration=4.0))
    assert source.source == "own" and move.path is not None and others and move.duration == 4.0
    assert all(free(cell, path) for path in (move.path, *others))
    again, _, _ = planner(cell, model).first_path(Move(HOME, OVER))
    assert again.path is not None and np.array_equal(again.path.coefficients, move.path.coefficients)


def test_a_way_around_a_post_passes_the_via_points(cell: Cell, model: PowerModel) -> None:
    """The second leg is not free; the path that is found passes the point exactly, and is the baseline too."""
    over = np.array([0.1, 0.1, 0.0, -2.0, 0, 2.1, 0.785])
    move, first, _ = planner(cell, model).first_path(Move(HOME, OVER, via=(over,), duration=5.0))
    assert first.source == "own" and move.path is not None and free(cell, move.path) and not first.blocked
    assert np.abs(move.path(np.linspace(0, 1, 20001)) - over).max(axis=1).min() < 1e-3


def test_a_path_through_via_points_keeps_the_position_limits(panda: Robot, model: PowerModel) -> None:
    """The spline through unevenly spaced points overshoots: a job was refused, a move had no baselines."""
    start = np.array([-2.0, -0.5, 0.0, -0.4, 0.0, 1.5, 0.0])
    via, goal = start + [0, 0, 0, 0.3, 0, 0, 0], start + [4, 0, 0, 0.25, 0, 0, 0]
    assert through(np.stack([start, via, goal]))(np.linspace(0, 1, 99)).max(axis=0)[3] > panda.limits.upper[3] + 0.2
    free_of_bodies = Planner(panda, model, Settings())
    move, _, _ = free_of_bodies.first_path(Move(start, goal, via=(via,)))
    q = move.path(np.linspace(0, 1, 2001))
    assert (q <= panda.limits.upper + 1e-9).all() and (q >= panda.limits.lower - 1e-9).all()
    assert np.abs(q - via).max(axis=1).min() < 5e-3 and free_of_bodies.timing(move).duration < 5.0
    via[3] = panda.limits.upper[3]  # a spline through it overshoots, however near its points are
    assert move.via[0][3] != via[3]  # a move keeps its own numbers
    move, _, _ = free_of_bodies.first_path(Move(start, goal, via=(via,)))
    q = move.path(np.linspace(0, 1, 20001))
    assert (q <= panda.limits.upper + 1e-9).all() and (q >= panda.limits.lower - 1e-9).all()
    assert np.abs(q - via).max(axis=1).min() < 1e-3 and free_of_bodies.timing(move).duration < 5.0


def test_one_search_serves_a_move_at_several_durations(
    cell: Cell, model: PowerModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    p = planner(cell, model, 1)
    shortest = p.minimum_time(Move(HOME, OVER))
    monkeypatch.setattr("energy_opt.motion.plan.planner.first_path", None)
    assert p.minimum_time(Move(HOME, OVER, duration=9.0)) == shortest


def test_an_end_that_touches_is_named_with_pair_and_depth(panda: Robot, model: PowerModel) -> None:
    blocked = Cell(panda, CellRequest(), Scene((post(0.31, 0.0),)))
    with pytest.raises(Infeasible, match=r"start: .*post.*mm deep") as caught:
        planner(blocked, model).solve(Move(HOME, OVER))
    for mode in ("retime", "reshape"):  # as a batch asks first; the straight line and the lack of a way were named
        with pytest.raises(Infeasible, match=r"^goal: .*post.*mm deep"):
            planner(blocked, model).minimum_time(Move(OVER, HOME, mode))
    assert caught.value.exit_code == 3 and caught.value.position == 0.0 and (caught.value.excess or 0) > 0.001
    assert "srdf" not in str(caught.value)
    folded = np.array([0, 0.5, 0, -3.0, 0, 0.1, 0])
    with pytest.raises(Infeasible, match=r"start: panda_.* touches panda_.*with srdf FILE, or use self_collision"):
        planner(Cell(panda, CellRequest()), model).solve(Move(folded, OVER))


@pytest.mark.slow
def test_without_a_way_it_says_what_would_help(
    panda: Robot, model: PowerModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Walls on both sides of the base's column and over it, between two poses whose elbows are on different sides.

    The elbow turns 0.316 m around the shoulder, 0.333 m above the floor. Where it crosses the plane of the walls it is
    more than 0.15 m from the column's axis, or above 0.61 m: in a wall. So no path exists, not even bent backwards.
    """
    start, goal = OVER.copy(), OVER.copy()
    start[[0, 1]], goal[[0, 1]] = (-0.6, 0.7), (1.8, 0.7)
    walls = []
    for k, (along, up, width, height) in enumerate(((0.75, 0, 1.2, 6), (-0.75, 0, 1.2, 6), (0, 1.8, 0.4, 2.5))):
        pose = np.eye(4)
        pose[:2, :2] = [[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]]
        pose[:3, 3] = pose[:3, :3] @ [along, 0, up]
        walls.append(SceneObject(f"wall {k}", (Shape("box", (width, 0.02, height)),), pose))
    monkeypatch.setattr(ompl, "installed", lambda: False)
    shut = Cell(panda, CellRequest(), Scene(tuple(walls)))
    with pytest.raises(Infeasible, match=r"pip install 'energy-opt\[plan\]'"):
        planner(shut, model).first_path(Move(start, goal, "retime"))
    # a sketch ignores bodies; it looked for a way around them, for many seconds per goal
    sketch = planner(shut, model).sketch(Move(start, goal, "retime", 4.0))
    assert sketch.duration == pytest.approx(4.0) and np.allclose(sketch.position[-1], goal)
    quick = Planner(panda, model, Settings(starts=1, controls=12, compile="never"), cell=shut)
    with pytest.raises(Infeasible, match=r"no way around was found; pip install .* nor did reshaping") as caught:
        quick.solve(Move(start, goal, duration=4.0))
    assert caught.value.limit == "clearance"
    with pytest.raises(BadInput, match="OMPL is not installed"):
        planner(Cell(panda, CellRequest(planner="ompl"), shut.scene), model).first_path(Move(start, goal))


def test_quick_poses_and_exact_distances_agree(cell: Cell) -> None:
    """A pose that the quick test takes is free by exact distances; most that it refuses are not (hulls are fatter)."""
    room = Room(cell, np.stack([HOME, OVER]))
    poses = np.random.default_rng(1).uniform(cell.robot.limits.lower, cell.robot.limits.upper, (150, 7))
    quick = np.array([room.clear(q) for q in poses])
    exact = np.array([not cell.distances(q, 0.003) for q in poses])
    assert 0.2 < exact.mean() < 0.95 and not np.any(quick & ~exact)
    assert np.mean(exact & ~quick) < 0.05


def test_steps_shorten_towards_the_base(panda: Robot) -> None:
    found = steps(panda.body.tree())
    assert np.all(np.diff(found) >= 0) and found[0] < 0.05 and found[-1] == 0.12


@pytest.mark.skipif(not MBM.is_dir(), reason="the problems' data are not beside the checkout")
@pytest.mark.parametrize("name", ["panda_table_pick_0070", "panda_bookshelf_tall_0070", "ur5_box_0033"])
def test_real_problems_are_solved_from_start_and_goal(name: str, panda: Robot, ur5: Robot, model: PowerModel) -> None:
    problem = next(p for p in json.loads((MBM / "problems.json").read_text())["problems"] if p["id"] == name)
    file = MBM / "scenes" / f"{name}.yaml"
    cell = Cell({"panda": panda, "ur5": ur5}[problem["robot"]], CellRequest(scene=file), read_scene(file))
    move, source, _ = planner(cell, model, 1).first_path(Move(np.array(problem["start"]), np.array(problem["goal"])))
    assert source.source in ("own", "ompl") and move.path is not None and free(cell, move.path)
