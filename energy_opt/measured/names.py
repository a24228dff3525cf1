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
    angle = re.fullmatch(r"(\D+?)\s*(/|_per_|\.)\s*s(?:ec)?(\^?-?2|²)?\s*", word)
    if angle and kind in BY_SIGNAL:
        unit = OTHER.get(angle.group(1), angle.group(1)) + ("/s^2" if angle.group(3) else "/s")
        return lower.get(unit.lower())
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
    "position": words_in("q pos position positions angle angles theta encoder winkel jpos"),
}
JOINT = words_in("joint joints j axis axes a achse achs gelenk")  # alone, they mean the joint's position
# Beside a word of JOINT, these say that the column is no position; unknown words make it the last choice.
QUANTITIES = words_in(
    "pwm duty load last auslastung utilization power energy leistung watt watts jerk ruck friction stiffness damping "
    "gain kp ki kd frequency pressure vibration noise brake bremse enable enabled status flag fault alarm warning id"
)
# Words for commanded or computed values: measured ones are wanted.
COMMANDED = words_in(
    "computed calculated calc model modelled modeled simulated sim estimate estimated est theoretical feedforward "
    "predicted target targets desired des command commanded cmd ref reference setpoint setpoints sp goal d planned "
    "nominal demand demanded requested expected soll vorgabe consigne consigna objetivo riferimento referencia"
)
STRANGE = words_in(  # a header with one of these words is no joint's signal
    "tcp cartesian tool pose wrench force ext external hat output register registers bit bits mode digital analog "
    "voltage volt voltages limit limits max min seq covariance contact collision name names accelerometer gripper "
    "finger momentum factor fraction scaling time stamp percent pct counts ticks increments error err deviation fehler"
)
MEASURED = words_in("actual measured state states act ist real feedback fb meas pv joint")
NAMED = re.compile(r".*\d[./](?:position|velocity|acceleration|effort|current|temperature)")  # a joint's own name
PLAIN = frozenset[str]().union(*SIGNALS.values(), JOINT, MEASURED, words_in("robot arm states data"))  # say no name
REFUSED = -2.0  # highest rank of commanded values
TIME = (
    "time", "timestamp", "stamp", "t", "zeit", "datetime", "date", "clock", "elapsed", "secs", "seconds", "zeitstempel",
    "datum", "uhrzeit", "duration",
)  # fmt: skip
NOT_TIME = words_in("execution frame nsecs nanosec control run cycle delta")
PARTS = PLAIN | COMMANDED | STRANGE | words_in("motor wirk schein blind gesamt leistung power wert")  # of joined words


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
    words = tuple(word for part in parts if not part.isdigit() for word in _parted(part.lower()))
    numbers = tuple(int(part) for part in parts if part.isdigit() and len(part) < 5)
    return Header(text, words, numbers, unit)


def _parted(word: str) -> tuple[str, ...]:
    """The known words that a word joins: `sollwinkel` is ("soll", "winkel"), `qref` ("q", "ref")."""
    if word not in PARTS and word not in TIME:
        for k in range(1, len(word)):
            first, rest = word[:k], _parted(word[k:])
            if first in PARTS and (k > 1 or first in "qi") and len(rest[-1]) > 1 and PARTS.issuperset(rest):
                return first, *rest
    return (word,)


def unit_in(kind: str, header: str) -> str | None:
    """The unit of a kind that a header itself names."""
    return known_unit(kind, cut(header).unit)


def signal_of(words: Iterable[str], unit: str) -> str | None:
    """The joint signal that words and a unit ("" for none) name, or None.

    Words that only say "joint" mean the signal of the unit, and the position without one.
    """
    have = set(words)
    if have & STRANGE:
        return None
    if {"q", "dot"} <= have or {"theta", "dot"} <= have:
        return "velocity"
    named = next((signal for signal, known in SIGNALS.items() if have & known), None)
    if named is not None or not have & JOINT or have & QUANTITIES:
        return named
    return next((signal for signal in SIGNALS if known_unit(signal, unit)), None) if unit else "position"


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
    for text in header:
        h = cut(text)
        for place, number in enumerate(h.numbers):
            others = h.numbers[:place] + h.numbers[place + 1 :]
            vectors[signal_of(h.words, h.unit), h.words, place, others].setdefault(number, text)
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
    return re.sub(r"[^a-z0-9]+", " ", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text).lower()).strip()


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
