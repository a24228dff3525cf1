"""Columns of the joints and of time, by their headers, in the field's conventions.

Headers that differ by a number only are a vector over the joints; a joint's own name among the words makes the header
that joint's.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import cache

from energy_opt.measured.header import (
    COMMANDED,
    MEASURED,
    NOT_TIME,
    PLAIN,
    SIGNALS,
    TIME,
    UNITS,
    cut,
    plain,
    signal_of,
)
from energy_opt.robot import Robot, known_robots

NAMED = re.compile(r".*\d[./](?:position|velocity|acceleration|effort|current|temperature)")  # a joint's own name
REFUSED = -2.0  # highest rank of commanded values


def joint_columns(
    header: Sequence[str], robot: Robot, given: Mapping[int, str] | None = None
) -> dict[str, dict[str, str]]:
    """Which header holds which joint's signal: {signal: {joint: header}}, only signals found for every joint.

    Commanded or computed values are not taken, except positions if no measured ones are there. Numbers stand for the
    robot's own order, unless the headers state the names of other joints. If there is a number for each joint that
    could move, they are those of followers (mimic) and locked joints, too.

    Args:
        header: of a file. robot: the arm. given: joint name by number, where the file itself says.
    """
    by_number, by_name = _by_number(header, robot, given or {}), _by_name(header, robot)
    found = {}
    for signal in SIGNALS:
        ranked = [by[signal] for by in (by_name, by_number) if signal in by]
        measured = [columns for rank, columns in ranked if rank > REFUSED]
        if measured or (ranked and signal == "position"):
            found[signal] = measured[0] if measured else ranked[0][1]
    return found


def is_commanded(header: str, joint: str) -> bool:
    """Whether a header says that a joint's values are commanded or computed."""
    return bool(COMMANDED & set(_words_beside(header, _short_names([joint])[joint])))


def _words_beside(header: str, forms: Iterable[str]) -> tuple[str, ...]:
    """The words of a header without the first of a joint's `forms` that it has."""
    flat = f" {_flat(header)} "
    form = next((form for form in forms if form in flat), " ")
    return cut(flat.replace(form, " ", 1)).words


def _by_name(header: Sequence[str], robot: Robot) -> dict[str, tuple[float, dict[str, str]]]:
    """Columns by joints' names in their headers: {signal: (rank, {joint: header})}, only signals of all joints."""
    names = _short_names(dict.fromkeys([*robot.joints, *robot.movable]))
    found: dict[str, dict[str, tuple[float, str]]] = defaultdict(dict)
    for text in header:
        flat = f" {_flat(text)} "
        fitting = [(len(form), form, joint) for joint, forms in names.items() for form in forms if form in flat]
        if fitting:
            _, form, joint = max(fitting)
            if joint not in robot.joints:  # a follower's or a locked joint's: `j2_rod` is no `j2`
                continue
            rest, unit = flat.replace(form, " ", 1).strip(), cut(text).unit
            unit = unit if rest.endswith(_flat(unit)) else ""  # of "joint_A", A is the name
            words = cut(rest.removesuffix(_flat(unit))).words
            telling = [x for x in words if x not in ("joint", "joints", "j", "a", "state", "states")]
            signal = signal_of(telling or ["joint"], unit)
            if signal is not None:
                rank = _rank(words, signal)
                if rank > found[signal].get(joint, (-9.0, ""))[0]:
                    found[signal][joint] = (rank, text)
    return {
        signal: (min(rank for rank, _ in by.values()), {joint: text for joint, (_, text) in by.items()})
        for signal, by in found.items()
        if set(by) == set(robot.joints)
    }


def names_joint(header: str, joint: str, robot: str) -> bool:
    """Whether a header names a robot's joint. A name that says only "joint" has no foreign words beside it:
    `fr3_joint1` is no `joint1`.
    """
    flat, form = f" {_flat(header)} ", f" {_flat(joint)} "
    beside = set(cut(flat.replace(form, " ", 1).strip()).words)
    return form in flat and (set(cut(joint).words) > {"joint"} or beside <= PLAIN | set(cut(robot).words))


def _short_names(joints: Iterable[str]) -> dict[str, list[str]]:
    """Forms of a joint's name in a flattened header."""
    flat = {joint: _flat(joint) for joint in joints}
    forms: dict[str, list[str]] = {}
    universal = {"shoulder pan joint": "base", "shoulder lift joint": "shoulder", "elbow joint": "elbow"}
    for joint, name in flat.items():
        own = [name]
        if name.endswith(" joint"):
            own += [name.removesuffix(" joint"), name.removesuffix(" joint").replace(" ", "")]
        if name in universal:
            own.append(universal[name])
        forms[joint] = [f" {form} " for form in own]
    return forms


