"""Hulls of a body's parts cover the body, and leave its hollows open."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

import energy_opt as eo
from energy_opt.cell.cutting import cut
from energy_opt.cell.solids import mesh


def board(size: tuple[float, float, float], at: tuple[float, float, float]) -> trimesh.Trimesh:
    body = trimesh.creation.box(size)
    body.apply_translation(at)
    return body


def tray(wall: float = 0.01) -> trimesh.Trimesh:
    """A bin of one closed surface: a box with a hollow, open at the top."""
    outer, hollow = board((0.4, 0.4, 0.25), (0, 0, 0.125)), board((0.4 - 2 * wall, 0.4 - 2 * wall, 0.25), (0, 0, 0.125))
    rim = 0.25
    hollow.vertices[:, 2] = np.where(hollow.vertices[:, 2] < 0.1, wall, rim)
    hollow.invert()
    for part in (outer, hollow):
        part.update_faces(~(part.triangles[:, :, 2] > rim - 1e-9).all(axis=1))
    a, b = (np.array([[x, y, rim] for x, y in ((-h, -h), (h, -h), (h, h), (-h, h))]) for h in (0.2, 0.2 - wall))
    ring = np.vstack([a, b])
    faces = [f for k in range(4) for f in ([k, (k + 1) % 4, 4 + (k + 1) % 4], [k, 4 + (k + 1) % 4, 4 + k])]
    whole = trimesh.util.concatenate([outer, hollow, trimesh.Trimesh(ring, faces, process=False)])
    whole.merge_vertices()
    assert whole.is_watertight
    return whole


def bracket() -> trimesh.Trimesh:
    """A profile like an L, along y."""
    shape = np.array([[0, 0], [0.3, 0], [0.3, 0.05], [0.05, 0.05], [0.05, 0.4], [0, 0.4]])
    front, back = (np.column_stack([shape[:, 0], np.full(6, y), shape[:, 1]]) for y in (0.0, 0.2))
    caps = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    sides = [f for k in range(6) for f in ([k, 6 + k, (k + 1) % 6], [(k + 1) % 6, 6 + k, 6 + (k + 1) % 6])]
    out = trimesh.Trimesh(np.vstack([front, back]), [*caps, *([c + 6, b + 6, a + 6] for a, b, c in caps), *sides])
    trimesh.repair.fix_normals(out)
    assert out.is_watertight
    return out


def volume(points: np.ndarray) -> float:
    try:
        return float(ConvexHull(points).volume)
    except Exception:  # flat
        return 0.0


def winding(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """How often a closed surface winds around each point (M,): 1 inside, 0 outside."""
    a, b, c = (triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=2) for x in (a, b, c))
    above = np.einsum("mti,mti->mt", a, np.cross(b, c))
    dots = [np.einsum("mti,mti->mt", x, y) for x, y in ((a, b), (b, c), (c, a))]
    return np.arctan2(above, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb).sum(axis=1) / (2 * np.pi)


@pytest.mark.parametrize(("body", "most"), [(tray(), 1.05), (bracket(), 1.05), (tray(0.08), 1.05)])
@pytest.mark.parametrize("turn", [0.0, 1e-9])
def test_parts_cover_the_solid_and_little_else(body: trimesh.Trimesh, most: float, turn: float) -> None:
    triangles = np.asarray(body.triangles) @ trimesh.transformations.rotation_matrix(turn, [1, 2, 3])[:3, :3].T
    parts = cut(triangles)
    assert 2 <= len(parts) <= 8
    assert sum(map(volume, parts)) < most * body.volume
    low, high = body.bounds
    points = np.random.default_rng(0).uniform(low, high, (4000, 3))
    inside = points[np.abs(winding(points, triangles)) > 0.5]
    assert len(inside) > 200
    hulls = [ConvexHull(part).equations for part in parts]
    covered = [(inside @ h[:, :3].T + h[:, 3] <= 1e-9).all(axis=1) for h in hulls]
    assert np.any(covered, axis=0).all()


def test_boards_that_overlap_are_pieces_as_well() -> None:
    """A face of one board lies in the plane of a cut, partly in another board's piece."""
    boards = [((0.4, 0.4, 0.01), (0, 0, 0.005)), ((0.01, 0.4, 0.25), (0.195, 0, 0.125))]
    boards += [((0.01, 0.4, 0.25), (-0.195, 0, 0.125)), ((0.4, 0.01, 0.25), (0, 0.195, 0.125))]
    whole = trimesh.util.concatenate([board(*each) for each in [*boards, ((0.4, 0.01, 0.25), (0, -0.195, 0.125))]])
    parts = cut(np.asarray(whole.triangles))
    assert len(parts) == 5 and sum(map(volume, parts)) < 1.05 * tray().volume


