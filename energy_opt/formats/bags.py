"""Bags of ROS 2 (sqlite3, MCAP) and ROS 1, read and written without ROS. The only module that imports rosbags.

Old sqlite3 bags lack the definitions of their messages; moveit_msgs.toml has those that are needed.

The size that a file states for its compressed parts is not trusted. The library unpacks each part at once, whatever its
size. Inside `bounded` its decompressors are replaced by ones that stop at a bound for each part and at one for the
whole bag.
"""

from __future__ import annotations

import bz2
import dataclasses
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import inside, read_toml, read_yaml, replacing
from energy_opt.formats.messages import FIELDS, message, planned, trajectories
from energy_opt.formats.waypoints import Samples
from energy_opt.motion.trajectory import Trajectory

LARGEST = 4 * 10**9  # [bytes] largest bag
MOST_MESSAGES = 2 * 10**6  # most messages of the requested topics: half an hour at 1 kHz
SUFFIXES = (".mcap", ".db3", ".bag", ".zstd")  # the last: a file of a compressed bag
METADATA = "metadata.yaml"
TOPIC = "/joint_trajectory"
PLANS = (
    "trajectory_msgs/msg/JointTrajectory",
    "moveit_msgs/msg/RobotTrajectory",
    "moveit_msgs/msg/DisplayTrajectory",
    "control_msgs/msg/FollowJointTrajectoryActionGoal",
    "control_msgs/msg/FollowJointTrajectoryGoal",
    "control_msgs/action/FollowJointTrajectory_Goal",
    "control_msgs/action/FollowJointTrajectory_SendGoal_Request",
)
DEFINITIONS = Path(__file__).with_name("moveit_msgs.toml")


def is_bag(path: Path) -> bool:
    """Whether a path is a bag by its name, or a folder with a bag's metadata."""
    return path.suffix.lower() in SUFFIXES or (path / METADATA).is_file()


def read(path: Path) -> Samples:
    """The last planned trajectory of a bag, whichever message holds it.

    Raises:
        BadInput: rosbags is not installed, the bag is not readable, or holds no plan; names the topics that there are.
    """
    with opened(path) as bag:
        plans = [
            plan
            for _, _, _, found in bag.messages(lambda topic, kind: kind in PLANS)
            for plan in trajectories(as_document(found))
        ]
        if not plans:
            raise BadInput(f"{path}: no planned trajectory; its topics are {bag.described()}")
    return planned(plans, str(path))


class Bag:
    """An open bag."""

    def __init__(self, path: Path, reader: Any) -> None:
        self._path, self._reader = path, reader

    def topics(self) -> dict[str, str]:
        """The type of the messages of each topic."""
        return {connection.topic: connection.msgtype for connection in self._reader.connections}

    def counts(self) -> dict[str, int]:
        """The number of messages of each topic."""
        return {connection.topic: connection.msgcount for connection in self._reader.connections}

    def described(self) -> str:
        """Topics and types, for a message."""
        shown = [f"{topic} ({kind})" for topic, kind in self.topics().items()]
        return ", ".join(shown[:12]) + (", ..." if len(shown) > 12 else "") or "none"

    def messages(self, wanted: Callable[[str, str], bool]) -> Iterator[tuple[str, str, int, Any]]:
        """Topic, type, time of recording [ns] and message, in order of time.

        Args:
            wanted: of topic and type, True for topics to read.

        Raises:
            BadInput: these topics have more than MOST_MESSAGES messages.
        """
        chosen = [c for c in self._reader.connections if wanted(c.topic, c.msgtype)]
        if not chosen:
            return
        if sum(c.msgcount for c in chosen) > MOST_MESSAGES:
            raise BadInput(f"{self._path}: more than {MOST_MESSAGES} messages of the topics that are needed")
        for connection, stamp, raw in self._reader.messages(chosen):
            yield connection.topic, connection.msgtype, stamp, self._reader.deserialize(raw, connection.msgtype)


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """A bag, open for reading.

    Raises:
        BadInput: rosbags is not installed, or the bag is missing, too large or faulty, now or while it is read.
    """
    library, path = _library(), _whole(path)
    files = [file for file in path.iterdir() if file.is_file()] if path.is_dir() else [path]
    try:
        size = sum(file.stat().st_size for file in files)
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}") from None
    if size > LARGEST:
        raise BadInput(f"{path}: larger than {LARGEST / 1e9:g} GB; cut out the needed part")
    if path.is_dir():
        for name in _listed(path):
            inside(path, str(name))  # a bag's files lie in its folder
    elif path.suffix.lower() == ".zstd":
        raise BadInput(f"{path}: part of a compressed bag; expected beside it the bag's {METADATA}, which names it")
    try:
        readers = library.first, library.second, library.mcap
        with bounded(path, size, *readers), library.highlevel.AnyReader([path], default_typestore=_types()) as reader:
            yield Bag(path, reader)
    except BadInput:
        raise
    except Exception as error:  # a faulty bag may raise almost any exception in the library
        reason = " ".join(str(error).split()) or type(error).__name__
        raise BadInput(f"{path}: not a readable bag: {reason[:300]}") from None


