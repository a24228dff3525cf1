"""Files of the field: trajectories and waypoints in, trajectories out, one module a format.

Joints are matched by name, never by order. Nothing here needs a ROS installation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from energy_opt.errors import BadInput
from energy_opt.formats import bags, franka, messages, table, urscript
from energy_opt.formats.rows import Rows
from energy_opt.motion.path import JointPath
from energy_opt.motion.trajectory import Trajectory


@dataclass(frozen=True)
class Format:
    """One kind of file.

    Attributes:
        name: as `--write` takes it.
        suffix: of a file that is written; where `read` is given, files with it or with `others` are read.
        text: what it is, in a line.
        read: the rows of a file; None where the kind is only written.
        write: a trajectory to a file; None where the kind is only read.
    """

    name: str
    suffix: str
    text: str
    read: Callable[[Path], Rows] | None = None
    write: Callable[[Trajectory, Path], None] | None = None
    others: tuple[str, ...] = ()


FORMATS: dict[str, Format] = {
    f.name: f
    for f in (
        Format("csv", ".csv", "table: time, <joint>.position, ...", table.read, table.write),
        Format(
            "yaml", ".yaml", "trajectory_msgs/JointTrajectory", messages.read_yaml, messages.write_yaml, (".yml",)
        ),
        Format(
            "json", ".json", "trajectory_msgs/JointTrajectory", messages.read_json_file, messages.write_json_file
        ),
        Format(
            "follow-joint-trajectory", ".goal.yaml", "control_msgs/FollowJointTrajectory goal",
            write=messages.write_goal,
        ),
        Format(
            "mcap", ".mcap", "bag with a trajectory_msgs/JointTrajectory", bags.read, bags.write_mcap, bags.SUFFIXES[1:]
        ),
        Format("urscript", ".script", "program for Universal Robots", write=urscript.write),
        Format("franka", ".franka.csv", "joint positions for libfranka", write=franka.write),
    )
}  # fmt: skip


def read(path: str | Path) -> Rows:
    """The rows of a file, by its suffix: a trajectory where they have times, else waypoints.

    Raises:
        BadInput: the file is of no known kind, or faulty; names the place.
    """
    path = Path(path)
    if path.is_dir() and bags.is_bag(path):
        return bags.read(path)
    readable = [f for f in FORMATS.values() if f.read is not None]
    for f in readable:
        if path.suffix.lower() in (f.suffix, *f.others):
            assert f.read is not None
            return f.read(path)
    known = ", ".join(suffix for f in readable for suffix in (f.suffix, *f.others))
    raise BadInput(f"{path}: not a file of waypoints or of a trajectory; known are {known}")


def write(trajectory: Trajectory, path: Path) -> None:
    """Write the rows of a trajectory to a file, in the format that its name ends with.

    Raises:
        BadInput: no format has that ending.
    """
    fitting = [f for f in FORMATS.values() if f.write is not None and path.name.lower().endswith(f.suffix)]
    if not fitting:
        known = ", ".join(f.suffix for f in FORMATS.values() if f.write is not None)
        raise BadInput(f"{path}: no format has this ending; known are {known}")
    best = max(fitting, key=lambda f: len(f.suffix))
    assert best.write is not None
    best.write(trajectory, path)


def read_trajectory(path: str | Path, joints: Sequence[str], prefix: str = "") -> Trajectory:
    """The trajectory in a file, for the robot's `joints`; in the file their names begin with `prefix`.

    Raises:
        BadInput: the file is not readable, holds waypoints only, or lacks a joint.
    """
    return read(path).of(joints, prefix).trajectory()


def read_path(path: str | Path, joints: Sequence[str], prefix: str = "") -> JointPath:
    """The path in a file: of a trajectory, which it keeps, or through waypoints.

    Raises:
        BadInput: the file is not readable, or lacks a joint.
    """
    return read(path).of(joints, prefix).path()


__all__ = ["FORMATS", "Format", "JointPath", "Rows", "Trajectory", "read", "read_path", "read_trajectory", "write"]
