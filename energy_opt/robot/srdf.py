"""SRDF files: which pairs of links are not checked against each other, and named poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import finite_number
from energy_opt.robot.catalog import srdf_beside
from energy_opt.robot.robot import Robot
from energy_opt.robot.xml import read_robot_xml


@dataclass(frozen=True)
class Srdf:
    """Content of an SRDF file, as far as it is used.

    Attributes:
        disabled: pairs of links (in alphabetical order) that are not checked against each other, with the reason given.
        silent: links that are not checked against any link but those of `enabled`.
        enabled: pairs that are checked though one of them is silent.
        states: named poses: joint's name to position [rad or m].
    """

    source: str = ""
    disabled: dict[tuple[str, str], str] = field(default_factory=dict)
    silent: tuple[str, ...] = ()
    enabled: tuple[tuple[str, str], ...] = ()
    states: dict[str, dict[str, float]] = field(default_factory=dict)

    def allows(self, a: str, b: str) -> bool:
        """Whether links a and b are not checked against each other."""
        pair = (a, b) if a <= b else (b, a)
        return pair in self.disabled or (pair not in self.enabled and (a in self.silent or b in self.silent))

    def pose(self, name: str, joints: Sequence[str]) -> np.ndarray:
        """Positions (n,) of a named state.

        Raises:
            BadInput: no such state, or it leaves joints out.
        """
        if name not in self.states:
            known = ", ".join(self.states) or "none"
            raise BadInput(f"no pose is named {name!r}; {self.source or 'this robot'} has {known}")
        state = self.states[name]
        missing = [joint for joint in joints if joint not in state]
        if missing:
            raise BadInput(f"{self.source}: the pose {name!r} gives no position for {', '.join(missing)}")
        return np.array([state[joint] for joint in joints])


def read_srdf(path: Path) -> Srdf:
    """An SRDF file.

    Raises:
        BadInput: not readable, or an element lacks what it must say; names file and element.
    """
    root = read_robot_xml(path)
    if root.find("link") is not None:
        raise BadInput(f"{path}: a URDF; expected an SRDF, which names pairs of links that may touch")

    def of(element: Element, key: str) -> str:
        value = element.get(key)
        if not value:
            raise BadInput(f"{path}: <{element.tag}> without {key}")
        return str(value)

    def pairs(tag: str) -> list[tuple[str, str, str]]:
        found = [(of(e, "link1"), of(e, "link2"), str(e.get("reason", ""))) for e in root.iter(tag)]
        return [(min(a, b), max(a, b), reason) for a, b, reason in found]

    states: dict[str, dict[str, float]] = {}
    for state in root.iter("group_state"):
        joints = states.setdefault(of(state, "name"), {})
        for joint in state.iter("joint"):
            words = of(joint, "value").split()
            where = f"{path}: group_state {state.get('name')}, joint {of(joint, 'name')}"
            if len(words) == 1:  # joints with several degrees of freedom do not belong to an arm
                joints[of(joint, "name")] = finite_number(words[0], where, "a position [rad or m]")
    return Srdf(
        str(path),
        {(a, b): reason for a, b, reason in pairs("disable_collisions")},
        tuple(of(e, "link") for e in root.iter("disable_default_collisions")),
        tuple((a, b) for a, b, _ in pairs("enable_collisions")),
        states,
    )


def semantics(robot: Robot, file: Path | None = None) -> Srdf:
    """Content of the SRDF `file`; by default that of a robot by name; empty if there is none.

    Raises:
        BadInput: the file cannot be read, or it names links and none of them is the robot's.
    """
    file = file or srdf_beside(robot.name, robot.urdf)
    if file is None:
        return Srdf()
    found, own = read_srdf(file), robot.description.links
    named = dict.fromkeys([link for pair in (*found.disabled, *found.enabled) for link in pair] + list(found.silent))
    if named and not any(link in own for link in named):
        theirs, ours = (", ".join(list(names)[:3]) for names in (named, own))
        raise BadInput(f"{file}: none of its links ({theirs}, …) is a link of {robot.name} ({ours}, …)")
    return found
