"""Meaning of a header's words and units, in the field's conventions: `actual_q_0`, `dq[3]`, `J1 Angle (deg)`, ...

A header is cut into words, numbers and a unit. Headers that differ by a number only are a vector over the joints; a
joint's own name among the words makes the header that joint's.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

from energy_opt.robot import Robot, known_robots

DEGREE = math.pi / 180
# Factors to SI units, by kind of quantity; the first unit of each is SI's. A word in another case means the last unit
# that differs from it in case alone: "mj" are mJ, though MJ are known.
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "position": {"rad": 1.0, "deg": DEGREE, "rev": 2 * math.pi, "m": 1.0, "mm": 1e-3},
    "velocity": {"rad/s": 1.0, "deg/s": DEGREE, "rpm": math.pi / 30, "rev/s": 2 * math.pi, "m/s": 1.0, "mm/s": 1e-3},
    "acceleration": {"rad/s^2": 1.0, "deg/s^2": DEGREE, "m/s^2": 1.0, "mm/s^2": 1e-3},
    "effort": {"N m": 1.0, "Nm": 1.0, "mN m": 1e-3, "N": 1.0},
    "current": {"A": 1.0, "mA": 1e-3},
    "voltage": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
    "temperature": {"degC": 1.0},
    "power": {"W": 1.0, "MW": 1e6, "mW": 1e-3, "kW": 1e3, "uW": 1e-6},
    "energy": {
        "J": 1.0, "kJ": 1e3, "MJ": 1e6, "mJ": 1e-3, "Ws": 1.0, "MWh": 3.6e9, "mWh": 3.6, "Wh": 3600.0, "kWh": 3.6e6,
    },
}  # fmt: skip
BY_SIGNAL = {"position": "", "velocity": "/s", "acceleration": "/s^2"}  # suffix of an angle's unit, by signal
OTHER = {
    "°": "deg", "º": "deg", "degree": "deg", "degrees": "deg", "grad": "deg", "radian": "rad", "radians": "rad",
    "sec": "s", "second": "s", "seconds": "s", "msec": "ms", "µs": "us", "μs": "us", "usec": "us", "turn": "rev",
    "turns": "rev", "1/min": "rpm", "u/min": "rpm", "°c": "degC", "c": "degC", "celsius": "degC", "watt": "W",
    "watts": "W", "ampere": "A", "amps": "A", "amp": "A", "joule": "J", "joules": "J", "n*m": "N m", "n.m": "N m",
    "n-m": "N m", "n·m": "N m", "nm": "N m", "mnm": "mN m",
}  # fmt: skip


def known_unit(kind: str, word: str) -> str | None:
    """The unit of UNITS[kind] that a word of a header or a unit row means, None where it means none.

    >>> known_unit("position", "[°]"), known_unit("velocity", "deg/s"), known_unit("energy", "(kWh)")
    ('deg', 'deg/s', 'kWh')
    """
    word = word.strip().strip("[](){}<> ").strip()
    if not word or kind not in UNITS:
        return None
    lower = {name.lower(): name for name in UNITS[kind]}
    if word in UNITS[kind]:
        return word
    word = word.lower()
    angle = re.fullmatch(r"(\D+?)\s*(/|_per_|\.)\s*s(?:ec)?(?:\^?(-?2)|²)?\s*", word)
    if angle and kind in BY_SIGNAL:
        stem = OTHER.get(angle.group(1), angle.group(1))
        return lower.get(f"{stem}{BY_SIGNAL[kind]}".lower())
    return lower.get(OTHER.get(word, word).lower())


def words_in(text: str) -> frozenset[str]:
    """The words of a text that spaces separate."""
    return frozenset(text.split())


# Words that identify a joint's signal, the most specific signals first ("joint" is in many headers).
SIGNALS: dict[str, frozenset[str]] = {
    "acceleration": words_in("qdd ddq acc accel acceleration accelerations ddtheta beschleunigung"),
    "velocity": words_in("qd dq vel velocity velocities speed speeds omega qdot dtheta rate geschwindigkeit"),
    "effort": words_in("tau effort efforts torque torques moment moments drehmoment"),
    "current": words_in("current currents cur strom ampere i"),
    "temperature": words_in("temp temps temperature temperatures temperatur"),
    "position": words_in(
        "q pos position positions angle angles theta encoder joint joints j axis axes a achse winkel jpos"
    ),
}
# Words for commanded or computed values: measured ones are wanted.
COMMANDED = words_in(
    "computed calculated calc model modelled modeled simulated sim estimate estimated est theoretical feedforward "
    "predicted target desired des command commanded cmd ref reference setpoint goal d soll error err planned nominal"
)
STRANGE = words_in(  # a header with one of these words is no joint's signal
    "tcp cartesian tool pose wrench force ext external hat output register registers bit bits mode digital analog "
    "voltage volt voltages limit limits max min seq covariance contact collision name names accelerometer gripper "
    "finger momentum factor fraction scaling time stamp percent pct counts ticks increments"
)
MEASURED = words_in("actual measured state states act ist real feedback fb meas joint")
NAMED = re.compile(r".*\d[./](?:position|velocity|acceleration|effort|current|temperature)")  # a joint's own name
PLAIN = frozenset[str]().union(*SIGNALS.values(), MEASURED, words_in("robot arm states data"))  # say no name
TIME = (
    "time", "timestamp", "stamp", "t", "zeit", "datetime", "date", "clock", "elapsed", "secs", "seconds", "zeitstempel",
    "datum", "uhrzeit", "duration",
)  # fmt: skip
NOT_TIME = words_in("execution frame nsecs nanosec control run cycle delta")


@dataclass(frozen=True)
class Header:
    """A header split into words in lower case, numbers, and its unit (as written)."""

    text: str
    words: tuple[str, ...]
    numbers: tuple[int, ...]
    unit: str


@lru_cache(maxsize=8192)
def cut(text: str) -> Header:
    """Split a header into words, numbers and unit.

    >>> cut("J1 Angle (deg)")
    Header(text='J1 Angle (deg)', words=('j', 'angle'), numbers=(1,), unit='deg')
    >>> cut("/joint_states/position[2]").words
    ('joint', 'states', 'position')
    """
    rest, unit = text, ""
    bracket = re.search(r"[\[(<{]\s*([^\[\](){}<>]*[^\d\[\](){}<>\s][^\[\](){}<>]*)\s*[\])>}]\s*$", rest)
    if bracket and any(known_unit(kind, bracket.group(1)) for kind in UNITS):
        rest, unit = rest[: bracket.start()], bracket.group(1).strip()
    parts = re.findall(r"[A-Za-zµμ°À-ÿ]+|\d+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", rest))
    if not unit and len(parts) > 1:
        tail = re.search(r"[_ ./-]((?:rad|deg|°|mm|m|rev)_?(?:per_?|/|_)?s(?:2|\^2)?|[A-Za-zµμ°]+)$", rest)
        word = tail.group(1) if tail else ""
        # the only single letters that are units are s, W, A, V, J and °
        telling = word in "sWAVJ°" if len(word) == 1 else word.lower() not in ("min", "h", "rev", "turn", "n")
        if word and telling and any(known_unit(kind, word) for kind in UNITS):
            rest, unit = rest[: tail.start()] if tail else rest, word
            parts = re.findall(r"[A-Za-zµμ°À-ÿ]+|\d+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", rest))
    words = tuple(part.lower() for part in parts if not part.isdigit())
    numbers = tuple(int(part) for part in parts if part.isdigit() and len(part) < 5)
    return Header(text, words, numbers, unit)


def unit_in(kind: str, header: str) -> str | None:
    """The unit of a kind that a header itself names."""
    return known_unit(kind, cut(header).unit)


def signal_of(words: Iterable[str]) -> str | None:
    """The joint signal that words name, or None."""
    have = set(words)
    if have & STRANGE:
        return None
    if {"q", "dot"} <= have or {"theta", "dot"} <= have:
        return "velocity"
    return next((signal for signal, known in SIGNALS.items() if have & known), None)


def joint_columns(
    header: Sequence[str], robot: Robot, given: Mapping[int, str] | None = None
) -> dict[str, dict[str, str]]:
    """Which header holds which joint's signal: {signal: {joint: header}}, only signals found for every joint.

    Numbers stand for the robot's own order, unless the headers state the names of other joints. If there is a number
    for each joint that could move, they are those of followers (mimic) and locked joints, too.

    Args:
        header: of a file. robot: the arm. given: joint name by number, where the file itself says.
    """
    found = _by_number(header, robot, given or {}) | _by_name(header, robot)
    return {signal: found[signal] for signal in SIGNALS if signal in found}


def _by_name(header: Sequence[str], robot: Robot) -> dict[str, dict[str, str]]:
    """Columns by the joints' names in their headers: {signal: {joint: header}} of signals that all joints have."""
    names = _short_names(dict.fromkeys([*robot.joints, *robot.movable]))
    found: dict[str, dict[str, tuple[float, str]]] = defaultdict(dict)
    for text in header:
        flat = f" {_flat(text)} "
        fitting = [(len(form), form, joint) for joint, forms in names.items() for form in forms if form in flat]
        if fitting:
            _, form, joint = max(fitting)
            if joint not in robot.joints:  # a follower's or a locked joint's: `j2_rod` is no `j2`
                continue
            words = cut(flat.replace(form, " ", 1)).words
            telling = [x for x in words if x not in ("joint", "joints", "j", "a")]
            signal = signal_of(telling) or ("position" if not telling or set(telling) <= {"states", "state"} else None)
            if signal is not None:
                rank = _rank(words)
                if rank > found[signal].get(joint, (-9.0, ""))[0]:
                    found[signal][joint] = (rank, text)
    whole = {signal: {j: text for j, (_, text) in by.items()} for signal, by in found.items()}
    return {signal: by for signal, by in whole.items() if set(by) == set(robot.joints)}


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


