"""Followers: joints with a mimic element in the URDF. Their limits tighten the limits of their leaders."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.robot.description import Description
from energy_opt.robot.kinematics import Coupling, Link
from energy_opt.robot.limits import PLACEHOLDER, SMALLEST, Limits, unit_of

SAME = 1e-9  # share by which a follower's bound must be tighter than its leader's to count; smaller ones are rounding

Law = tuple[str, float, float]  # leading joint, ratio and offset


def followers(description: Description, locked: Mapping[str, float]) -> tuple[dict[str, float], dict[str, Law]]:
    """Joints that do not move, and joints that follow an independent joint.

    A joint that follows a joint at rest never moves, nor does one with multiplier 0. A joint that is locked by its own
    name does not follow. If a joint follows a follower, their laws are combined: the last joint of the chain leads
    both.

    Args:
        description: the URDF. locked: positions [rad or m] of locked joints by name.

    Returns:
        `locked` with all further joints that never move; and the laws of the others by name.

    Raises:
        BadInput: joints follow each other in a circle.
    """
    given = {name: joint.mimic for name, joint in description.joints.items() if joint.mimic is not None}
    still, moving = dict(locked), {}
    for name in given:
        if name in locked:
            continue
        leader, ratio, offset, seen = name, 1.0, 0.0, [name]
        while leader in given and leader not in locked:
            leader, multiplier, shift = given[leader]
            offset, ratio = offset + ratio * shift, ratio * multiplier
            if leader in seen:
                circle = " follows ".join([*seen, leader])
                raise BadInput(f"{description.path}: joint {name!r}, mimic: {circle}: a circle")
            seen.append(leader)
        if leader in locked:
            still[name] = ratio * locked[leader] + offset
        elif ratio == 0:
            still[name] = offset
        else:
            moving[name] = leader, ratio, offset
    return still, moving


def leaders_limits(limits: Limits, links: Sequence[Link]) -> tuple[Limits, list[str]]:
    """Limits of the n independent joints from those of all L joints, and a line for each limit that changes.

    A follower keeps its bounds on position, velocity, acceleration and jerk by tighter bounds of its leader: a bound of
    the follower divided by |ratio|. The leader drives the follower, so the leader's effort limit holds for the sum of
    both.

    Args:
        limits: of all joints (L,). links: in the same order.

    Raises:
        BadInput: no position is left for a leader.
    """
    coupling = Coupling.of(links)
    out = {field.name: getattr(limits, field.name)[coupling.own] for field in dataclasses.fields(limits)}
    said: list[str] = []
    for k, link in enumerate(links):
        if link.follows is None:
            continue
        leader, ratio, offset = links[link.follows.leader], link.follows.ratio, link.follows.offset
        j = int(np.flatnonzero(coupling.own == link.follows.leader)[0])
        why = f"so that {link.name} ({ratio:g} times it) keeps its own"
        low, high = float(limits.lower[k]), float(limits.upper[k])
        if low < high:
            ends = sorted(((low - offset) / ratio, (high - offset) / ratio))
            room = SAME * max(1.0, abs(ends[0]), abs(ends[1])) if np.isfinite(ends).all() else 0.0
            lower, upper, given = float(out["lower"][j]), float(out["upper"][j]), out["lower"][j] < out["upper"][j]
            if not given:
                lower, upper = -np.inf, np.inf
            if not max(lower, ends[0]) < min(upper, ends[1]):
                raise BadInput(
                    f"{leader.name}: no position in its limits [{lower:g}, {upper:g}] leaves {link.name}, which "
                    f"follows it (mimic: {ratio:g} times it plus {offset:g}), in [{low:g}, {high:g}]; --lock "
                    f"{leader.name}=VALUE holds it at a fixed position"
                )
            if ends[0] > lower + room or ends[1] < upper - room:
                lower, upper = max(lower, ends[0]), min(upper, ends[1])
                said.append(f"{leader.name}: position limits [{lower:g}, {upper:g}] {_unit(leader, 'position')}, {why}")
            out["lower"][j], out["upper"][j] = lower, upper
        else:
            said.append(f"{link.name}: position limits [{low:g}, {high:g}] are empty; assumed: those of {leader.name}")
        for kind in ("velocity", "acceleration", "jerk"):
            mine, its = float(getattr(limits, kind)[k]) / abs(ratio), float(out[kind][j])
            usual = its if SMALLEST <= its < PLACEHOLDER else np.inf
            if SMALLEST <= mine * abs(ratio) < PLACEHOLDER and mine < usual * (1 - SAME):
                out[kind][j] = mine
                said.append(f"{leader.name}: {kind} limit {mine:g} {_unit(leader, kind)}, {why}")
    return Limits(**out), said


def _unit(link: Link, kind: str) -> str:
    """Unit of a quantity of a link's joint."""
    return unit_of(kind, link.prismatic)
