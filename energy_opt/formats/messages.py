"""ROS messages that hold a planned trajectory, as documents of YAML or JSON.

Known are trajectory_msgs/JointTrajectory and what wraps it, wherever it is in the document: moveit_msgs
RobotTrajectory and DisplayTrajectory, goals of control_msgs/FollowJointTrajectory and moveit_msgs/ExecuteTrajectory,
results and responses of planning. Times are those of ROS 2 ({sec, nanosec}), ROS 1 ({secs, nsecs}) or plain seconds.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput, read_each, refuse
from energy_opt.files import read_json, read_yaml_documents, write_json, write_text
from energy_opt.formats.waypoints import Samples, repeated
from energy_opt.motion.trajectory import Trajectory

FIELDS = {
    "position": "positions", "velocity": "velocities", "acceleration": "accelerations", "effort": "effort",
}  # fmt: skip
SAME = 1e-9  # [rad or m] parts of a plan whose ends differ by less are one motion
CUT = "..."  # text of `ros2 topic echo` in place of the rest of a long array


def read_yaml(path: Path) -> Samples:
    """The planned trajectory of a YAML file, as `ros2 topic echo` prints it or as a library dumps it."""
    return planned([found for document in read_yaml_documents(path) for found in trajectories(document)], str(path))


def read_json_file(path: Path) -> Samples:
    """The planned trajectory of a JSON file with the messages' fields."""
    return planned(list(trajectories(read_json(path))), str(path))


def trajectories(document: Any) -> Iterator[list[Mapping[str, Any]]]:
    """The plans of a document: each the list of JointTrajectory messages that follow one another in it."""
    if isinstance(document, Mapping):
        if "joint_names" in document and "points" in document:
            yield [document]
        elif isinstance(document.get("trajectory"), Sequence) and "model_id" in document:  # a DisplayTrajectory
            yield [part for item in document["trajectory"] for plan in trajectories(item) for part in plan]
        else:
            for value in document.values():
                yield from trajectories(value)
    elif isinstance(document, list):
        for value in document:
            yield from trajectories(value)


def planned(plans: Sequence[Sequence[Mapping[str, Any]]], where: str) -> Samples:
    """The last plan that is not empty, as samples.

    Raises:
        BadInput: there is none, or a field of it is missing, not a number, or does not fit the others.
    """
    filled = [[part for part in plan if part["points"] or part["joint_names"]] for plan in plans]
    filled = [plan for plan in filled if plan]
    if not filled:
        raise BadInput(
            f"{where}: no planned trajectory; expected a message with joint_names and points (JointTrajectory, "
            "RobotTrajectory, DisplayTrajectory or a goal that holds one; of standard moves, the trajectory.csv beside "
            "them)"
        )
    out = joined([_samples(part, where) for part in filled[-1]])
    if len(filled) > 1:
        out = replace(out, notes=(*out.notes, f"{where}: {len(filled)} planned trajectories; the last is taken"))
    return out


def joined(parts: Sequence[Samples]) -> Samples:
    """Join consecutive parts of one plan; times continue.

    Raises:
        BadInput: a part does not begin where the one before ends, or has other joints.
    """
    out = parts[0]
    for part in parts[1:]:
        part = part.of(out.joints)
        if np.abs(part.position[0] - out.position[-1]).max() > SAME:
            raise BadInput(f"{out.where}: a part of the plan does not begin where the one before it ends")
        blocks: dict[str, Any] = {}
        for kind in FIELDS:
            one, other = getattr(out, kind), getattr(part, kind)
            blocks[kind] = None if one is None or other is None else np.vstack([one, other[1:]])
        time = None
        if out.time is not None and part.time is not None:
            time = np.concatenate([out.time, out.time[-1] + (part.time - part.time[0])[1:]])
        out = replace(out, time=time, **blocks)
    return out


def _samples(message: Mapping[str, Any], where: str) -> Samples:
    """One JointTrajectory message as samples; times that are all the same mean waypoints."""
    names, points = message["joint_names"], message["points"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names) or not names:
        raise BadInput(f"{where}: joint_names is not a list of names")
    if len(set(names)) < len(names):
        raise BadInput(f"{where}: joint_names: {next(n for n in names if names.count(n) > 1)} is given twice")
    if not isinstance(points, list) or not points or not all(isinstance(point, Mapping) for point in points):
        raise BadInput(f"{where}: points is not a list of points")
    stamps = [point.get("time_from_start", 0) for point in points]
    timed = [(stamp, f"{where}: points[{k}].time_from_start") for k, stamp in enumerate(stamps)]
    columns: dict[str, tuple[Any, ...]] = {"time": (seconds, timed)}
    for kind, field in FIELDS.items():
        given = [k for k, point in enumerate(points) if point.get(field)]
        if not given or (kind in ("acceleration", "effort") and len(given) < len(points)):
            if kind == "position":
                raise BadInput(f"{where}: points[0].positions is missing")
            continue
        missing = sorted({*range(len(points))} - {*given})
        refuse(f"{where}: points[{k}].{field} is missing, though points[{given[0]}] has them" for k in missing)
        given_as = [(point[field], len(names), f"{where}: points[{k}].{field}") for k, point in enumerate(points)]
        columns[kind] = (_vector, given_as)
    read: list[list[Any]] = read_each(read_each, columns.values())
    blocks: dict[str, Any] = {kind: np.array(values) for kind, values in zip(columns, read, strict=True)}
    time = blocks.pop("time")
    if (time == time[0]).all():
        return Samples(where, tuple(names), position=blocks["position"], planned=True)
    keep = ~repeated(time, blocks["position"])
    late = np.flatnonzero((np.diff(time) <= 0) & keep[1:])
    refuse(
        f"{where}: points[{k + 1}].time_from_start: {time[k + 1]:g} s does not come after {time[k]:g} s" for k in late
    )
    blocks = {kind: block[keep] for kind, block in blocks.items()}
    return Samples(where, tuple(names), time=time[keep], planned=True, **blocks)


