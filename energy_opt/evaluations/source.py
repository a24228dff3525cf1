"""Motions to be evaluated: trajectories, programs, recordings; results of `optimize` and `job` with their payloads."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt import formats
from energy_opt.errors import BadInput
from energy_opt.files import found_beside, read_json
from energy_opt.folders import wrote
from energy_opt.formats.controller_program import Load
from energy_opt.formats.recording import motion_of
from energy_opt.formats.waypoints import Samples
from energy_opt.measured.log import NAME as LOG
from energy_opt.measured.sets import read_set
from energy_opt.motion.standstills import standstills
from energy_opt.motion.trajectory import Trajectory
from energy_opt.robot import Robot

ANSWERS = {"result.json": "trajectory.csv", "job.json": "cycle.csv"}
CONDITIONS = ("max_power", "tool_speed", "tool_acceleration", "keep", "tube", "conditions")  # of a result's request
CYCLE = "cycle_{}.csv"  # the motion of one robot in the folder of a job of several
STEP = re.compile(r"step_(\d+)\.csv")  # a step's own file in the folder of a job


@dataclass(frozen=True)
class Stretch:
    """From `start` to `end` [s]: the load (None: as in the request), whether brakes hold, and whether the arm rests.

    `scene`: the file of its own scene; None: the request's.
    """

    start: float
    end: float
    load: Load | None = None
    brakes: bool = False
    resting: bool = False
    scene: Path | None = None


@dataclass(frozen=True)
class Recorded:
    """A motion read from a file.

    Attributes:
        name: of its file.
        trajectory: its samples, from time 0 on.
        stretches: loads over time; they follow one another from its start to its end.
        waits: (W, 2) s, where the arm is at rest for a while.
        notes: remarks for the reader, a line each.
        timed: the unit of its times is sure.
        warnings: that it is not the motion which its result describes; those of its cell.
        base: pose of the robot's base that the motion was planned for, as `--base` takes it; None if none is stated.
        unseen: which scenes of its result could not be taken; empty if none.
        steps: [Hz] of a controller that takes the positions one by one; None: it moves on between them.
    """

    name: str
    trajectory: Trajectory
    stretches: tuple[Stretch, ...]
    waits: np.ndarray
    notes: tuple[str, ...] = ()
    base: tuple[float, ...] | None = None
    timed: bool = True
    warnings: tuple[str, ...] = ()
    steps: float | None = None
    unseen: str = ""


def robot_named(path: Path) -> str | None:
    """The robot in a result's request, where the file is one, or lies beside it: its name, or its file if found."""
    answer = _result_json(path)
    name = None if answer is None else _stating(answer, path).get("robot")
    return (found_beside(name, answer) or name) if answer is not None and isinstance(name, str) else None


def stated(path: Path) -> tuple[dict[str, Any], list[str]]:
    """What the request of the result that a file belongs to states of robot and cell, and what of it is not taken.

    Returns:
        Values of `limits`, `lock`, `base`, `tool`, `floor` and `scene`, without those that it leaves at their defaults;
        and notes.
    """
    answer = _result_json(path)
    request = {} if answer is None else _stating(answer, path)
    found = {name: request[name] for name in ("lock", "base", "tool", "floor") if request.get(name) is not None}
    notes = []
    if answer is not None and (limits := request.get("limits")) is not None:
        file = found_beside(str(limits), answer)
        found |= {} if file is None else {"limits": file}
        notes += [f"{answer}: its limits {limits} were not found and are not taken"] if file is None else []
    if conditions := [name for name in CONDITIONS if request.get(name)]:
        flags = ", ".join(f"--{name.replace('_', '-')}" for name in conditions)
        notes.append(f"{answer}: its conditions are not judged: {flags}")
    if answer is None:
        return found, notes
    scenes, missing = _scenes(answer, path)
    if len(set(scenes)) > 1:
        missing = "each step is judged in its own scene"
    elif scenes:
        found["scene"] = str(scenes[0])
    return found, [*notes, f"{answer}: {missing}"] if missing else notes


