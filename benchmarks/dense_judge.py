"""A judge of its own: does what trajectory.csv stands for touch anything, by many poses of it and nothing of our cell.

    python benchmarks/dense_judge.py ROBOT trajectory.csv [--scene SCENE.yaml] [--poses 3000]

Pinocchio builds the arm with its collision bodies from URDF and SRDF, coal has the scene's shapes, the curve between
rows is the quintic through positions, velocities and accelerations by SciPy. Poses lie so close that no point of an arm
moves by more than some millimetres from one to the next; what is between two of them is not seen, so that this judge
can convict and never acquit: it is here to catch a proof that is wrong.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import yaml
from scipy.interpolate import BPoly

from energy_opt.robot import Robot, load_robot
from energy_opt.robot.catalog import srdf_beside

POSES = 3000
OFTEN = 60  # random poses, in all of which links that touch are one by construction, where no SRDF tells
HALF = 50.0  # [m] of the edge of a box that stands for what is below a plane


@dataclass(frozen=True)
class Touch:
    """Poses that touch something of all that were looked at, and the first of them: time [s] and two names."""

    touching: int
    poses: int
    time: float = np.nan
    pair: tuple[str, str] = ("", "")

    def __str__(self) -> str:
        if not self.touching:
            return f"touches nothing in {self.poses} poses"
        return (
            f"touches in {self.touching} of {self.poses} poses, first at {self.time:.4g} s: {' and '.join(self.pair)}"
        )


class DenseJudge:
    """An arm among the shapes of a scene file (MoveIt's message, or the short form), in the base frame."""

    def __init__(
        self, robot: Robot, scene: Path | None = None, srdf: Path | None = None, packages: Sequence[Path] = ()
    ) -> None:
        self.robot = robot
        srdf = srdf or srdf_beside(robot.name, robot.urdf)
        self.model, self.geometry = _arm(robot.urdf, srdf, tuple(sorted((robot.locked or {}).items())), tuple(packages))
        self.geometry = self.geometry.copy()
        links = self.geometry.ngeoms
        for name, shape, at in [] if scene is None else shapes(yaml.safe_load(scene.read_text())):
            self.geometry.addGeometryObject(pin.GeometryObject(name, 0, at, shape))
        for k in range(links):
            if self.geometry.geometryObjects[k].parentJoint > 0:
                for other in range(links, self.geometry.ngeoms):
                    self.geometry.addCollisionPair(pin.CollisionPair(k, other))
        self.data, self.found = self.model.createData(), self.geometry.createData()
        self.columns = [self.model.joints[self.model.getJointId(name)].idx_q for name in robot.joints]

    def pose(self, q: np.ndarray) -> tuple[str, str] | None:
        """Names of two bodies that touch at q (n,); None where none do."""
        if not pin.computeCollisions(
            self.model, self.data, self.geometry, self.found, _configured(self.model, q), True
        ):
            return None
        k = next(k for k, result in enumerate(self.found.collisionResults) if result.isCollision())
        pair = self.geometry.collisionPairs[k]
        objects = self.geometry.geometryObjects
        return objects[pair.first].name, objects[pair.second].name

    def file(self, trajectory: Path, poses: int = POSES) -> Touch:
        """What a trajectory.csv comes to."""
        with trajectory.open(newline="") as stream:
            rows = list(csv.DictReader(stream))
        time = np.array([float(row["time"]) for row in rows])
        values = [[[float(row[f"{joint}.{what}"]) for joint in self.robot.joints] for row in rows]
                  for what in ("position", "velocity", "acceleration")]  # fmt: skip
        curve = BPoly.from_derivatives(time, np.array(values).transpose(1, 0, 2))
        at = np.union1d(np.linspace(time[0], time[-1], poses), time)
        touching, first = 0, None
        for t, q in zip(at.tolist(), curve(at), strict=True):
            pair = self.pose(q)
            touching += pair is not None
            first = first or (None if pair is None else (t, pair))
        return Touch(touching, len(at)) if first is None else Touch(touching, len(at), *first)


def _configured(model: Any, q: np.ndarray) -> np.ndarray:
    """Joint positions as Pinocchio has them: joints that turn without end are a point on a circle."""
    out = []
    for joint, value in zip(list(model.joints)[1:], q, strict=True):
        out += [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
    return np.array(out)


def named_apart(model: Any) -> Any:
    """A model in which no link shares its name with a joint: Pinocchio does not reduce such a model else."""
    joints = {frame.name for frame in model.frames if frame.type != pin.FrameType.BODY}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name in joints:
            frame.name += " (link)"
    return model


@cache
def _arm(
    urdf: Path, srdf: Path | None, locked: tuple[tuple[str, float], ...], packages: tuple[Path, ...]
) -> tuple[Any, Any]:
    """The arm with its bodies, and the pairs of them that must not touch."""
    folders = [str(folder) for folder in (*packages, *Path(urdf).resolve().parents)]
    model = pin.buildModelFromUrdf(str(urdf))
    geometry = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.COLLISION, package_dirs=folders)
    named_apart(model)  # the bodies are known by their names until here
    fixed = pin.neutral(model)
    for joint, value in locked:
        held = model.joints[model.getJointId(joint)]
        fixed[held.idx_q : held.idx_q + held.nq] = [np.cos(value), np.sin(value)] if held.nq == 2 else [value]
    model, geometry = pin.buildReducedModel(model, geometry, [model.getJointId(j) for j, _ in locked], fixed)
    geometry.addAllCollisionPairs()
    before = len(geometry.collisionPairs)
    if srdf is not None:
        pin.removeCollisionPairs(model, geometry, str(srdf))
    if len(geometry.collisionPairs) == before:
        _without_what_always_touches(model, geometry)
    return model, geometry


def _without_what_always_touches(model: Any, geometry: Any) -> None:
    """Links that hang on each other may touch, and those that touch in every one of many poses."""
    objects, data, found = geometry.geometryObjects, model.createData(), geometry.createData()
    low, high = (np.clip(x, -np.pi, np.pi) for x in (model.lowerPositionLimit, model.upperPositionLimit))
    rng, always = np.random.default_rng(7), np.ones(len(geometry.collisionPairs), dtype=bool)
    for _ in range(OFTEN):
        pin.computeCollisions(model, data, geometry, found, pin.normalize(model, rng.uniform(low, high)), False)
        always &= np.array([result.isCollision() for result in found.collisionResults], dtype=bool)
    pairs = [(pair.first, pair.second) for pair in geometry.collisionPairs]  # numbers: removing one moves the others
    for (first, second), touch in zip(pairs, always, strict=True):
        a, b = objects[first].parentJoint, objects[second].parentJoint
        if touch or model.parents[a] == b or model.parents[b] == a:
            geometry.removeCollisionPair(pin.CollisionPair(first, second))


def shapes(scene: dict[str, Any]) -> list[tuple[str, Any, Any]]:
    """Name, shape and pose of everything in a scene."""
    out = []
    for thing in scene.get("objects", []):
        at = _placed(thing.get("position", [0, 0, 0]), thing.get("quaternion", [0, 0, 0, 1]))
        kind = thing["type"]
        if kind == "plane":  # solid below
            out.append((thing["name"], coal.Box(2 * HALF, 2 * HALF, HALF), at * _placed([0, 0, -HALF / 2])))
            continue
        size = {"box": "size", "sphere": ("radius",), "cylinder": ("height", "radius")}[kind]
        values = thing[size] if isinstance(size, str) else [thing[key] for key in size]
        out.append((thing["name"], _shape(kind, values), at))
    for thing in scene.get("world", {}).get("collision_objects", []):
        whole = _pose(thing["pose"]) if "pose" in thing else pin.SE3.Identity()
        for part, at in zip(thing["primitives"], thing["primitive_poses"], strict=True):
            out.append((thing["id"], _shape(part["type"], part["dimensions"]), whole * _pose(at)))
    return out


def _shape(kind: str, size: Sequence[float]) -> Any:
    if kind == "box":
        return coal.Box(*size)
    if kind == "sphere":
        return coal.Sphere(*size)
    if kind == "cylinder":
        return coal.Cylinder(size[1], size[0])  # messages have the height first
    raise SystemExit(f"a shape that this judge does not know: {kind}")


def _pose(message: dict[str, Any]) -> Any:
    return _placed(
        *([list(x.values()) if isinstance(x, dict) else x for x in (message["position"], message["orientation"])])
    )


def _placed(position: Sequence[float], quaternion: Sequence[float] = (0, 0, 0, 1)) -> Any:
    return pin.SE3(pin.Quaternion(np.array(quaternion, dtype=float)).normalized().matrix(), np.array(position, float))


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge one file; 1 where it touches something."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot")
    parser.add_argument("trajectory", type=Path)
    parser.add_argument("--scene", type=Path)
    parser.add_argument("--poses", type=int, default=POSES)
    args = parser.parse_args(arguments)
    found = DenseJudge(load_robot(args.robot), args.scene).file(args.trajectory, args.poses)
    print(found)
    return int(found.touching > 0)


if __name__ == "__main__":
    sys.exit(main())