def _vector(values: Any, count: int, where: str) -> list[float]:
    """One number for each joint from a field of a message."""
    if not isinstance(values, Sequence) or isinstance(values, str):
        raise BadInput(f"{where}: not a list of numbers")
    if CUT in values:
        raise BadInput(f"{where}: cut short with '...'; `ros2 topic echo --full-length` shows all")
    if len(values) != count:
        raise BadInput(f"{where}: {len(values)} numbers; the message names {count} joints")
    return [number(value, where) for value in values]


def number(value: Any, where: str) -> float:
    """A field as a finite number.

    Raises:
        BadInput: it is not a finite number.
    """
    try:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ValueError
        out = float(value)
    except (ValueError, OverflowError):
        shown = repr(value)
        raise BadInput(f"{where}: {shown[:40] + ('...' if len(shown) > 40 else '')} is not a number") from None
    if not np.isfinite(out):
        raise BadInput(f"{where}: {value!r} is not finite")
    return out


def seconds(stamp: Any, where: str) -> float:
    """A duration in s from {sec, nanosec}, {secs, nsecs} or a plain number of seconds.

    Whole seconds and nanoseconds are added in decimal, so that a time with nine digits is met to the last bit.

    Raises:
        BadInput: none of these; the line begins with `where`.
    """
    if not isinstance(stamp, Mapping):
        return number(stamp, where)
    for whole, part in (("sec", "nanosec"), ("secs", "nsecs")):
        if whole in stamp or part in stamp:
            nanoseconds = number(stamp.get(whole, 0), where) * 10**9 + number(stamp.get(part, 0), where)
            return nanoseconds / 10**9
    raise BadInput(f"{where}: expected {{sec, nanosec}}; found {', '.join(map(str, stamp)) or 'nothing'}")


def message(trajectory: Trajectory) -> dict[str, Any]:
    """A trajectory as trajectory_msgs/JointTrajectory, times from the first sample, effort if known."""
    stamps = [divmod(round(t * 1e9), 10**9) for t in (trajectory.time - trajectory.time[0]).tolist()]
    blocks = {field: getattr(trajectory, kind) for kind, field in FIELDS.items()}
    points = [
        {field: [] if block is None else block[k].tolist() for field, block in blocks.items()}
        | {"time_from_start": {"sec": whole, "nanosec": part}}
        for k, (whole, part) in enumerate(stamps)
    ]
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {"header": header, "joint_names": list(trajectory.joints), "points": points}


def write_yaml(trajectory: Trajectory, path: Path) -> None:
    """Write trajectory_msgs/JointTrajectory as YAML; every digit, times to the nanosecond."""
    write_text(path, "\n".join(_yaml(message(trajectory))) + "\n")


def write_json_file(trajectory: Trajectory, path: Path) -> None:
    """Write trajectory_msgs/JointTrajectory as JSON."""
    write_json(path, message(trajectory))


def write_goal(trajectory: Trajectory, path: Path) -> None:
    """Write a control_msgs/FollowJointTrajectory goal as YAML, ready for `ros2 action send_goal`.

    The controller's own tolerances hold.
    """
    fields = ("path_tolerance", "component_path_tolerance", "goal_tolerance", "component_goal_tolerance")
    goal = {"trajectory": message(trajectory), **{field: [] for field in fields}}
    write_text(path, "\n".join(_yaml({**goal, "goal_time_tolerance": {"sec": 0, "nanosec": 0}})) + "\n")


def _yaml(value: Mapping[str, Any], indent: str = "") -> Iterator[str]:
    """Lines of YAML with numbers' every digit and a line for each vector; much faster than a general writer."""
    for key, item in value.items():
        if isinstance(item, Mapping) and any(isinstance(x, (Mapping, list)) for x in item.values()):
            yield f"{indent}{key}:"
            yield from _yaml(item, indent + "  ")
        elif isinstance(item, list) and item and isinstance(item[0], Mapping):
            yield f"{indent}{key}:"
            for entry in item:
                lines = _yaml(entry, indent + "  ")
                yield f"{indent}- {next(lines).lstrip()}"
                yield from lines
        elif isinstance(item, Mapping):
            yield f"{indent}{key}: {{{', '.join(f'{k}: {_word(v)}' for k, v in item.items())}}}"
        elif isinstance(item, list):
            yield f"{indent}{key}: [{', '.join(map(_word, item))}]"
        else:
            yield f"{indent}{key}: {_word(item)}"


def _word(value: Any) -> str:
    """A scalar of YAML; a float with an exponent gets a point, without which YAML 1.1 reads it as text."""
    if isinstance(value, str):
        return json.dumps(value)  # JSON text is YAML, too, and stays on one line
    text = repr(value)
    if isinstance(value, float) and "e" in text and "." not in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa}.0e{exponent}"
    return text
