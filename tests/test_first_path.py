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
from energy_opt.errors import Infeasible
from energy_opt.motion.move import Move
from energy_opt.motion.path import straight
from energy_opt.motion.plan.first_path import check_path, first_path
from energy_opt.motion.ways import ompl
from energy_opt.motion.ways.room import Room, steps
from energy_opt.robot import Robot

MBM = Path(__file__).parents[2] / "shared" / "data" / "mbm"
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


def test_a_way_around_a_post_is_free_and_the_straight_line_is_not(cell: Cell) -> None:
    with pytest.raises(Infeasible, match=r"the given path: panda_\w+ .*post.* % of its way") as caught:
        check_path(cell, straight(HOME, OVER))
    assert caught.value.limit == "clearance" and 0 < (caught.value.position or 0) < 1
    move, source, others = first_path(cell, Move(HOME, OVER), count=2)
    assert source.source == "own" and move.path is not None and others
    for path in (move.path, *others):
        check_path(cell, path)
        assert not any(cell.distances(q, 0.001) for q in path(np.linspace(0, 1, 500)))
    again, _, _ = first_path(cell, Move(HOME, OVER), count=2)
    assert again.path is not None and np.array_equal(again.path.coefficients, move.path.coefficients)


def test_a_given_path_is_kept_and_other_ways_come_beside_it(cell: Cell) -> None:
    given = Move(HOME, OVER, path=straight(HOME, OVER))
    move, source, others = first_path(cell, given, count=2)
    assert move is given and source.source == "given" and len(others) >= 1
    assert first_path(cell, given)[2] == []


def test_an_end_that_touches_is_named_with_pair_and_depth(panda: Robot) -> None:
    blocked = Cell(panda, CellRequest(), Scene((post(0.31, 0.0),)))
    with pytest.raises(Infeasible, match=r"start: .*post.*mm deep") as caught:
        first_path(blocked, Move(HOME, OVER))
    assert caught.value.exit_code == 3 and caught.value.position == 0.0 and (caught.value.excess or 0) > 0.001


def test_without_a_way_it_says_what_would_help(panda: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall from floor to ceiling between the two poses, all around the base but for the arm's own column."""
    walls, side = [], np.array([0.6, 0, 0, 0, 0, 0, 0])
    for k, turn in enumerate((0.6, 0.6 + np.pi)):
        pose = np.eye(4)
        pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        pose[:3, 3] = pose[:3, :3] @ [0.75, 0, 0]
        walls.append(SceneObject(f"wall {k}", (Shape("box", (1.2, 0.02, 6.0)),), pose))
    for planner, installed, says in [
        ("none", True, "planner auto"),
        ("auto", False, r"pip install 'energy-opt\[plan\]'"),
    ]:
        monkeypatch.setattr(ompl, "installed", lambda there=installed: there)
        shut = Cell(panda, CellRequest(planner=planner), Scene(tuple(walls)))  # type: ignore[arg-type]
        with pytest.raises(Infeasible, match=says):
            first_path(shut, Move(HOME - side, OVER + side))


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
def test_real_problems_are_solved_from_start_and_goal(name: str, panda: Robot, ur5: Robot) -> None:
    problem = next(p for p in json.loads((MBM / "problems.json").read_text())["problems"] if p["id"] == name)
    file = MBM / "scenes" / f"{name}.yaml"
    cell = Cell({"panda": panda, "ur5": ur5}[problem["robot"]], CellRequest(scene=file), read_scene(file))
    move, source, _ = first_path(cell, Move(np.array(problem["start"]), np.array(problem["goal"])))
    assert source.source in ("own", "ompl") and move.path is not None
    check_path(cell, move.path)
