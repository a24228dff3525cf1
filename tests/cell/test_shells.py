"""A bin whose walls have no thickness is open; a solid whose surface has cracks is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from energy_opt.cell.cell import Cell
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.shells import is_open
from energy_opt.cell.solids import mesh
from energy_opt.robot import load_robot

OVER = np.array([0.0, 0.36, 0.0, -2.33, 0.0, 2.69, 0.785])  # a Panda with its hand over (0.5, 0, 0.25), pointing down


def box(height: float = 0.25, drop: int = 0, split: int = 0) -> np.ndarray:
    """Triangles of a box from z = 0 on, fine enough to leave some out: `drop` of them, or, with `split` the top."""
    body = trimesh.creation.box((0.5, 0.5, height))
    for _ in range(3):
        body = body.subdivide()
    body.apply_translation((0, 0, height / 2))
    triangles = np.asarray(body.triangles)
    if split:
        return triangles[~(triangles[:, :, 2] > height - 1e-9).all(axis=1)]
    return triangles[drop:]


def cracked() -> np.ndarray:
    """A closed box whose sides are separate meshes with other vertices along their common edges."""
    sides = []
    for k, count in zip(range(6), (2, 3, 4, 5, 6, 7), strict=True):
        u, v = np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, count), indexing="ij")
        flat = np.stack([u.ravel(), v.ravel(), np.full(u.size, float(k % 2))], axis=1)
        flat = np.roll(flat, k // 2, axis=1) - [0.5, 0.5, 0]
        i = np.arange(count * count).reshape(count, count)
        a, b, c, d = (x.ravel() for x in (i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]))
        sides.append(flat[np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])] * [0.5, 0.5, 0.25])
    return np.concatenate(sides)


@pytest.mark.parametrize(
    ("triangles", "expected"),
    [(box(), False), (box(drop=1), False), (box(drop=5), False), (cracked(), False), (box(split=1), True)],
)  # fmt: skip
def test_only_a_large_opening_counts(triangles: np.ndarray, expected: bool) -> None:
    assert is_open(triangles) is expected
    assert is_open(triangles[:, ::-1]) is expected


def test_a_closed_part_beside_an_open_one_stays_a_solid() -> None:
    assert not is_open(np.concatenate([box(split=1), 0.1 * box() + [0.0, 0.0, 0.05]]))
    assert is_open(np.concatenate([box(split=1), box(split=1) + [1.0, 0.0, 0.0]]))


def in_scene(triangles: np.ndarray, folder: Path, z: float = 0.0) -> Cell:
    body = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    body.apply_translation((0, 0, z))
    body.export(folder / "bin.stl")
    text = f"objects: [{{name: bin, type: mesh, file: bin.stl, position: [0.5, 0, {-z}], quaternion: [0, 0, 0, 1]}}]\n"
    (folder / "scene.yaml").write_text(text)
    cell = load_cell(load_robot("panda"), CellRequest(scene=folder / "scene.yaml"))
    assert cell is not None
    return cell


@pytest.mark.parametrize("z", [0.0, -0.25])
def test_a_hand_may_be_in_an_open_bin_and_not_in_a_closed_box(z: float, tmp_path: Path) -> None:
    """The volume that is computed for an open mesh depends on its origin: at the rim, the bin was a solid box."""
    assert in_scene(box(split=1), tmp_path, z).touching(OVER) is None
    for solid in (box(), box(drop=5), cracked()):
        contact = in_scene(solid, tmp_path, z).touching(OVER)
        assert contact is not None and "bin" in contact.pair


def test_walls_without_thickness_are_touched(tmp_path: Path) -> None:
    low = OVER + np.array([0, 0.35, 0, 0, 0, 0.35, 0])  # the fingers reach through the floor
    contact = in_scene(box(split=1), tmp_path).touching(low)
    assert contact is not None and "bin" in contact.pair
    open_bin = box(split=1)
    body = mesh(open_bin.reshape(-1, 3), np.arange(3 * len(open_bin)).reshape(-1, 3))
    assert body.shell and len(body.pieces) == 5