def _scenes(answer: Path, path: Path) -> tuple[list[Path | None], str]:
    """The scene files of a result's motions, one for each step of a job, and what of its scenes is not taken.

    Args:
        answer: the JSON result. path: a file of its folder.
    """
    request, document = _stating(answer, path), read_json(answer)
    job = _job(request)
    names = [job.get("scene") or request.get("scene")]
    for step in (each for each in job.get("step") or () if isinstance(each, Mapping)):
        names.append(step.get("scene") or names[-1])  # it holds from this step on
    names = names[1:] or names
    if not any(names):
        return [], ""
    if "fixture" in request:
        return [], f"its scene is not taken, because {request['fixture']} was moved in it"
    robots = _robots(answer)
    if robots and path.name not in map(CYCLE.format, robots):
        return [], f"its scene is not taken, because {path.name} does not say which robot moves"
    if len(set(names)) > 1 and len(names) != len(document.get("steps") or ()):
        return [], "the scenes of its steps are not taken"
    folder = str(request.get("folder") or ".")
    found = {
        name: found_beside(str(name), Path(folder) / "job.toml") or found_beside(str(name), answer)
        for name in names if name
    }  # fmt: skip
    if lost := [str(name) for name, file in found.items() if file is None]:
        return [], f"its scene {', '.join(lost)} was not found and is not taken"
    return [Path(str(found[name])) if name else None for name in names], ""


def _stating(answer: Path, path: Path) -> Mapping[str, Any]:
    """The request of a result, with robot, base and tool of the one whose motion a file is, in a job of several."""
    request = _request(read_json(answer))
    robots = [each for each in _job(request).get("robot") or () if isinstance(each, Mapping)]
    own = next((each for each in robots if path.name == CYCLE.format(each.get("name"))), {})
    return {**request, **{name: own[name] for name in ("robot", "base", "tool") if own.get(name) is not None}}


def _job(request: Mapping[str, Any]) -> Mapping[str, Any]:
    """The job in a request; empty if it has none. One of a single robot names it, others have a list."""
    job = request.get("job")
    job = job if isinstance(job, Mapping) else {}
    return job if isinstance(job.get("robot"), list) else {**job, "robot": []}


def _request(document: Any) -> Mapping[str, Any]:
    """The request of a result; empty if it states none."""
    request = document.get("request") if isinstance(document, dict) else None
    return request if isinstance(request, Mapping) else {}


def joints_in(path: Path) -> Sequence[str]:
    """Names of the joints of a file."""
    return formats.read(_table(path)).joints


def is_set(path: Path) -> bool:
    """Is a path that of a measured set: its folder, or its log.toml?"""
    return path.name == LOG or (path / LOG).is_file()


def load_set(path: Path, robot: Robot) -> list[Recorded]:
    """The motions of a measured set: its runs but static ones, with the payload that its recorder states.

    Raises:
        BadInput: a fault of the set, or it has no motion.
    """
    measured, out = read_set(path, robot, meter=False), []
    load = None if measured.payload is None else _payload(measured.payload.mass, measured.payload.com.tolist())
    for run in measured.runs:
        if run.kind == "motion":
            name = str(measured.path / run.file)
            held = Samples(name, robot.joints, run.position, run.time, run.velocity, run.acceleration)
            out.append(_recorded(name, held, load=load))
    if not out:
        raise BadInput(f"{path}: no run is a motion")
    out[0] = replace(out[0], notes=(*measured.remarks, *out[0].notes))
    return out


def _recorded(name: str, samples: Samples, load: Load | None = None) -> Recorded:
    """The motion of samples, from time 0 on, with one load."""
    trajectory, notes = motion_of(samples)
    trajectory = replace(trajectory, time=trajectory.time - trajectory.time[0]).on_nanoseconds()
    whole = (Stretch(0.0, trajectory.duration, load),)
    said = (*samples.notes, *notes)
    return Recorded(name, trajectory, whole, standstills(trajectory), said, timed=samples.timed, steps=samples.steps)


