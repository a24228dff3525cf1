"""Measured data in a bag: joint states beside a topic of power, as the two tables that `energy-opt import` reads.

Power is a number on a topic whose name says power or watt; else a sensor_msgs/BatteryState; else the product of two
numbers whose topics say voltage and current. Messages with a header have its stamp for their time, others the time of
recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import write_table
from energy_opt.formats.bags import Bag, opened

STATES = ("sensor_msgs/msg/JointState",)
BATTERY = "sensor_msgs/msg/BatteryState"
NUMBERS = tuple(
    f"std_msgs/msg/{kind}" for kind in ("Float64", "Float32", "Int64", "Int32", "Int16", "UInt32", "UInt16")
)
FIELDS = ("position", "velocity", "effort")

Series = tuple[np.ndarray, np.ndarray]  # time (M,) [s] of the recorder's clock, values (M, ...)


def unpack(path: Path, folder: Path) -> tuple[list[Path], list[str]]:
    """Write a bag's joint states and power into a folder, `<bag>.csv` and `<bag>_power.csv`; these, and remarks.

    Raises:
        BadInput: the bag has no joint states or nothing that is power; names the topics that there are.
    """
    with opened(path) as bag:
        joints, states, notes = _states(bag, path)
        (time, power), said = _power(bag, path)
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


def _states(bag: Bag, path: Path) -> tuple[tuple[str, ...], list[Any], list[str]]:
    """Names, and time, positions, velocities and efforts (None where not given), of the arm's joint states."""
    topics = {topic for topic, kind in bag.topics().items() if kind in STATES}
    if not topics:
        raise BadInput(f"{path}: no sensor_msgs/JointState; its topics are {bag.described()}")
    samples: dict[tuple[str, tuple[str, ...]], list[tuple[float, Any]]] = {}
    for topic, _, stamp, found in bag.messages(lambda topic, kind: topic in topics):
        samples.setdefault((topic, tuple(found.name)), []).append((_time(found, stamp), found))
    usable = {key: value for key, value in samples.items() if len(value) > 1 and key[1]}
    if not usable:
        raise BadInput(f"{path}: fewer than two joint states of the same joints")
    topic, names = max(usable, key=lambda key: (len(key[1]), len(usable[key])))
    notes = [f"{path}: joint states of {topic}: {len(names)} joints, {len(usable[topic, names])} messages"]
    left = [f"{t} ({', '.join(n[:3])}{', ...' if len(n) > 3 else ''})" for t, n in usable if (t, n) != (topic, names)]
    if left:
        notes.append(f"{path}: joint states that are left out: {'; '.join(left[:5])}")
    time, chosen = _rising(usable[topic, names])
    blocks = []
    for field in FIELDS:
        lengths = {len(getattr(message, field)) for message in chosen}
        block = np.array([getattr(message, field) for message in chosen]) if lengths == {len(names)} else None
        blocks.append(block if block is not None and np.isfinite(block).all() else None)
    if blocks[0] is None:
        raise BadInput(f"{path}: {topic}: messages without a finite position for each joint")
    return names, [time, *blocks], notes


def _power(bag: Bag, path: Path) -> tuple[Series, list[str]]:
    """The series of power in a bag, and notes on how it was found.

    In this order: a number on a topic that is named power or watt; voltage times current of a battery; a topic of
    voltage times one of current.

    Raises:
        BadInput: none of these.
    """
    topics = bag.topics()
    numeric = [topic for topic, kind in topics.items() if kind in NUMBERS]
    named = [topic for topic in numeric if any(word in topic.lower() for word in ("power", "watt"))]
    batteries = [topic for topic, kind in topics.items() if kind == BATTERY]
    volts = [topic for topic in numeric if "volt" in topic.lower()]
    amperes = [topic for topic in numeric if "curr" in topic.lower() or "amp" in topic.lower()]
    if named:
        topic = _busiest(bag, named)
        return _series(bag, topic, path), [f"{path}: power [W] is {topic}", *_others(named, topic, path)]
    if batteries:
        topic = _busiest(bag, batteries)
        samples = [(_time(m, stamp), float(m.voltage) * float(m.current)) for _, _, stamp, m in _of(bag, topic)]
        time, values = _rising(samples)
        power = np.array(values)
        if not np.isfinite(power).all():
            raise BadInput(f"{path}: {topic}: voltage or current is not a number in some messages")
        drawn = "below" if power.mean() < 0 else "above"
        said = f"{path}: power is voltage times current of {topic}, what is drawn is {drawn} zero there"
        return (time, -power if drawn == "below" else power), [said, *_others(batteries, topic, path)]
    if volts and amperes:
        volt, ampere = _busiest(bag, volts), _busiest(bag, amperes)
        (tv, v), (ta, a) = _series(bag, volt, path), _series(bag, ampere, path)
        return (ta, np.interp(ta, tv, v) * a), [f"{path}: power is {volt} [V] times {ampere} [A]"]
    raise BadInput(
        f"{path}: no power: expected a number on a topic named power, a BatteryState, or voltage and current; its "
        f"topics are {bag.described()}"
    )


def _of(bag: Bag, wanted: str) -> Any:
    return bag.messages(lambda topic, kind: topic == wanted)


def _series(bag: Bag, topic: str, path: Path) -> Series:
    """The numbers of a topic; at least two of them, all finite."""
    time, values = _rising([(_time(found, stamp), float(found.data)) for _, _, stamp, found in _of(bag, topic)])
    if len(values) < 2 or not np.isfinite(values).all():
        raise BadInput(f"{path}: {topic}: expected two finite numbers or more")
    return time, np.array(values)


def _busiest(bag: Bag, topics: Sequence[str]) -> str:
    """The topic with the most messages."""
    counts = bag.counts()
    return max(topics, key=lambda topic: counts[topic])


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
