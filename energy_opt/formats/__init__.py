"""Standard file formats: reads trajectories and waypoints, writes trajectories; one module per format.

Joints are matched by name, never by order. No ROS installation is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from energy_opt.errors import BadInput
from energy_opt.formats import bags, franka, messages, table, urscript
from energy_opt.formats.recording import path_of
from energy_opt.formats.waypoints import Samples
from energy_opt.motion.path import JointPath
from energy_opt.motion.trajectory import Trajectory


@dataclass(frozen=True)
class Format:
    """One kind of file.

    Attributes:
        name: as `--write` takes it.
        suffix: of a file that is written; files with it or with `others` are read.
        text: what it is, in a line.
        read: the samples of a file; write: a trajectory to a file.
    """

    name: str
    suffix: str
    text: str
    read: Callable[[Path], Samples]
    write: Callable[[Trajectory, Path], None]
    others: tuple[str, ...] = ()


MESSAGE, GOAL = "trajectory_msgs/JointTrajectory", "control_msgs/FollowJointTrajectory goal"
FORMATS: dict[str, Format] = {
    f.name: f
    for f in (
        Format("csv", ".csv", "table: time, <joint>.position, ...", table.read, table.write),
        Format("yaml", ".yaml", MESSAGE, messages.read_yaml, messages.write_yaml, (".yml",)),
        Format("json", ".json", MESSAGE, messages.read_json_file, messages.write_json_file),
        Format("follow-joint-trajectory", ".goal.yaml", GOAL, messages.read_yaml, messages.write_goal),
        Format("mcap", ".mcap", f"bag with a {MESSAGE}", bags.read, bags.write_mcap, bags.SUFFIXES[1:]),
        Format("urscript", ".script", "program for Universal Robots", urscript.read, urscript.write),
        Format("franka", ".franka.csv", "joint positions for libfranka", franka.read, franka.write),
    )
}


def read(path: str | Path) -> Samples:
    """The samples of a file, by its suffix: a trajectory if they have times, else waypoints.

    Raises:
        BadInput: the file is of no known kind, or faulty; names the place.
    """
    path = Path(path)
    if path.is_dir() and bags.is_bag(path):
        return bags.read(path)
    if not path.exists():
        raise BadInput(f"{path}: No such file or directory")
    return _format_of(path, "not a file of waypoints or of a trajectory").read(path)


def write(trajectory: Trajectory, path: Path) -> None:
    """Write the samples of a trajectory to a file, in the format that its name ends with.

    Raises:
        BadInput: no format has that ending.
    """
    _format_of(path, "no format has this ending").write(trajectory, path)


def _format_of(path: Path, otherwise: str) -> Format:
    """The format with the longest matching ending of the path's name; BadInput that says `otherwise` if none does."""
    endings = {suffix: f for f in FORMATS.values() for suffix in (f.suffix, *f.others)}
    fitting = [suffix for suffix in endings if path.name.lower().endswith(suffix)]
    if not fitting:
        raise BadInput(f"{path}: {otherwise}; known are {', '.join(endings)}")
    return endings[max(fitting, key=len)]


def read_trajectory(path: str | Path, joints: Sequence[str], prefix: str = "") -> Trajectory:
    """The trajectory in a file, for the robot's `joints`; in the file their names begin with `prefix`.

    Raises:
        BadInput: the file is not readable, holds waypoints only, or lacks a joint.
    """
    return read(path).of(joints, prefix).trajectory()


def read_path(path: str | Path, joints: Sequence[str]) -> JointPath:
    """The path in a file: of a trajectory, which it keeps, or through waypoints.

    Raises:
        BadInput: the file is not readable, or lacks a joint.
    """
    return path_of(read(path).of(joints))[0]


__all__ = ["FORMATS", "Format", "JointPath", "Samples", "Trajectory", "read", "read_path", "read_trajectory", "write"]
