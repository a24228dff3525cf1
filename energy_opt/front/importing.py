"""The verb `import`: a lab's logs as a measured set; of a bag, first as two tables: joint states, and power.

In a bag, power is a number on a topic that is named as the whole robot's, by the rules for the headers of tables; else
a sensor_msgs/BatteryState; else the product of a topic of voltage and one of current. Messages with a header have its
stamp for their time, others the time of recording."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import plain
from energy_opt.formats.bags import Bag, is_bag, opened
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import robot_of
from energy_opt.measured.columns import ByHand
from energy_opt.measured.header import UNITS, cut, unit_in
from energy_opt.measured.importing import Imported, import_files
from energy_opt.measured.meter_names import AMPERE, POWER, SINGLE, VOLT, power_column, product_columns
from energy_opt.requests.verbs import ImportRequest
from energy_opt.results import FoundSet
from energy_opt.tables import write_table

STATES = ("sensor_msgs/msg/JointState",)
BATTERY = "sensor_msgs/msg/BatteryState"
NUMBERS = tuple(
    f"std_msgs/msg/{kind}" for kind in ("Float64", "Float32", "Int64", "Int32", "Int16", "UInt32", "UInt16")
)
SAME_STAMPS = 0.9  # share of messages with the same stamps from which messages of different joints are merged
FIELDS = ("position", "velocity", "effort")

States = dict[tuple[str, tuple[str, ...]], list[tuple[float, Any]]]  # times [s] and messages by topic and joints
Series = tuple[np.ndarray, np.ndarray]  # time (M,) [s] of the recorder's clock, values (M, ...)


def unpack(path: Path, folder: Path) -> tuple[list[Path], list[str]]:
    """Write a bag's joint states and power into a folder, `<bag>.csv` and `<bag>_power.csv`; these, and remarks.

    Raises:
        BadInput: the bag has no joint states or nothing that is power; names the topics that there are.
    """
    with opened(path) as bag:
        topic, joints, states, notes = _states(bag, path)
        (time, power), said = _power(bag, path, topic.rpartition("/")[0] + "/")
    zero = float(states[0][0])
    header, columns = ["time"], [states[0] - zero]
    for field, block in zip(FIELDS, states[1:], strict=True):
        if block is not None:
            header += [f"{joint}.{field}" for joint in joints]
            columns += list(block.T)
    files = [folder / f"{path.stem}.csv", folder / f"{path.stem}_power.csv"]
    write_table(files[0], header, columns)
    write_table(files[1], ["time", "power"], [time - zero, power])
    return files, [*notes, *said]


def _states(bag: Bag, path: Path) -> tuple[str, tuple[str, ...], list[Any], list[str]]:
    """Topic, names, and time, positions, velocities and efforts (None where not given), of the arm's joint states."""
    topics = {topic for topic, kind in bag.topics().items() if kind in STATES}
    if not topics:
        raise BadInput(f"{path}: no sensor_msgs/JointState; its topics are {bag.described()}")
    samples: States = {}
    for topic, _, stamp, found in bag.messages(lambda topic, kind: topic in topics):
        samples.setdefault((topic, tuple(sorted(found.name))), []).append((_time(found, stamp), found))
    usable, merged = _merged({key: value for key, value in samples.items() if len(value) > 1 and key[1]})
    if not usable:
        raise BadInput(f"{path}: fewer than two joint states of the same joints")
    topic, names = max(usable, key=lambda key: (len(key[1]), len(usable[key])))
    notes = [f"{path}: joint states of {topic}: {len(names)} joints, {len(usable[topic, names])} messages"]
    notes += [f"{path}: messages with the same stamps are merged: {', '.join(part)}" for part in merged]
    left = [f"{t} ({', '.join(n[:3])}{', ...' if len(n) > 3 else ''})" for t, n in usable if (t, n) != (topic, names)]
    if left:
        notes.append(f"{path}: joint states that are left out: {'; '.join(left[:5])}")
    time, chosen = _rising(usable[topic, names])
    order = cache(np.argsort)  # names may have another order in each message
    orders = [order(tuple(message.name)) for message in chosen]
    blocks = []
    for field in FIELDS:
        given = [getattr(message, field) for message in chosen]
        pairs = zip(given, orders, strict=True)
        whole = [len(row) == len(names) and bool(np.isfinite(row).all()) for row in given]
        blocks.append(np.array([row[places] for row, places in pairs]) if all(whole) else None)
        if any(whole) and not all(whole):
            notes.append(f"{path}: {field} is left out: no number for each joint at {whole.count(False)} stamps")
    if blocks[0] is None:
        raise BadInput(f"{path}: {topic}: messages without a finite position for each joint")
    return topic, names, [time, *blocks], notes


