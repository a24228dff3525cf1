"""The e-series arms' own collision bodies: at daily poses only neighbours touch, and joints are covered."""

from __future__ import annotations

import itertools
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin
import pytest

from energy_opt.robot import load_robot

HALF = np.pi / 2
DAILY = [[0, -HALF, 0, -HALF, 0, 0], [0, -HALF, HALF, -HALF, -HALF, 0], [0.3, -1.0, -1.8, -1.9, HALF, 0], [0] * 6]
LINKS = [
    "base_link_inertia",
    "shoulder_link",
    "upper_arm_link",
    "forearm_link",
    *(f"wrist_{k}_link" for k in (1, 2, 3)),
]
PUBLISHED = {"shoulder_link": 0.060, "upper_arm_link": 0.054, "forearm_link": 0.040, "wrist_1_link": 0.045}  # [m] UR5e


@pytest.fixture(params=["ur3e", "ur5e", "ur10e"])
def arm(request: pytest.FixtureRequest) -> tuple[pin.Model, pin.GeometryModel]:
    path = str(load_robot(request.param).urdf)
    model = pin.buildModelFromUrdf(path)
    return model, pin.buildGeomFromUrdf(model, path, pin.GeometryType.COLLISION)


def overlaps(model: pin.Model, geometry: pin.GeometryModel, q: np.ndarray) -> list[tuple[str, str, np.ndarray]]:
    """Links that overlap, and where."""
    turned = np.array([pair for j, x in zip(model.joints[1:], q, strict=True) for pair in _angles(j, x)])
    data, placed = model.createData(), geometry.createData()
    pin.updateGeometryPlacements(model, data, geometry, placed, turned)
    out = []
    for (i, a), (j, b) in itertools.combinations(enumerate(geometry.geometryObjects), 2):
        if a.parentJoint == b.parentJoint:
            continue
        result = coal.CollisionResult()
        at, bt = (coal.Transform3s(m.rotation, m.translation) for m in (placed.oMg[i], placed.oMg[j]))
        if coal.collide(a.geometry, at, b.geometry, bt, coal.CollisionRequest(), result):
            names = [model.frames[x.parentFrame].name for x in (a, b)]
            joint = max(a.parentJoint, b.parentJoint)
            out.append((*names, result.getContact(0).pos - data.oMi[joint].translation))
    return out


def _angles(joint: pin.JointModel, x: float) -> list[float]:
    return [np.cos(x), np.sin(x)] if joint.nq == 2 else [x]


def test_only_neighbours_touch_and_only_at_their_joint(arm: tuple[pin.Model, pin.GeometryModel]) -> None:
    for q in DAILY:
        for a, b, where in overlaps(*arm, np.array(q, dtype=float)):
            assert LINKS.index(b) - LINKS.index(a) == 1, (a, b)
            assert np.linalg.norm(where) < 0.15


def test_the_arm_can_hit_itself(arm: tuple[pin.Model, pin.GeometryModel]) -> None:
    """The forearm folded back onto the shoulder, and the hand bent into the upper arm."""
    hit = {(a, b) for a, b, _ in overlaps(*arm, np.array([0, -HALF, 3.1, -2.9, 0.3, 0]))}
    assert any(LINKS.index(b) - LINKS.index(a) > 1 for a, b in hit)


def test_bodies_reach_from_joint_to_joint_and_are_no_thinner_than_published() -> None:
    """UR5e: radii that Universal Robots states in physical_parameters.yaml; tubes are as long as its links."""
    root = ElementTree.parse(load_robot("ur5e").urdf).getroot()
    shapes = {link.get("name"): link.findall("collision/geometry/cylinder") for link in root.iter("link")}
    for name, radius in PUBLISHED.items():
        assert min(float(c.get("radius")) for c in shapes[name]) >= radius
    assert any(float(c.get("length")) == 0.425 for c in shapes["upper_arm_link"])
    assert any(float(c.get("length")) == 0.3922 for c in shapes["forearm_link"])
