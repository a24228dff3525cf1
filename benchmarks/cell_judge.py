"""A judge of what arms of a cell do to each other, by Pinocchio and coal alone: nothing of energy_opt is imported.

It reads the `cycle_<robot>.csv` of an answer, puts every arm on its base, samples time densely and each pair of arms at
every lateness within the jitter, and asks coal whether their meshes touch.
"""

from __future__ import annotations

import csv
import json
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
from scipy.interpolate import BPoly

STEP = 4e-3  # [s] between samples of a cycle
LATE = 5  # samples of the lateness from -2 to 2 times the jitter
DATA = Path(pin.__file__).resolve()
SHARE = next(p for p in DATA.parents if p.name == "cmeel.prefix") / "share" / "example-robot-data" / "robots"
OWN = Path(__file__).resolve().parents[1] / "energy_opt" / "robot" / "data" / "urdf"
URDF = {
    "panda": SHARE / "panda_description" / "urdf" / "panda.urdf",
    "ur5": SHARE / "ur_description" / "urdf" / "ur5_robot.urdf",
    "ur10e": OWN / "ur10e.urdf",
}


def base_of(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> pin.SE3:
    """A pose from metres and fixed-axis angles."""
    return pin.SE3(pin.rpy.rpyToMatrix(roll, pitch, yaw), np.array([x, y, z]))


class Body:
    """An arm's collision meshes on its base; fingers are closed."""

    def __init__(self, robot: str, joints: list[str], base: list[float]) -> None:
        urdf = URDF[robot]
        folders = [str(folder) for folder in (*urdf.parents, SHARE.parent)]
        model = pin.buildModelFromUrdf(str(urdf))
        geometry = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.COLLISION, package_dirs=folders)
        locked = [k for k, name in enumerate(model.names) if k and name not in joints]
        self.model, self.geometry = pin.buildReducedModel(model, geometry, locked, pin.neutral(model))
        self.order = [joints.index(name) for name in self.model.names[1:]]
        self.base = base_of(*base)
        self.solids = [thing.geometry for thing in self.geometry.geometryObjects]
        self.names = [thing.name for thing in self.geometry.geometryObjects]
        for solid in self.solids:
            solid.computeLocalAABB()
        self.centre = np.array([solid.aabb_center for solid in self.solids])
        self.radius = np.array([solid.aabb_radius for solid in self.solids])

    def placed(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (N, G, 3, 3) and origins (N, G, 3) [m] of the bodies at positions q (N, n)."""
        data, gdata = self.model.createData(), self.geometry.createData()
        rotation, origin = np.zeros((len(q), len(self.solids), 3, 3)), np.zeros((len(q), len(self.solids), 3))
        for k, one in enumerate(q):
            pin.updateGeometryPlacements(self.model, data, self.geometry, gdata, one[self.order])
            for g, pose in enumerate(gdata.oMg):
                at = self.base * pose
                rotation[k, g], origin[k, g] = at.rotation, at.translation
        return rotation, origin


Placed = tuple[np.ndarray, np.ndarray]


def touching(one: Body, two: Body, first: Placed, second: Placed) -> tuple[int, str, str] | None:
    """The first of N instants at which a body of one touches a body of the other; None where none does."""
    (ra, oa), (rb, ob) = first, second
    ca = np.einsum("ngij,gj->ngi", ra, one.centre) + oa
    cb = np.einsum("ngij,gj->ngi", rb, two.centre) + ob
    gap = np.linalg.norm(ca[:, :, None] - cb[:, None], axis=3) - one.radius[:, None] - two.radius
    request = coal.CollisionRequest()
    for k, a, b in zip(*np.nonzero(gap < 0), strict=True):
        result = coal.CollisionResult()
        at, bt = coal.Transform3s(ra[k, a], oa[k, a]), coal.Transform3s(rb[k, b], ob[k, b])
        if coal.collide(one.solids[a], at, two.solids[b], bt, request, result):
            return int(k), one.names[a], two.names[b]
    return None


def faults_of_cell(cell: dict, folder: Path) -> list[str]:
    """Where two arms of an answer touch, each at most `jitter` early or late; one line for each pair of arms.

    Args:
        cell: the job file as it was asked for; folder: what the answer was written into.
    """
    found = json.loads((folder / "job.json").read_text())
    cycle, jitter = cell["cycle_time"], cell.get("jitter", 0.02)
    count = int(cycle / STEP)
    time = np.arange(count) * cycle / count
    shift = np.unique(np.round(np.linspace(-2, 2, LATE) * jitter / (cycle / count)).astype(int))
    placed, faults = {}, []
    for robot, answer in zip(cell["robot"], found["robots"], strict=True):
        if "robot" not in robot:
            continue
        joints, curve, length = motion(folder / f"cycle_{robot['name']}.csv")
        if abs(length - cycle) > 1e-6:
            faults.append(f"{robot['name']}: its motion takes {length} s")
        body = Body(robot["robot"], joints, robot.get("base", [0.0] * 6))
        at = np.clip((time - answer["steps"][0]["start"]) % cycle, 0, length)
        placed[robot["name"]] = body, body.placed(curve(at))
    for (a, (one, first)), (b, (two, second)) in combinations(placed.items(), 2):
        for late in shift.tolist():
            hit = touching(one, two, first, tuple(np.roll(x, -late, axis=0) for x in second))
            if hit is not None:
                k, x, y = hit
                faults.append(f"{a} and {b}: {x} and {y} touch at {time[k]:.3f} s, {late * cycle / count:.3f} s apart")
                break
    return faults


def motion(file: Path) -> tuple[list[str], BPoly, float]:
    """Joints, the quintic through the samples of a written trajectory, and its duration [s]."""
    with file.open() as lines:
        rows = list(csv.DictReader(lines))
    joints = [key.removesuffix(".position") for key in rows[0] if key.endswith(".position")]
    time = np.array([float(row["time"]) for row in rows])
    parts = [[[float(row[f"{j}.{kind}"]) for j in joints] for row in rows] for kind in
             ("position", "velocity", "acceleration")]  # fmt: skip
    return joints, BPoly.from_derivatives(time, np.stack(parts, axis=1)), float(time[-1])
