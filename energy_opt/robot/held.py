"""Does the library hold what the description says? Masses, inertias, joints, limits and frames are compared."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.robot.description import MOVING, Description, Inertial, Pose
from energy_opt.robot.links import Link, UrdfLimits, pose_of, pseudo_inertia

EQUAL = 1e-9  # share (of placements: m, rad) by which numbers may differ that took another way of rounding


def placed(pose: Pose) -> np.ndarray:
    """(4, 4) of a description's pose."""
    return pose_of(pose.xyz, pose.rpy)


def inertia_matrix(moments: Sequence[float]) -> np.ndarray:
    """(3, 3) from ixx, ixy, ixz, iyy, iyz, izz."""
    xx, xy, xz, yy, yz, zz = moments
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def carriers(description: Description, still: Collection[str] = ()) -> dict[str, tuple[str, np.ndarray]]:
    """For each link the joint that moves it ("" for the base), and its (4, 4) pose in that joint's frame.

    Joints in `still` move nothing; poses beyond them are those at position 0.
    """
    children: dict[str, list[str]] = {}
    for name, joint in description.joints.items():
        children.setdefault(joint.parent, []).append(name)
    out, edge = {description.base: ("", np.eye(4))}, [description.base]
    while edge:
        link = edge.pop()
        for name in children.get(link, []):
            joint = description.joints[name]
            on, at = out[link]
            moves = joint.kind in MOVING and name not in still
            out[joint.child] = (name, np.eye(4)) if moves else (on, at @ placed(joint.pose))
            edge.append(joint.child)
    return out


def check_held(
    description: Description,
    links: Sequence[Link],
    frames: Mapping[str, tuple[int, np.ndarray]],
    limits: UrdfLimits,
) -> None:
    """Compare a model of all joints, as if each moved by itself, with the description that it was made from.

    Args:
        links: the moving links; frames: each link's joint (-1: the base) and (4, 4) pose in that joint's frame.

    Raises:
        BadInput: they differ; names link or joint, and what.
    """
    carried = carriers(description)
    moving = {name: joint for name, joint in description.joints.items() if joint.kind in MOVING}
    names = [link.name for link in links]
    if sorted(names) != sorted(moving) or set(frames) != set(carried):
        raise BadInput(f"{description.path}: the model's joints or links are not those of the description")
    sums = {name: np.zeros((4, 4)) for name in ("", *names)}
    for name, (on, at) in carried.items():
        _same(description, f"link {name!r}, frame", frames[name][1], at)
        if (names[frames[name][0]] if frames[name][0] >= 0 else "") != on:
            raise BadInput(f"{description.path}: link {name!r} hangs on another joint in the model than in the file")
        inertial = description.links[name].inertial
        if inertial is not None:
            sums[on] += at @ _of(inertial) @ at.T
    for k, link in enumerate(links):
        joint, where = moving[link.name], f"joint {link.name!r}"
        on, at = carried[joint.parent]
        _same(description, f"{where}, origin", link.placement, at @ placed(joint.pose))
        _same(description, f"{where}, axis", link.axis, np.array(joint.axis) / np.linalg.norm(joint.axis))
        kind = "prismatic" if link.prismatic else "continuous" if link.continuous else "revolute"
        if kind != joint.kind or (names[link.parent] if link.parent >= 0 else "") != on:
            raise BadInput(f"{description.path}: {where} is of another kind or at another place in the model")
        found = pseudo_inertia(link.mass, link.lever, link.inertia)
        _same(description, f"{where}: mass and inertia of what it carries", found, sums[link.name])
        of = {"lower": limits.lower, "upper": limits.upper, "velocity": limits.velocity, "effort": limits.effort}
        for bound, values in of.items():
            if kind != "continuous" or bound in ("velocity", "effort"):
                _same(description, f"{where}, limit, {bound}", values[k], joint.bounds.get(bound, 0.0))


def _of(inertial: Inertial) -> np.ndarray:
    pose = placed(inertial.pose)
    turn = pose[:3, :3]
    return pseudo_inertia(inertial.mass, pose[:3, 3], turn @ inertia_matrix(inertial.moments) @ turn.T)


def _same(description: Description, what: str, held: np.ndarray | float, said: np.ndarray | float) -> None:
    size = max(float(np.abs(said).max()), float(np.abs(held).max()))
    if not np.abs(np.asarray(held) - said).max() <= EQUAL * size:
        raise BadInput(
            f"{description.path}: {what}: the description says {np.round(said, 6).tolist()}, the model built from it "
            f"holds {np.round(held, 6).tolist()}"
        )
