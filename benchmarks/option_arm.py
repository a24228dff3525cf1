"""The arm of an evaluator that imports nothing of the package: limits and dynamics from its URDF, contacts by coal."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from independent import Arm

DATA = next(Path(sys.prefix).rglob("cmeel.prefix/share/example-robot-data/robots"))
OWN = Path(__file__).resolve().parents[1] / "energy_opt" / "robot" / "data" / "urdf"
SRDF = {"panda": "panda", "ur5": "ur5", "xarm7": "xarm7", "z1": "z1", "kinova": "kinova"}
OFTEN = 80  # random poses, in all of which links that touch are one by construction
HALF = 50.0  # [m] of the edge of a box that stands for what is below a floor


class Robot:
    """An arm by the name that the command knows it by; `stated` is what `energy-opt robots NAME --json` says."""

    def __init__(self, stated: Mapping[str, Any]) -> None:
        self.name, self.locked = stated["name"], dict(stated["locked"])
        self.joints = [joint["name"] for joint in stated["joints"]]
        found = [*OWN.rglob(stated["urdf"]), *DATA.rglob(stated["urdf"])]
        self.urdf = found[0]
        rows = stated["joints"]

        def of(key: str, default: float) -> np.ndarray:
            return np.array([default if row[key] is None else float(row[key]) for row in rows])

        self.bounds = {
            "lower": of("lower", -np.inf), "upper": of("upper", np.inf),
            **{key: of(key, np.inf) for key in ("velocity", "acceleration", "jerk", "effort")},
        }  # fmt: skip
        self.n = len(self.joints)

    def arm(self, payload: Sequence[float] | None) -> Arm:
        """Its dynamics with a payload: mass and centre of mass in the last joint's frame."""
        arm = Arm(self.urdf.read_text(), self.joints, self.locked)
        if payload is not None:
            arm.carry(payload[0], np.array(payload[1:]))
        return arm

    def tool(self, q: np.ndarray) -> np.ndarray:
        """Poses (M, 4, 4) of the last joint's frame."""
        model, _ = _bodies(str(self.urdf), self.name, tuple(sorted(self.locked.items())))
        data = model.createData()
        out = []
        for row in q:
            pin.forwardKinematics(model, data, _configured(model, row))
            out.append(data.oMi[model.njoints - 1].homogeneous.copy())
        return np.array(out)

    def touching(
        self, q: np.ndarray, scene: Sequence[Mapping[str, Any]], floor: float | None, own: bool = True
    ) -> str | None:
        """The first pair that touches at positions (M, n); None where nothing does. `own`: pairs of the arm's links."""
        model, geometry = _bodies(str(self.urdf), self.name, tuple(sorted(self.locked.items())))
        geometry = geometry.copy()
        if not own:
            geometry.removeAllCollisionPairs()
        links = geometry.ngeoms
        for name, shape, at in _things(scene, floor):
            k = geometry.addGeometryObject(pin.GeometryObject(name, 0, at, shape))
            for link in range(links):
                if geometry.geometryObjects[link].parentJoint > 0:
                    geometry.addCollisionPair(pin.CollisionPair(link, k))
        data, found = model.createData(), geometry.createData()
        for row in q:
            if pin.computeCollisions(model, data, geometry, found, _configured(model, row), True):
                k = next(k for k, result in enumerate(found.collisionResults) if result.isCollision())
                pair, things = geometry.collisionPairs[k], geometry.geometryObjects
                return f"{things[pair.first].name} and {things[pair.second].name}"
        return None


def _configured(model: Any, q: np.ndarray) -> np.ndarray:
    out: list[float] = []
    for joint, value in zip(list(model.joints)[1:], q, strict=True):
        out += [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
    return np.array(out)


@cache
def _bodies(urdf: str, name: str, locked: tuple[tuple[str, float], ...]) -> tuple[Any, Any]:
    folders = [str(folder) for folder in Path(urdf).resolve().parents]
    model = pin.buildModelFromUrdf(urdf)
    geometry = pin.buildGeomFromUrdf(model, urdf, pin.GeometryType.COLLISION, package_dirs=[*folders, str(DATA)])
    fixed = pin.neutral(model)
    for joint, value in locked:
        at = model.joints[model.getJointId(joint)]
        fixed[at.idx_q : at.idx_q + at.nq] = [np.cos(value), np.sin(value)] if at.nq == 2 else [value]
    model, geometry = pin.buildReducedModel(model, geometry, [model.getJointId(j) for j, _ in locked], fixed)
    geometry.addAllCollisionPairs()
    if name in SRDF:
        pin.removeCollisionPairs(model, geometry, str(next(DATA.rglob(f"{SRDF[name]}.srdf"))))
    objects, data, found = geometry.geometryObjects, model.createData(), geometry.createData()
    low, high = (np.clip(x, -np.pi, np.pi) for x in (model.lowerPositionLimit, model.upperPositionLimit))
    rng, always = np.random.default_rng(7), np.ones(len(geometry.collisionPairs), dtype=bool)
    for _ in range(OFTEN):
        pin.computeCollisions(model, data, geometry, found, rng.uniform(low, high), False)
        always &= [result.isCollision() for result in found.collisionResults]
    for pair, touch in zip(list(geometry.collisionPairs), always, strict=True):
        a, b = objects[pair.first].parentJoint, objects[pair.second].parentJoint
        if touch or model.parents[a] == b or model.parents[b] == a:
            geometry.removeCollisionPair(pair)
    return model, geometry


def _things(scene: Sequence[Mapping[str, Any]], floor: float | None) -> list[tuple[str, Any, Any]]:
    out = []
    if floor is not None:
        box = coal.Box(2 * HALF, 2 * HALF, HALF)
        out.append(("floor", box, pin.SE3(np.eye(3), np.array([0, 0, floor - HALF / 2]))))
    for thing in scene:
        at = pin.SE3(np.eye(3), np.array(thing["position"], dtype=float))
        shape = coal.Box(*thing["size"]) if thing["type"] == "box" else coal.Sphere(thing["radius"])
        out.append((thing["name"], shape, at))
    return out