def _merged(samples: States) -> tuple[States, list[list[str]]]:
    """States in which messages of one stamp with different joints are one message; and the joints that were added.

    Some drivers publish the joints of one arm in parts. Parts have the same stamps, except for a few.
    """
    out: States = {}
    notes = []
    for (topic, names), found in sorted(samples.items(), key=lambda item: -len(item[0][1])):
        own = {time: message for time, message in found if len(message.position) == len(names)}
        for key, known in out.items():
            both = [
                (time, _joined(m, own[time])) for time, m in known if time in own and len(m.position) == len(m.name)
            ]
            if not set(key[1]) & set(names) and len(both) >= SAME_STAMPS * max(len(known), len(found)):
                del out[key]
                out[key[0], tuple(sorted((*key[1], *names)))] = both
                notes.append([topic, *names])
                break
        else:
            out[topic, names] = found
    return out, notes


def _joined(one: Any, other: Any) -> SimpleNamespace:
    """Two messages of joint states as one."""
    parts = {field: np.concatenate([getattr(one, field), getattr(other, field)]) for field in FIELDS}
    return SimpleNamespace(name=[*one.name, *other.name], **parts)


def _power(bag: Bag, path: Path, near: str) -> tuple[Series, list[str]]:
    """The series of power in a bag, and notes on how it was found.

    In this order: a number on a topic that is named as the robot's power; voltage times current of a battery; a topic
    of voltage times one of current. Topics whose names begin with `near` come before others.

    Raises:
        BadInput: none of these.
    """
    topics = bag.topics()
    numeric = [topic for topic, kind in topics.items() if kind in NUMBERS]
    beside = [topic for topic in numeric if topic.startswith(near)]
    batteries = [topic for topic, kind in topics.items() if kind == BATTERY]
    named = power_column(beside) or power_column(numeric)
    if named is not None:
        others = [topic for topic in numeric if POWER & set(cut(topic).words)]
        return _series(bag, named, path, "power"), [f"{path}: power is {named}", *_others(others, named, path)]
    if batteries:
        topic = max(batteries, key=lambda topic: bag.counts()[topic])
        samples = [(_time(m, stamp), float(m.voltage) * float(m.current)) for _, _, stamp, m in _of(bag, topic)]
        time, values = _rising(samples)
        power = np.array(values)
        if not np.isfinite(power).all():
            raise BadInput(f"{path}: {topic}: voltage or current is not a number in some messages")
        drawn = "below" if power.mean() < 0 else "above"
        said = f"{path}: power is voltage times current of {topic}; power that the robot draws is {drawn} zero there"
        return (time, -power if drawn == "below" else power), [said, *_others(batteries, topic, path)]
    pair = product_columns(beside) or product_columns(numeric) or (_only(numeric, VOLT), _only(numeric, AMPERE))
    volt, ampere = pair
    if volt is not None and ampere is not None:
        (tv, v), (ta, a) = _series(bag, volt, path, "voltage"), _series(bag, ampere, path, "current")
        return (ta, np.interp(ta, tv, v) * a), [f"{path}: power is {volt} [V] times {ampere} [A]"]
    raise BadInput(
        f"{path}: no power of the whole robot: expected a number on a topic named power, a BatteryState, or voltage "
        f"and current; its topics are {bag.described()}"
    )


def _only(topics: Sequence[str], words: Iterable[str]) -> str | None:
    """The topic of the whole robot that has one of the words in its name; None if there is none, or more than one."""
    having = [topic for topic in topics if {*words} & set(cut(topic).words) and not SINGLE & set(cut(topic).words)]
    return having[0] if len(having) == 1 else None


def _of(bag: Bag, wanted: str) -> Any:
    return bag.messages(lambda topic, kind: topic == wanted)


