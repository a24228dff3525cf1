"""Heights over planes within an interval: below all distances that coal measures there, above what travel leaves."""

import numpy as np
from poses import GOAL, START

from energy_opt.cell.bodies import Scenery
from energy_opt.cell.cell import Cell
from energy_opt.cell.proof import least_heights, turns
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene, SceneObject, Shape
from energy_opt.robot import Robot


def things() -> Scene:
    """One of every shape, turned, around the arm."""
    out = []
    rng = np.random.default_rng(2)
    for k, shape in enumerate((Shape("box", (0.3, 0.2, 0.4)), Shape("sphere", (0.1,)), Shape("cylinder", (0.1, 0.3)),
                               Shape("cone", (0.1, 0.3)))):  # fmt: skip
        pose = np.eye(4)
        pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        pose[:3, :3] *= np.linalg.det(pose[:3, :3])
        pose[:3, 3] = 0.7 * np.cos(1.2 * k), 0.7 * np.sin(1.2 * k), 0.5
        out.append(SceneObject(f"thing {k}", (shape,), pose))
    return Scene(tuple(out))


def test_no_distance_within_an_interval_is_below_its_height(panda: Robot) -> None:
    cell, rng = Cell(panda, CellRequest(floor=-0.2), things()), np.random.default_rng(1)
    b = cell.bodies
    better = total = 0
    for q, size in zip(rng.uniform(np.minimum(START, GOAL) - 0.5, np.maximum(START, GOAL) + 0.5, (6, 7)),
                       (0.003, 0.01, 0.03) * 2, strict=True):  # fmt: skip
        far = size * rng.uniform(0.2, 1.0, (1, 7))
        near = dict(cell.distances(q, 1.0))
        pair = np.array([p for p, d in near.items() if d > 0 and b.planar[p]])
        k, scene = np.zeros(len(pair), dtype=int), Scenery(b, q[None])
        _, box_a, box_b = scene.apart(k, pair)
        travel, normals = scene.travel(k, pair, (box_a, box_b), far[k]), []
        for p in pair.tolist():
            first, second = (scene.placed(0, side) for side in b.pairs[p].tolist())
            b.ruler(p).near(first, second)
            normals.append(b.ruler(p).near.normal)
        least = least_heights(scene, k, pair, np.array(normals), far[k], travel * turns(b, pair, far[k]))
        around = q + far * np.sign(rng.normal(size=(80, 7))) * rng.choice([1.0, 0.5], (80, 1))
        found = Scenery(b, around)
        for at in range(80):
            for p, low in zip(pair.tolist(), least.tolist(), strict=True):
                first, second = (found.placed(at, side) for side in b.pairs[p].tolist())
                assert b.ruler(p).near(first, second) >= low - 1e-5
        better += int(np.sum(least > np.array([near[p] for p in pair.tolist()]) - travel))
        total += len(pair)
    assert total > 100 and better > 0.8 * total