def _by_number(header: Sequence[str], robot: Robot, given: Mapping[int, str]) -> dict[str, dict[str, str]]:
    """Columns by numbers in their headers: {signal: {joint: header}} of vectors with a number for each joint."""
    joints = robot.joints
    vectors: dict[tuple[tuple[str, ...], int, tuple[int, ...]], dict[int, str]] = defaultdict(dict)
    for text in header:
        h = cut(text)
        for place, number in enumerate(h.numbers):
            others = h.numbers[:place] + h.numbers[place + 1 :]
            vectors[h.words, place, others].setdefault(number, text)
    best: dict[str, tuple[float, dict[str, str]]] = {}
    for (stem, _, _), members in vectors.items():
        signal = signal_of(stem)
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
        rank = _rank(stem) - 0.01 * abs(len(members) - len(joints))
        if rank > best.get(signal, (-0.5, {}))[0]:
            best[signal] = (rank, {joint: order[joint] for joint in joints})
    return {signal: order for signal, (_, order) in best.items()}


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
    return re.sub(r"[^a-z0-9]+", " ", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text).lower()).strip()


def _rank(words: Sequence[str]) -> float:
    """Rank of a header as a measured value: below 0 for commanded values, above 0 if it is said to be measured."""
    have = set(words)
    return len(have & MEASURED) * 0.3 - (2.0 if have & COMMANDED else 0.0) - 0.01 * len(words)


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
