"""The arm's own bodies: the collision bodies of its description, on the joints that carry them, and which are near.

Which pairs of bodies are kept apart, and why the others are not.

Links: what an SRDF disables may touch. Without one, links that one moving joint connects may, and links that touch in
every one of many seeded poses: these overlap by construction, and a warning names them. A pair that merely was never
seen near is kept: it costs little, and samples are no proof.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Container, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from energy_opt.cell import solids
from energy_opt.cell.bodies import Bodies, Body, Scenery
from energy_opt.cell.scene import AllowedPairs
from energy_opt.cell.solids import Solid
from energy_opt.errors import BadInput
from energy_opt.robot import Robot
from energy_opt.robot.checks import placed
from energy_opt.robot.description import Description
from energy_opt.robot.kinematics import Kinematics
from energy_opt.robot.limits import Limits, postures
from energy_opt.robot.meshes import mesh_files
from energy_opt.robot.tool import Srdf

MOST_TRIANGLES = 1_000_000  # of a mesh, as in a scene


def arm_bodies(robot: Robot, package_dirs: Sequence[Path] = (), allow_large: bool = False) -> list[Body]:
    """Every collision body of the description, joints that are locked held where they are.

    Raises:
        BadInput: a mesh is missing, too large, or cannot be read; names the link.
    """
    description, frames = robot.description, robot.body.link_frames()
    files = mesh_files(description, package_dirs, allow_large)
    known: dict[tuple[object, ...], Solid] = {}
    most = sys.maxsize if allow_large else MOST_TRIANGLES
    out = []
    for link in description.links.values():
        joint, at = frames[link.name]
        for body in link.collisions:
            key = body.kind, body.size, body.file
            if key not in known:
                try:
                    known[key] = (
                        solids.primitive(body.kind, body.size)
                        if body.kind != "mesh"
                        else solids.mesh_file(files[body.file], body.size, most)
                    )
                except BadInput as error:
                    remedy = "; --self-collision off plans without the arm's body"
                    raise BadInput(f"{description.path}: link {link.name}: {error}{remedy}") from None
            out.append(Body(link.name, joint, at @ placed(body.pose), known[key]))
    return out


def neighbours(description: Description, still: Collection[str] = ()) -> list[tuple[str, str]]:
    """Pairs of links with bodies that one moving joint connects, and nothing with a body between them.

    Fixed joints, those in `still` and links without bodies pass the connection on; a second moving joint does not.
    """
    near: dict[str, list[tuple[str, bool]]] = {name: [] for name in description.links}
    for name, joint in description.joints.items():
        moves = joint.kind != "fixed" and name not in still
        near[joint.parent].append((joint.child, moves))
        near[joint.child].append((joint.parent, moves))
    real = {name for name, link in description.links.items() if link.collisions}
    out = set()
    for start in sorted(real):
        edge, seen = [(start, 0)], {start}
        while edge:
            link, moving = edge.pop()
            for other, moves in near[link]:
                if other in seen or moving + moves > 1:
                    continue
                seen.add(other)
                if other not in real:
                    edge.append((other, moving + moves))
                elif moving + moves == 1:
                    out.add((min(start, other), max(start, other)))
    return sorted(out)


POSES = 100  # poses in all of which links touch that cannot help it


@dataclass(frozen=True)
class OwnPairs:
    """Pairs of links that may touch, with the reason, where this comes from, and those that samples alone excuse."""

    disabled: dict[tuple[str, str], str]
    source: str
    sampled: tuple[tuple[str, str], ...] = ()


def own_pairs(
    bodies: Sequence[Body],
    kinematics: Kinematics,
    adjacent: Sequence[tuple[str, str]],
    limits: Limits,
    srdf: Srdf,
) -> OwnPairs:
    """Which links of an arm may touch each other.

    Args:
        bodies: of the arm alone.
        adjacent: pairs of links that one moving joint connects.
        srdf: where it disables no pair, adjacency and sampling do.
    """
    names = sorted({body.name for body in bodies})
    if srdf.disabled or srdf.silent:
        pairs = [(a, b) for a in names for b in names if a < b and srdf.allows(a, b)]
        return OwnPairs({pair: srdf.disabled.get(pair, "by default") for pair in pairs}, srdf.source)
    disabled = dict.fromkeys(adjacent, "adjacent")
    sampled = _always_touching(bodies, kinematics, limits, disabled)
    disabled |= dict.fromkeys(sampled, f"touch in {POSES} of {POSES} poses")
    return OwnPairs(disabled, "adjacency and sampling", tuple(sampled))


def _ordered(a: str, b: str) -> tuple[str, str]:
    return (a, b) if a <= b else (b, a)


def _always_touching(
    bodies: Sequence[Body], kinematics: Kinematics, limits: Limits, known: Container[tuple[str, str]]
) -> list[tuple[str, str]]:
    """Pairs of links that touch in every one of the seeded poses."""
    index = [
        (i, j)
        for i in range(len(bodies))
        for j in range(i)
        if bodies[i].joint != bodies[j].joint and _ordered(bodies[i].name, bodies[j].name) not in known
    ]
    if not index:
        return []
    all_ = Bodies(kinematics, bodies, np.array(index))
    q = postures(limits, POSES)
    scene = Scenery(all_, q)
    open_ = np.arange(len(index))
    for k in range(POSES):
        floor, _, _ = scene.apart(np.full(len(open_), k), open_)
        open_ = np.array([p for p in open_[floor <= 0].tolist() if _touch(all_, scene, k, p)], dtype=int)
        if not len(open_):
            return []
    return sorted({_ordered(*all_.names(p)) for p in open_.tolist()})


def _touch(bodies: Bodies, scene: Scenery, k: int, pair: int) -> bool:
    ruler = bodies.ruler(pair)
    a, b = bodies.pairs[pair].tolist()
    at, bt = scene.placed(k, a), scene.placed(k, b)
    return ruler.near(at, bt) <= 0 and (not ruler.cut or ruler.mid(at, bt) <= 0) and ruler.exact(at, bt) <= 0


@dataclass(frozen=True)
class Kept:
    """A body, and which others it may touch: `links` of the arm, whether it is one of the arm's own links."""

    body: Body
    own: bool
    may_touch: frozenset[str] = frozenset()


def kept_apart(things: Sequence[Kept], own: OwnPairs | None, allowed: AllowedPairs) -> np.ndarray:
    """Pairs (P, 2) of `things` that must not touch: one of them moves against the other, and nothing allows it.

    Args:
        own: pairs of links that may touch; None: all of them may.
    """
    out = []
    for i, a in enumerate(things):
        for j in range(i):
            b = things[j]
            if a.body.joint == b.body.joint:
                continue
            if a.own and b.own and (own is None or _ordered(a.body.name, b.body.name) in own.disabled):
                continue
            if b.body.name in a.may_touch or a.body.name in b.may_touch or allowed.allows(a.body.name, b.body.name):
                continue
            out.append((i, j))
    return np.array(out, dtype=int).reshape(-1, 2)