def test_a_convex_body_and_a_flat_one_are_not_cut() -> None:
    assert cut(np.asarray(trimesh.creation.icosphere().triangles)) == []
    assert cut(np.asarray(board((0.3, 0.2, 0.1), (0, 0, 0)).triangles)) == []
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    assert cut(np.asarray(sheet.triangles)) == []


@pytest.mark.parametrize("sides", [1, 2])
def test_a_sheet_in_the_plane_of_a_cut_is_not_left_out(sides: int) -> None:
    """A bin with a divider that has no thickness: a cut in its plane left it to neither side."""
    sheet = trimesh.Trimesh(
        [[0, -0.19, 0.01], [0, 0.19, 0.01], [0, 0.19, 0.24], [0, -0.19, 0.24]],
        [[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]][: 2 * sides], process=False,
    )  # fmt: skip
    whole = trimesh.util.concatenate([tray(), sheet])
    solid = mesh(np.asarray(whole.vertices), np.asarray(whole.faces))
    hulls = [ConvexHull(piece.points).equations for piece in solid.pieces]
    for point in ([0, 0, 0.12], [0, 0.1, 0.2], [0, -0.15, 0.23]):
        assert any((h[:, :3] @ point + h[:, 3] <= 1e-5).all() for h in hulls), point


@pytest.mark.parametrize("seed", range(5))
def test_pieces_cover_every_surface(seed: int) -> None:
    """Boxes at random, some without a lid, and sheets. Flat parts of some of them crashed coal's hull."""
    rng = np.random.default_rng(seed)
    for _ in range(20):
        bodies = []
        for _ in range(rng.integers(1, 6)):
            size = rng.choice([0.01, 0.05, 0.1, 0.2, 0.4], 3)
            bodies.append(board(tuple(size.tolist()), tuple(np.round(rng.uniform(-0.2, 0.2, 3), 2).tolist())))
            if rng.random() < 0.2:
                top = bodies[-1].bounds[1, 2] - 1e-9
                bodies[-1].update_faces(~(bodies[-1].triangles[:, :, 2] > top).all(axis=1))
        whole = trimesh.util.concatenate(bodies)
        if rng.random() < 0.3:
            whole.apply_transform(trimesh.transformations.rotation_matrix(rng.uniform(0, 3), rng.normal(size=3)))
        points, _ = trimesh.sample.sample_surface(whole, 300, seed=1)
        outside = np.full(len(points), np.inf)
        for piece in mesh(np.asarray(whole.vertices), np.asarray(whole.faces)).pieces:
            planes = ConvexHull(piece.points, qhull_options="QJ").equations
            outside = np.minimum(outside, (points @ planes[:, :3].T + planes[:, 3]).max(axis=1))
        assert outside.max() < 2e-6


@pytest.mark.slow
def test_a_move_into_a_bin_is_as_cheap_as_into_one_of_five_boxes(tmp_path: Path) -> None:
    """Its hull fills it, so no plane kept the hand and the bin apart: the answer was the straight line's timing."""
    body = tray()
    assert len(mesh(np.asarray(body.vertices), np.asarray(body.faces)).pieces) == 5
    body.export(tmp_path / "bin.stl")
    place = "position: [0.5, 0, {z}], quaternion: [0, 0, 0, 1]"
    whole = "objects:\n- {name: bin, type: mesh, file: bin.stl, " + place.format(z=0) + "}\n"
    boards = [((0.4, 0.4, 0.01), (0.5, 0, 0.005)), ((0.01, 0.4, 0.25), (0.695, 0, 0.125))]
    boards += [((0.01, 0.4, 0.25), (0.305, 0, 0.125)), ((0.4, 0.01, 0.25), (0.5, 0.195, 0.125))]
    boards += [((0.4, 0.01, 0.25), (0.5, -0.195, 0.125))]
    rows = [
        f"- {{name: b{k}, type: box, size: {list(size)}, position: {list(at)}}}" for k, (size, at) in enumerate(boards)
    ]
    losses = []
    for name, text in (("bin", whole), ("boards", "objects:\n" + "\n".join(rows) + "\n")):
        (tmp_path / f"{name}.yaml").write_text(text)
        result = eo.optimize(
            "panda", "source-method-2", start=[0, -0.785, 0, -2.356, 0, 1.571, 0.785],
            goal_pose="0.5,0.05,0.3,3.14159,0,0.78", scene=tmp_path / f"{name}.yaml",
        )  # fmt: skip
        assert result.status == "solved" and result.certificate.clearance.proven
        losses.append(result.energy.loss)
    assert losses[0] == pytest.approx(losses[1], rel=0.05)
