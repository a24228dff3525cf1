"""Selection of the pairs of bodies that must not touch.

Pairs of links that an SRDF disables may touch. Without an SRDF, two kinds of pairs may touch: links that one moving
joint connects, and links that touch in every one of many seeded poses. The latter overlap by construction, and a
warning names them. A pair that was never seen near is kept: this costs little, and samples are no proof.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Container, Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.cell.bodies import Bodies, Body, Scenery
from energy_opt.cell.scene import TOOL, AllowedPairs, PlacedShape
from energy_opt.cell.solids import Solid
from energy_opt.errors import BadInput, suggest
from energy_opt.robot.description import Description
from energy_opt.robot.kinematics import Kinematics
from energy_opt.robot.limits import Limits, postures
from energy_opt.robot.srdf import Srdf


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


POSES = 100  # seeded poses: links that touch in all of them overlap by construction


@dataclass(frozen=True)
class OwnPairs:
    """Pairs of an arm's links that may touch.

    Attributes:
        disabled: the pairs, each with the reason. source: file or method that they come from. sampled: those of them
            that touch in all seeded poses.
    """

    disabled: dict[tuple[str, str], str]
    source: str
    sampled: tuple[tuple[str, str], ...] = ()


def own_pairs(
    bodies: Sequence[Body], kinematics: Kinematics, adjacent: Sequence[tuple[str, str]], limits: Limits, srdf: Srdf
) -> OwnPairs:
    """Pairs of an arm's links that may touch each other.

    Args:
        bodies: of the arm alone.
        adjacent: pairs of links that one moving joint connects.
        srdf: if it disables no pair, adjacency and sampling do.
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
    """Two names in alphabetical order, as keys of pairs have them."""
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
    for q in postures(limits, POSES):
        found = Scenery(Bodies(kinematics, bodies, np.array(index)), q[None]).hulls(0.0)
        index = [
            index[p]
            for _, p, ruler, at, bt, _ in found
            if (not ruler.cut or ruler.mid(at, bt) <= 0) and ruler.exact(at, bt) <= 0
        ]
        if not index:
            break
    return sorted({_ordered(bodies[i].name, bodies[j].name) for i, j in index})


@dataclass(frozen=True)
class Kept:
    """A body, and the links that it may touch.

    Attributes:
        body: the body. own: whether it is a link of the arm. may_touch: names of links that it may touch.
    """

    body: Body
    own: bool
    may_touch: frozenset[str] = frozenset()


def kept_of(placed: PlacedShape, solid: Solid, frames: dict[str, tuple[int, np.ndarray]]) -> Kept:
    """A scene's shape as a body: on the joint that carries it, or fixed."""
    link = placed.frame or placed.attached_to
    if link is None:
        return Kept(Body(placed.object, -1, placed.pose, solid), False)
    carrier = placed.attached_to or link
    for name in (carrier, link):
        if name not in frames:
            names = sorted(frames.keys() - {TOOL})
            known = f"{suggest(name, names)}; links are {', '.join(names)}"
            raise BadInput(f"{placed.object}: attached to {name!r}, which is no link{known}")
    joint, frame = frames[link]
    if joint != frames[carrier][0]:
        raise BadInput(
            f"{placed.object}: {carrier} carries it, but its pose is in the frame of {link}, which does not move with "
            f"{carrier}; give its pose in the frame of {carrier}"
        )
    touch = {carrier, *placed.touch_links}
    return Kept(Body(placed.object, joint, frame @ placed.pose, solid), False, frozenset(touch))


def kept_apart(things: Sequence[Kept], own: OwnPairs | None, allowed: AllowedPairs) -> np.ndarray:
    """Pairs (P, 2) of `things` that must not touch: one of them moves against the other, and nothing allows it.

    Args:
        own: pairs of links that may touch; None: all of them may.
    """
    out = []
    moving = [i for i, thing in enumerate(things) if thing.body.joint >= 0]
    for i, a in enumerate(things):
        for j in range(i) if a.body.joint >= 0 else moving[: bisect_left(moving, i)]:
            b = things[j]
            if a.body.joint == b.body.joint:
                continue
            if a.own and b.own and (own is None or _ordered(a.body.name, b.body.name) in own.disabled):
                continue
            if b.body.name in a.may_touch or a.body.name in b.may_touch or allowed.allows(a.body.name, b.body.name):
                continue
            out.append((i, j))
    return np.array(out, dtype=int).reshape(-1, 2)