def _series(bag: Bag, topic: str, path: Path, kind: str) -> Series:
    """The numbers of a topic in SI units; at least two of them, all finite."""
    time, values = _rising([(_time(found, stamp), float(found.data)) for _, _, stamp, found in _of(bag, topic)])
    if len(values) < 2 or not np.isfinite(values).all():
        raise BadInput(f"{path}: {topic}: expected two finite numbers or more")
    return time, np.array(values) * UNITS[kind].get(unit_in(kind, topic) or "", 1.0)


def _others(topics: Sequence[str], chosen: str, path: Path) -> list[str]:
    left = [topic for topic in topics if topic != chosen]
    return [f"{path}: left out: {', '.join(left)}"] if left else []


def _time(found: Any, recorded: int) -> float:
    """Time [s] that a message states, else its time of recording."""
    stamp = getattr(getattr(found, "header", None), "stamp", None)
    if stamp is not None and (stamp.sec or stamp.nanosec):
        return float(stamp.sec + stamp.nanosec / 1e9)
    return recorded / 1e9


def _rising(samples: Sequence[tuple[float, Any]]) -> tuple[np.ndarray, list[Any]]:
    """Samples in the order of time, one for each time."""
    ordered = sorted(samples, key=lambda row: row[0])
    kept = [row for k, row in enumerate(ordered) if k == 0 or row[0] > ordered[k - 1][0]]
    return np.array([time for time, _ in kept]), [value for _, value in kept]


@dataclass(frozen=True, repr=False, eq=False)
class Set(FoundSet):
    """A measured set that was written into the folder `out`; by name: `["guesses"]`, `["remarks"]`, `["runs"]`.

    Attributes:
        imported: its robot, runs, guesses and remarks. request: what was asked.
    """

    out: Path
    imported: Imported
    request: ImportRequest

    def document(self) -> dict[str, Any]:
        """Set, robot, log, guesses, remarks and runs."""
        found = self.imported
        return {
            "set": str(self.out), "robot": found.robot.name, "log": plain(found.log), "guesses": list(found.words),
            "remarks": list(found.remarks),
            "runs": [
                {"file": r.file, "kind": r.kind, "rows": len(r.time), "readings": len(r.power), "meter": r.meter}
                for r in found.runs
            ],
        }  # fmt: skip

    def __repr__(self) -> str:
        return f"Set({str(self.out)!r}, {self.imported.robot.name!r}, {len(self.imported.runs)} runs)"


def run(request: ImportRequest, desk: Desk) -> Set:
    """Convert a lab's logs to a measured set; columns and units are guessed and reported.

    Raises:
        BadInput: no robot has these columns, or a file is at fault.
    """
    if not request.files:
        raise BadInput("no FILE; give one or more to import")
    if request.lock and request.robot is None:
        raise BadInput("--lock needs --robot: the robot that is found by its columns has no other joints")
    robot, out = None if request.robot is None else robot_of(request), Path(request.out)
    pairs = {word: word.partition("=") for word in request.joint}
    for word, parts in pairs.items():
        if not all(parts):
            raise BadInput(f"--joint {word}: JOINT=COLUMN")
    hand = ByHand(request.time, request.power, {joint: column for joint, _, column in pairs.values()})
    with tempfile.TemporaryDirectory(prefix="energy-opt-") as folder:
        files: list[Path] = []
        said: list[str] = []
        for file in map(Path, request.files):
            tables, notes = unpack(file, Path(folder)) if is_bag(file) else ([file], [])
            files += tables
            said += notes
            if notes:
                desk.say("\n".join(notes))
        with desk.showing() as show:
            show("columns, clocks and robot of each file")
            try:
                found = import_files(files, out, robot, desk.force or request.force, hand)
            except BadInput as error:  # the folder will be gone
                raise BadInput(str(error).replace(f"{Path(folder)}/", "made of the bag, ")) from None
    motions = sum(run.kind == "motion" for run in found.runs)
    readings = sum(len(run.power) for run in found.runs)
    what = f"{len(found.runs)} run(s), {motions} of them motions, {readings} readings of power"
    desk.say("\n".join([*found.words, *(f"note: {remark}" for remark in found.remarks), f"written: {out}: {what}"]))
    return Set(out, replace(found, words=(*said, *found.words)), request)


import_logs = verb(ImportRequest, run, "import_logs")
