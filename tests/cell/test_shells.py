"""What a surface bounds: nothing in a bin whose walls have no thickness or a scan, the inside of a cracked solid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from energy_opt.cell.cell import Cell
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.shells import enclosed
from energy_opt.cell.solids import Solid, mesh
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
        one = flat[np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])] * [0.5, 0.5, 0.25]
        sides.append(one[:, :: 1 if k % 2 else -1])
    return np.concatenate(sides)


def solid(triangles: np.ndarray) -> Solid:
    return mesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


def holds(body: Solid, *point: float) -> bool:
    """Is a point within the body?"""
    return body.convex or enclosed(np.array([point]), body.inside)


@pytest.mark.parametrize(
    ("triangles", "expected"),
    [(box(), True), (box(drop=1), True), (box(drop=5), True), (cracked(), True), (box(split=1), False)],
)  # fmt: skip
def test_only_a_large_opening_counts(triangles: np.ndarray, expected: bool) -> None:
    for way in (1, -1):
        assert holds(solid(triangles[:, ::way]), 0.02, 0.01, 0.05) is expected


def test_a_closed_part_beside_an_open_one_stays_a_solid() -> None:
    body = solid(np.concatenate([box(split=1), 0.1 * box() + [0.0, 0.0, 0.05]]))
    assert holds(body, 0, 0, 0.06) and not holds(body, 0.2, 0, 0.02)
    assert not holds(solid(np.concatenate([box(split=1), box(split=1) + [1.0, 0.0, 0.0]])), 0, 0, 0.02)


@pytest.mark.parametrize("count", [20, 80])
@pytest.mark.parametrize("holes", [0, 12])
@pytest.mark.parametrize("below", [0.0, 1.3])
def test_a_scan_is_a_surface_at_any_size_and_with_holes(count: int, holes: int, below: float) -> None:
    """Beyond 5,000 triangles or 4 rims, it was a solid, by a volume that depends on its origin."""
    x, y = np.meshgrid(*2 * [np.linspace(-0.5, 0.5, count)])
    at = np.stack([x, y, 0.1 * np.cos(9 * x) * np.cos(7 * y) - below], axis=2)
    a, b, c, d = (at[i : i + count - 1, j : j + count - 1].reshape(-1, 3) for i in (0, 1) for j in (0, 1))
    triangles = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    gone = np.random.default_rng(0).choice(len(a), holes, replace=False)
    body = solid(np.delete(triangles, np.concatenate([gone, gone + len(a)]), axis=0))
    assert not body.convex and not len(body.inside)


def test_bodies_that_a_file_holds_twice_are_not_filled() -> None:
    """Three boxes of which the lower joins the other two; the gap is free."""
    jaw = box() - [0.0, 0.0, 0.125]
    sizes, places = ([0.4, 0.5, 1], [0.4, 0.5, 1], [0.4, 1.6, 0.16]), ([0, -0.26, 0], [0, 0.26, 0], [0, 0, -0.145])
    slot = np.concatenate([jaw * size + at for size, at in zip(sizes, places, strict=True)])
    for triangles in (slot, np.concatenate([slot, slot]), np.concatenate([slot, slot[:, [1, 2, 0]]])):
        body = solid(triangles)
        assert not holds(body, 0, 0, 0) and holds(body, 0, 0.26, 0) and len(body.pieces) > 1


@pytest.mark.parametrize("way", [1, -1])
def test_a_cavity_is_hollow_whichever_way_its_surface_faces(way: int) -> None:
    inner = 0.8 * (box() - [0, 0, 0.125]) + [0, 0, 0.125]
    nut = np.concatenate([box(), inner[:, ::way], 0.1 * (box() - [0, 0, 0.125]) + [0, 0, 0.125]])
    body = solid(nut)
    assert holds(body, 0.23, 0, 0.125) and not holds(body, 0.1, 0, 0.125) and holds(body, 0, 0, 0.125)


def test_bodies_that_overlap_are_solid_where_they_do() -> None:
    body = solid(np.concatenate([box(), 0.5 * box() + [0.25, 0.0, 0.05]]))
    assert holds(body, 0.2, 0, 0.1) and holds(body, 0.3, 0, 0.1) and not holds(body, 0.3, 0, 0.01)


def test_a_narrow_hole_makes_a_block_no_convex_body() -> None:
    block = trimesh.creation.annulus(0.01, 0.5, 0.5)
    assert not mesh(np.asarray(block.vertices), np.asarray(block.faces)).convex


def test_a_flat_sheet_of_some_metres_is_read() -> None:
    sheet = np.array([[[0, 0, 0], [50, 0, 0], [50, 50, 0]], [[0, 0, 0], [50, 50, 0], [0, 50, 0]]], dtype=float)
    assert not solid(sheet).convex and not holds(solid(sheet), 20, 10, -0.01)


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
    assert len(solid(box(split=1)).pieces) == 5