def _by_number(
    header: Sequence[str], robot: Robot, given: Mapping[int, str]
) -> dict[str, tuple[float, dict[str, str]]]:
    """Columns by numbers in their headers: {signal: (rank, {joint: header})}, vectors with a number for each joint."""
    joints = robot.joints
    vectors: dict[tuple[str | None, tuple[str, ...], int, tuple[int, ...]], dict[int, str]] = defaultdict(dict)
    cells = [cut(text) for text in header]
    beside = {h.words for h in cells}
    for h in cells:
        signal = signal_of(h.words, h.unit)
        if h.words == ("v",) and ("q",) in beside and ("i",) not in beside and h.unit in ("", *UNITS["velocity"]):
            signal = "velocity"  # beside currents, `v` are voltages
        for place, number in enumerate(h.numbers):
            others = h.numbers[:place] + h.numbers[place + 1 :]
            vectors[signal, h.words, place, others].setdefault(number, h.text)
    best: dict[str, tuple[float, dict[str, str]]] = {}
    for (signal, stem, _, _), members in vectors.items():
        if signal is None or len(members) < len(joints) or _of_other_joints(list(members.values()), joints):
            continue
        first = 0 if 0 in members else 1
        counted = robot.movable if len(members) == len(robot.movable) else joints
        if given:
            order = {given[k]: members[k] for k in members if k in given}
        else:
            order = {joint: members[k] for k, joint in enumerate(counted, start=first) if k in members}
        if not set(joints) <= set(order):
            continue
        rank = _rank(stem, signal) - 0.01 * abs(len(members) - len(joints))
        if rank > best.get(signal, (-9.0, {}))[0]:
            best[signal] = (rank, {joint: order[joint] for joint in joints})
    return best


def _of_other_joints(headers: Sequence[str], joints: Sequence[str]) -> bool:
    """True if numbered headers state names of joints (`arm_joint1.position`, ...) that are not the robot's.

    Plain numbers (`q[6]`, `J7 Angle`) are no names: what follows the robot's own may be a gripper or an outer axis.
    """
    if all(NAMED.fullmatch(text) for text in headers):
        own = {word for joint in joints for word in cut(joint).words}
        return len(headers) > len(joints) or not set(cut(headers[0]).words) <= own | PLAIN
    flat = " ".join(_flat(text) for text in headers)
    others = (known for known in _known_names() if not set(known) & {f" {_flat(joint)} " for joint in joints})
    return any(name in f" {flat} " for known in others for name in known)


@cache
def _known_names() -> tuple[tuple[str, ...], ...]:
    """Flattened names of the joints of each known robot; without names that say no more than "joint"."""
    from energy_opt.power.known import by_name

    found = {tuple(f" {_flat(joint)} " for joint in by_name(robot).joints) for robot in known_robots()}
    return tuple(known for known in found if not all(set(cut(name).words) <= {"joint"} for name in known))


def _flat(text: str) -> str:
    """A text in lower case; words and numbers have single spaces between them."""
    return re.sub(r"[^a-z0-9]+", " ", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", plain(text)).lower()).strip()


def _rank(words: Sequence[str], signal: str) -> float:
    """Rank of a header as a measured value: below REFUSED for commanded values, higher if it is said to be measured.

    A position's is lower if the words only say "joint", and still lower if some are unknown.
    """
    have = set(words)
    rank = len(have & MEASURED) * 0.3 - (4.0 if have & COMMANDED else 0.0) - 0.01 * len(words)
    if signal == "position" and not have & SIGNALS[signal]:
        rank -= 0.4 if have <= PLAIN | COMMANDED else 0.8
    return rank


def time_columns(header: Sequence[str]) -> list[str]:
    """Headers that may hold the stamps, likeliest first."""
    ranked = []
    for k, text in enumerate(header):
        h = cut(text)
        have = [TIME.index(word) for word in h.words if word in TIME]
        if not have and re.fullmatch(r"_*(id|index|ms|s|t|sec)_*", text.strip().lower()):
            have = [len(TIME)]
        if have and not set(h.words) & NOT_TIME:
            ranked.append((min(have) + (3 if "header" in h.words else 0) + len(h.words) / 10 + k / 1e4, text))
    return [text for _, text in sorted(ranked)]