def _listed(folder: Path) -> list[Any]:
    """The files that a bag's metadata names."""
    document = read_yaml(folder / METADATA)
    about = document.get("rosbag2_bagfile_information") if isinstance(document, dict) else None
    return (about.get("relative_file_paths") or []) if isinstance(about, dict) else []


def _whole(path: Path) -> Path:
    """The folder of a bag whose only file is `path`, if its metadata says so; else the path itself."""
    if path.suffix.lower() == ".bag" or not path.is_file() or not (path.parent / METADATA).is_file():
        return path
    return path.parent if _listed(path.parent) == [path.name] else path


def as_document(found: Any) -> Any:
    """A message as plain mappings, lists and numbers."""
    if dataclasses.is_dataclass(found) and not isinstance(found, type):
        return {field.name: as_document(getattr(found, field.name)) for field in dataclasses.fields(found)}
    if isinstance(found, np.ndarray):
        return found.tolist()
    if isinstance(found, list):
        return [as_document(item) for item in found]
    return found


def write_mcap(trajectory: Trajectory, path: Path) -> None:
    """Write one trajectory_msgs/JointTrajectory on /joint_trajectory as an MCAP file, with the message's definition."""
    rosbag2, types = _library().rosbag2, _types()
    with tempfile.TemporaryDirectory(prefix="energy-opt-") as folder:
        bag = Path(folder) / "bag"
        with rosbag2.Writer(bag, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
            connection = writer.add_connection(TOPIC, PLANS[0], typestore=types)
            writer.write(connection, 0, types.serialize_cdr(_message(types.types, trajectory), PLANS[0]))
        (file,) = bag.glob("*.mcap")
        with replacing(path) as aside:
            aside.write_bytes(file.read_bytes())


def _message(types: Mapping[str, Any], trajectory: Trajectory) -> Any:
    """A trajectory as the library's message object."""
    document = message(trajectory)
    stamp, duration = types["builtin_interfaces/msg/Time"], types["builtin_interfaces/msg/Duration"]
    header = types["std_msgs/msg/Header"](stamp=stamp(sec=0, nanosec=0), frame_id="")
    points = [
        types["trajectory_msgs/msg/JointTrajectoryPoint"](
            **{field: np.array(point[field], dtype=np.float64) for field in FIELDS.values()},
            time_from_start=duration(**point["time_from_start"]),
        )
        for point in document["points"]
    ]
    return types[PLANS[0]](header=header, joint_names=document["joint_names"], points=points)


def _types() -> Any:
    """The library's types of ROS 2, and those of MoveIt's plans."""
    typesys = _library().typesys
    types = typesys.get_typestore(typesys.Stores.LATEST)
    added: dict[str, Any] = {}
    for name, text in read_toml(DEFINITIONS).items():
        added.update(typesys.get_types_from_msg(text, name))
    types.register(added)
    return types


def _library() -> SimpleNamespace:
    """The parts of rosbags that are used."""
    try:
        from rosbags import highlevel, rosbag2, typesys
        from rosbags.rosbag1 import reader as first
        from rosbags.rosbag2 import reader as second
        from rosbags.rosbag2 import storage_mcap as mcap
    except ImportError:
        raise BadInput("bags need rosbags: pip install 'energy-opt[ros]'") from None
    return SimpleNamespace(highlevel=highlevel, rosbag2=rosbag2, typesys=typesys, first=first, second=second, mcap=mcap)


LARGEST_PART = 64 * 10**6  # [bytes] largest chunk or message; recorders write chunks of 1 to 16 MB
# A bag may unpack to LEAST bytes or RATIO times its size; joint states pack 3 to 10 fold.
LEAST, RATIO = 256 * 10**6, 20


class Budget:
    """Number of bytes of a bag that may still be unpacked."""

    def __init__(self, path: Path, size: int) -> None:
        self._path, self._left = path, max(LEAST, RATIO * size)

    @property
    def part(self) -> int:
        """Largest size [bytes] of one part."""
        return min(LARGEST_PART, self._left)

    def take(self, count: int, most: int | None = None) -> None:
        """Note that `count` bytes were unpacked.

        Raises:
            BadInput: they are more than `most`, or than all that is left.
        """
        if count > (self._left if most is None else most):
            raise BadInput(f"{self._path}: its unpacked size is far larger than the file; cut out the needed part")
        self._left -= count

    def unpack(self, new: Callable[[], Any], data: bytes) -> bytes:
        """All frames in `data`, each by a decompressor that `new` makes.

        Raises:
            BadInput: a frame is cut off, or they unpack to more than is allowed.
        """
        out, most = [], self.part
        while data:
            frame = new()
            out.append(frame.decompress(data, max_length=most + 1))
            self.take(len(out[-1]), most)
            most -= len(out[-1])
            if not frame.eof:
                raise BadInput(f"{self._path}: a compressed part of it is incomplete")
            data = frame.unused_data or b""
        return b"".join(out)


class _Counted:
    """A compressed file that is open for reading, counted as it is read."""

    def __init__(self, stream: Any, budget: Budget) -> None:
        self._stream, self._budget = stream, budget

    def __enter__(self) -> _Counted:
        return self

    def __exit__(self, *what: object) -> None:
        self._stream.close()

    def read(self, count: int = -1) -> bytes:
        """At most `count` bytes."""
        found: bytes = self._stream.read(min(count, LARGEST_PART) if count >= 0 else LARGEST_PART)
        self._budget.take(len(found))
        return found


@contextmanager
def bounded(path: Path, size: int, first: ModuleType, second: ModuleType, mcap: ModuleType) -> Iterator[None]:
    """Context in which the library unpacks within bounds.

    Args:
        size: of the bag's files, bytes.
        first, second, mcap: the library's readers of ROS 1, of ROS 2, and of MCAP files.
    """
    import lz4.frame

    budget, zstd = Budget(path, size), second.zstd
    lz4_frame, zstd_frame = lz4.frame.LZ4FrameDecompressor, zstd.ZstdDecompressor
    ours = (
        (mcap, "DECOMPRESSORS", {"": lambda data, _: data, "lz4": lambda data, _: budget.unpack(lz4_frame, data),
                                 "zstd": lambda data, _: budget.unpack(zstd_frame, data)}),
        (first, "decompressors", {"none": lambda data: data, "lz4": lambda data: budget.unpack(lz4_frame, data),
                                  "bz2": lambda data: budget.unpack(bz2.BZ2Decompressor, data)}),
        (second, "zstd", SimpleNamespace(
            open=lambda stream, mode: _Counted(zstd.open(stream, mode), budget),
            decompress=lambda data: budget.unpack(zstd_frame, data))),
    )  # fmt: skip
    before = [getattr(module, name) for module, name, _ in ours]
    for module, name, value in ours:
        setattr(module, name, value)
    try:
        yield
    finally:
        for (module, name, _), value in zip(ours, before, strict=True):
            setattr(module, name, value)
