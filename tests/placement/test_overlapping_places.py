"""A base or a fixture is not placed inside another body."""

from __future__ import annotations

import re
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from tool_poses import JOB

from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.standing import Standing
from energy_opt.errors import Infeasible
from energy_opt.front.given import source_model
from energy_opt.jobs.file import load_job
from energy_opt.motion import Settings
from energy_opt.placement import PlaceRequest, place
from energy_opt.placement.base_search import Search
from energy_opt.robot import load_robot
from energy_opt.robot.kinematics import pose_of

# A table 0.5 m high under the base, a pallet on it that begins at y = 0.4, a tray beside the arm, and a wall at x = -1.
SCENE = """objects:
  - {name: table, type: box, size: [2, 3, 0.5], position: [0, 0, 0.25]}
  - {name: pallet, type: box, size: [0.4, 0.4, 0.12], position: [0, 0.6, 0.56]}
  - {name: tray, type: box, size: [0.2, 0.2, 0.05], position: [0.6, 0, 0.525]}
  - {name: wall, type: plane, position: [-1, 0, 0], quaternion: [0, 0.70710678, 0, 0.70710678]}
"""


def standing(folder: Path, moved: str | None, more: str = "", height: float = 0.5) -> Standing:
    (folder / "scene.yaml").write_text(SCENE + more)
    request = CellRequest(scene=folder / "scene.yaml", base=(0.0, 0.0, height, 0.0, 0.0, 0.0))
    cell = load_cell(load_robot("ur5e"), request)
    assert cell is not None
    return Standing(cell, moved)


@pytest.mark.parametrize(
    ("x", "y", "z", "says"),
    [
        (0.3, -0.5, 0.0, None),  # elsewhere on its table
        (0.0, 0.6, 0.12, None),  # on the pallet
        (0.0, 0.6, 0.0, "base_link_inertia would be 9?[0-9]+.* mm deep in pallet"),
        (0.0, -0.5, -0.05, "base_link_inertia would be 50 mm deep in table"),
        (-1.5, 0.0, 0.0, None),  # on the other side of the wall
        (-1.0, 0.0, 0.0, "deep in wall"),
    ],
)
def test_a_base_stands_on_bodies_and_not_in_them(
    tmp_path: Path, x: float, y: float, z: float, says: str | None
) -> None:
    found = standing(tmp_path, None).overlap(pose_of((x, y, z)))
    assert found is None if says is None else re.search(says, found or "")


def test_what_overlaps_as_given_or_is_allowed_may_overlap(tmp_path: Path) -> None:
    sunk = standing(tmp_path, None, height=0.47)
    assert sunk.overlap(pose_of((0.3, -0.5, 0.0))) is None
    assert sunk.overlap(pose_of((0.3, -0.5, -0.03))) == "base_link_inertia would be 60 mm deep in table"
    allowed = standing(tmp_path, None, "allow: [[base_link_inertia, pallet]]")
    assert allowed.overlap(pose_of((0.0, 0.6, 0.0))) is None


def test_a_fixture_is_put_into_no_body_and_not_into_the_base(tmp_path: Path) -> None:
    tray = standing(tmp_path, "tray")
    assert tray.overlap(pose_of((0.0, 0.3, 0.0))) is None
    assert tray.overlap(pose_of((-0.6, 0.6, 0.02))) == "tray would be 70 mm deep in pallet"
    base = tray.overlap(pose_of((-0.6, 0.0, 0.0)))
    assert base is not None and base.endswith("in base_link_inertia")


POSED = "objects: [{{name: box, type: box, size: [0.3, 0.3, 0.3], position: [{}]}}]\n"


@pytest.mark.parametrize(
    ("position", "more", "says"),
    [
        ("0.45, 0.2, 0.1", "", r"part: no placement .* wrist_3_link touches box \(150 mm.* tool names"),
        ("-0.2, 0.5, 0.2", "", r"\(place\): no placement is possible; wrist_3_link touches box"),
        ("0.45, 0.2, 0.1", "allow: [[wrist_3_link, box]]", None),
        ("0.45, 0.394, 0.1", "", None),  # the wrist is a little way inside
        ("0.9, 0.2, 0.1", "", None),
    ],
)
def test_a_tool_inside_a_body_wherever_the_base_is_is_refused_at_once(
    tmp_path: Path, position: str, more: str, says: str | None
) -> None:
    """It was refused after a search of a minute and a half, without advice."""
    robot, path, scene = load_robot("ur5e"), tmp_path / "job.toml", tmp_path / "scene.yaml"
    path.write_text(JOB)
    scene.write_text(POSED.format(position) + more)
    box = PlaceRequest((-0.4, -0.3, -0.1, 0.1, 0.0, 0.0))
    job, cell = load_job(path, lambda _: robot), CellRequest(scene=scene)
    search = Search(job, source_model(robot), box, Settings(), cell, lambda: False, lambda *_: None)
    with nullcontext() if says is None else pytest.raises(Infeasible, match=says):
        search.check_tool()


@pytest.mark.parametrize(("pose", "says"), [("-0.65, 0.3, 0.1", None), ("0, 0, 0", "wrist_3_link touches box")])
def test_of_a_fixture_only_poses_in_its_frame_are_refused_at_once(tmp_path: Path, pose: str, says: str | None) -> None:
    """`part` is inside of it, but stays where it is when it moves."""
    robot, path, scene = load_robot("ur5e"), tmp_path / "job.toml", tmp_path / "scene.yaml"
    path.write_text(JOB.replace("world: -0.2, 0.5, 0.2", f"box: {pose}"))
    scene.write_text(POSED.format("0.45, 0.2, 0.1"))
    box, cell = PlaceRequest((0.4, 0.8, 0.2, 0.3, 0.1, 0.1), fixture="box"), CellRequest(scene=scene)
    job = load_job(path, lambda _: robot)
    search = Search(job, source_model(robot), box, Settings(), cell, lambda: False, lambda *_: None)
    with nullcontext() if says is None else pytest.raises(Infeasible, match=says):
        search.check_tool()


def test_a_box_inside_of_bodies_is_refused_with_both_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The base was put into the pallet, and the answer was solved."""
    robot, path = load_robot("ur5e"), tmp_path / "job.toml"
    path.write_text(JOB)
    (tmp_path / "scene.yaml").write_text(
        "objects: [{name: pallet, type: box, size: [0.5, 0.5, 0.12], position: [-0.35, 0, 0.06]}]"
    )
    monkeypatch.setattr(Search, "solve", lambda *_: None)
    job, box = load_job(path, lambda name: robot), PlaceRequest((-0.4, -0.3, -0.1, 0.1, 0.0, 0.0), looked_at=3)
    cell = CellRequest(scene=tmp_path / "scene.yaml")
    with pytest.raises(Infeasible, match=r"base_link_inertia would be .* mm deep in pallet"):
        place(job, source_model(robot), box, cell=cell)
    search = Search(job, source_model(robot), box, Settings(), cell, lambda: False, lambda *_: None)
    assert search.ends_at(np.array([-0.35, 0.0, 0.0, 0.0]), {}) is None