def load(path: Path, joints: Sequence[str], prefix: str = "", following: Iterable[str] = ()) -> Recorded:
    """The motion in a file, for the robot's `joints`; in the file their names begin with `prefix`.

    The folder, the JSON result or a motion's file of a solved move or job also state the loads over time, and where
    brakes hold.

    Args:
        following: joints that follow those of the robot, so that their motion counts.

    Raises:
        BadInput: no motion can be read; names the place.
    """
    path = Path(path)
    table, answer = _table(path), _result_json(path)
    prefix = "" if table.name in ANSWERS.values() and answer is not None else prefix
    records = formats.read(table).of(joints, prefix, following)
    motion, notes = _recorded(str(path), records), list[str]()
    if records.velocity is not None and not records.velocity.any() and np.ptp(records.position, axis=0).any():
        notes.append(f"{records.where}: velocity is 0 in every row: the arm is assumed to stop at each")
    if answer is None:
        beside = [name for name in ANSWERS if (path.parent / name).is_file()]
        notes += [f"{path}: not written by the {name} beside it, whose payload is not taken" for name in beside]
        return replace(motion, notes=(*motion.notes, *notes))
    if _robots(answer):
        note = f"{path}: of a job of several robots, whose payloads and modes of waits are not taken"
        notes.append(f"{note}; contact between the robots is not judged")
    document, step = read_json(answer), STEP.fullmatch(table.name)
    scenes, unseen = _scenes(answer, table)
    in_own = scenes if len(set(scenes)) > 1 else []  # else the request has the scene
    stretches = _stretches(document, motion.trajectory, int(step[1]) if step else None, in_own) or motion.stretches
    base = _stating(answer, table).get("base")
    on = tuple(base) if isinstance(base, list) else None
    changed = f"{table}: not the file that was written with {answer.name} (by its SHA-256), which states its payloads"
    warnings = () if wrote(answer, table) else (changed,)
    return replace(
        motion, stretches=stretches, notes=(*motion.notes, *notes), base=on, warnings=warnings, unseen=unseen
    )


def _table(path: Path) -> Path:
    """The file with the motion itself."""
    answer = next((path / name for name in ANSWERS if (path / name).is_file()), None) if path.is_dir() else path
    if answer is None:
        if not (path / "metadata.yaml").is_file():
            raise BadInput(f"{path}: a folder without {' or '.join(ANSWERS)}; expected a motion's file")
        return path
    if answer.name not in ANSWERS:
        return path
    robots = _robots(answer)
    if robots:
        files = ", ".join(str(answer.parent / CYCLE.format(name)) for name in robots)
        raise BadInput(f"{path}: a job of several robots; expected the motion of one of them, such as {files}")
    return answer.parent / ANSWERS[answer.name]


def _robots(answer: Path) -> list[str]:
    """Names of the robots of a job of several; empty for other results."""
    document = read_json(answer)
    robots = document.get("robots") if isinstance(document, dict) else None
    return [str(robot.get("name")) for robot in robots or () if isinstance(robot, dict)]


def _result_json(path: Path) -> Path | None:
    """The JSON result that a file belongs to: it is this file, or has written it."""
    folder = path if path.is_dir() else path.parent
    for answer in ANSWERS:
        if (folder / answer).is_file() and (path.is_dir() or path.name == answer or wrote(folder / answer, path)):
            return folder / answer
    return None


def _stretches(
    document: Any, trajectory: Trajectory, number: int | None, scenes: Sequence[Path | None]
) -> tuple[Stretch, ...]:
    """Loads over time as a result states them; empty if it states none.

    Args:
        number: of the step of a job whose motion this is, from 1 on; None for the whole motion.
        scenes: of the steps of a job.
    """
    request = document.get("request") if isinstance(document, dict) else None
    if not isinstance(request, dict):
        return ()
    end = trajectory.duration
    if "steps" in document:
        own = slice(None) if number is None else slice(number - 1, number)
        steps, in_scenes = document["steps"][own], scenes[own] or [None] * len(document["steps"][own])
        starts = [float(step["start"] if number is None else 0.0) for step in steps]
        ends = [*starts[1:], end]
        loads = [_payload(s["payload"], s.get("centre") or (0.0, 0.0, 0.0)) for s in steps]
        records = zip(starts, ends, loads, steps, in_scenes, strict=True)
        return tuple(Stretch(a, b, load, bool(step.get("brakes")), scene=s) for a, b, load, step, s in records)
    payload = request.get("payload")
    if not isinstance(payload, dict):
        return ()
    return (Stretch(0.0, end, _payload(payload["mass"][0], payload["com"])),)


def _payload(mass: float, centre: Sequence[float]) -> Load:
    x, y, z = map(float, centre)
    return float(mass), x, y, z
