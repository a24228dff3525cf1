"""JOB.toml: an ordered list of moves and waits, repeated in a fixed cycle; every fault is named with its step.

format = "energy-opt/job/1"
robot = "panda"
cycle_time = 8.0            # s
home = "rest"               # optional: a pose or positions; else the cycle begins at the last `to`
mode = "reshape"            # optional: of every step that does not say its own
brakes = false              # optional: may brakes hold the arm while time is left over?

[poses]
rest = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
part = { pose = [0.5, 0.2, 0.1, 3.14159, 0, 0], free = ["rz"] }     # of the tool: m, rad, in the base frame

[[step]]
to = "rest"                 # or positions, in the robot's order or by joint name
[[step]]
to = "part"                 # or pose = [...] or "box_1: 0,0,0.1,3.14159,0,0", free = [...], pose_tolerance = "1mm,1deg"
[[step]]
wait = 0.5                  # s; brakes = true: without holding losses
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import read_toml
from energy_opt.jobs.reader import OF_POSE, SAME, Load, Reader, Target, of_scene
from energy_opt.poses.pose import Pose
from energy_opt.robot import Robot, robot_named

FORMAT = "energy-opt/job/1"
TOP = ("format", "robot", "cycle_time", "home", "mode", "brakes", "payload", "scene", "poses", "step")
MOVING = ("name", "to", *OF_POSE, "mode", "min_duration", "max_duration", "payload", "scene", "stop")
WAITING = ("name", "wait", "brakes", "payload", "scene")
MOST_STEPS = 1000
BRIEFEST = 1e-6  # [s] of a cycle and a wait: less is none


@dataclass(frozen=True)
class Step:
    """One step as it is done.

    Attributes:
        name: for messages and results.
        start, goal: (n,) [rad]; the same where it waits.
        wait: seconds, None for a move; brakes: it waits without holding losses.
        mode: "retime" or "reshape"; least, most: of the duration, s.
        payload: (4,) mass [kg] and its centre [m] in the last joint's frame.
        scene: file of what is around the arm, if the job names one.
        stop: does the arm stand still at its end?
        pose: where the tool must be at its end, while `goal` is still to be chosen (nan then, see `Job.at`).
    """

    name: str
    start: np.ndarray
    goal: np.ndarray
    wait: float | None = None
    brakes: bool = False
    mode: Literal["retime", "reshape"] = "reshape"
    least: float = 0.0
    most: float = np.inf
    payload: Load = (0.0, 0.0, 0.0, 0.0)
    scene: Path | None = None
    stop: bool = True
    pose: Pose | None = None


@dataclass(frozen=True)
class Job:
    """A cycle of steps; the last ends where the first begins.

    Attributes:
        cycle_time: s; brakes: may brakes hold the arm while time is left over?
        remarks: what in the file may be meant otherwise than it is read.
    """

    name: str
    robot: Robot
    cycle_time: float
    steps: tuple[Step, ...]
    brakes: bool = False
    remarks: tuple[str, ...] = ()

    @property
    def waiting(self) -> float:
        """Seconds that the job itself asks to wait."""
        return sum(step.wait for step in self.steps if step.wait is not None)

    @property
    def open(self) -> tuple[int, ...]:
        """The steps whose joint positions are still to be chosen."""
        return tuple(k for k, step in enumerate(self.steps) if np.isnan(step.goal).any() and step.wait is None)

    def at(self, ends: Mapping[int, np.ndarray]) -> Job:
        """The job whose steps k end at positions `ends[k]` (n,) [rad]."""
        goals = {k: ends.get(k, step.goal) for k, step in enumerate(self.steps) if step.wait is None}
        at = goals[max(goals)] if goals else self.steps[0].start
        steps = []
        for k, step in enumerate(self.steps):
            begin, at = at, goals.get(k, at)
            steps.append(replace(step, start=begin, goal=at))
        return replace(self, steps=tuple(steps))


def load_job(path: Path, load: Callable[[str], Robot], **more: Any) -> Job:
    """Read the job file `path`; further arguments and errors are those of `job_of`."""
    return job_of(read_toml(Path(path)), Path(path), load, **more)


def job_of(
    document: Mapping[str, Any],
    path: Path,
    load: Callable[[str], Robot],
    *,
    allow_outside: bool = False,
    payload: Load | None = None,
    named: Mapping[str, Pose] | None = None,
) -> Job:
    """A job from a document that was read.

    Args:
        path: of the file that other files are beside, for messages too.
        load: makes the robot out of its name, or of the path of its URDF.
        allow_outside: URDF and scenes may lie outside the job's folder.
        payload: held until a step says another, in place of what the job says.
        named: poses by name beside those of the job, as a scene file has them.

    Raises:
        BadInput: names every fault, one a line, with the step's name.
    """
    job, faults = _read(document, path, load, allow_outside, payload, named)
    if faults or job is None:
        raise BadInput("\n".join(f"{path}: {fault}" for fault in faults))
    return job


def check_job(path: Path, load: Callable[[str], Robot], *, allow_outside: bool = False) -> list[str]:
    """Every fault of a job file, one line each; empty where it is usable. Arguments are those of `load_job`."""
    try:
        return [f"{path}: {fault}" for fault in _read(read_toml(Path(path)), Path(path), load, allow_outside)[1]]
    except BadInput as error:
        return str(error).splitlines()


def _read(
    document: Mapping[str, Any],
    path: Path,
    load: Callable[[str], Robot],
    allow_outside: bool,
    payload: Load | None = None,
    named: Mapping[str, Pose] | None = None,
) -> tuple[Job | None, list[str]]:
    if document.get("format") != FORMAT:
        return None, [f"format = {document.get('format')!r}; expected {FORMAT!r}"]
    name = document.get("robot")
    if not isinstance(name, str):
        return None, [f"robot = {name!r}; expected a name or a URDF file in quotes"]
    try:
        name = robot_named(name, path.parent, allow_outside)
    except BadInput as error:
        return None, [f"robot: {error}"]
    reader = Reader(document, path, load(name), allow_outside)
    reader.known(document, TOP, "job")
    poses = document.get("poses", {})
    if not isinstance(poses, Mapping):
        reader.faults.append("poses: expected a table of names and positions")
        poses = {}
    reader.poses |= of_scene(reader, document) | dict(named or {})
    remarks: list[str] = []
    for key, value in poses.items():
        q = reader.pose(value, f"poses: {key}")
        if q is not None:
            reader.poses[key] = q
            remarks += reader.remarks(key, value)
    cycle = reader.number(document, "cycle_time", "job", 1.0, BRIEFEST)
    if "cycle_time" not in document:
        reader.faults.append("job: no cycle_time; expected seconds")
    records = document.get("step", [])
    if not isinstance(records, list) or not records or not all(isinstance(row, Mapping) for row in records):
        return None, [*reader.faults, "step: expected [[step]] tables, at least one"]
    if len(records) > MOST_STEPS:
        return None, [*reader.faults, f"step: {len(records)} steps; expected at most {MOST_STEPS}"]
    steps = _steps(reader, records, payload)
    brakes = reader.truth(document, "brakes", "job", False)
    if reader.faults:
        return None, reader.faults
    return Job(path.stem, reader.robot, cycle, tuple(steps), brakes, tuple(remarks)), []


def _steps(reader: Reader, rows: list[Mapping[str, Any]], held: Load | None) -> list[Step]:
    top = reader.document
    at = reader.pose(top["home"], "home") if "home" in top else None
    if at is not None:
        reader.poses.setdefault("home", at)  # `to = "home"` goes there, also where home is given as positions
    targets = [reader.target(row, _where(k, row)) if _moves(row) else None for k, row in enumerate(rows)]
    last = next((q for row, q in zip(reversed(rows), reversed(targets), strict=True) if _moves(row)), None)
    begin = at if "home" in top else last
    if begin is None and not reader.faults:
        reader.faults.append("step: no step moves; give `to` or `pose`, or `home` to wait at")
    if reader.faults or begin is None:
        _known(reader, rows)
        return []
    if last is None and isinstance(begin, Pose):
        reader.faults.append("home: no step moves; a job that only waits has joint positions as its home")
        return []
    at = _nowhere(reader.robot) if isinstance(begin, Pose) else begin
    out: list[Step] = []
    said = reader.payload(top.get("payload", 0.0), "job")
    payload = said if held is None else held
    scene = reader.scene(top["scene"], "job") if "scene" in top else None
    for k, (row, target) in enumerate(zip(rows, targets, strict=True)):
        where = _where(k, row)
        if "payload" in row:
            payload = reader.payload(row["payload"], where)
        if "scene" in row:
            scene = reader.scene(row["scene"], where)
        step = _step(reader, row, where, at, target, payload, scene)
        if out and not out[-1].stop:
            before = out[-1]
            if step.wait is not None or step.payload != before.payload or step.scene != before.scene:
                reader.faults.append(
                    f"{where}: the step before has stop = false; this one can neither wait nor change payload or scene"
                )
        out.append(step)
        at = step.goal
    _known(reader, rows)
    end, returns = begin if last is None else last, "the last step does not return to where the cycle begins"
    if isinstance(end, Pose) or isinstance(begin, Pose):
        if end is not begin and not (isinstance(end, Pose) and end.same_as(begin)):
            reader.faults.append(f"{_where(len(rows) - 1, rows[-1])}: {returns}: home is another pose")
    elif np.abs(end - begin).max() > SAME:
        j = int(np.argmax(np.abs(end - begin)))
        reader.faults.append(
            f"{_where(len(rows) - 1, rows[-1])}: {returns}: "
            f"{reader.robot.joints[j]} ends at {end[j]:.4g}, the cycle begins at {begin[j]:.4g}"
        )
    if not out[-1].stop:
        reader.faults.append(f"{_where(len(rows) - 1, rows[-1])}: stop = false; the last step must end at rest")
    return out


def _moves(row: Mapping[str, Any]) -> bool:
    return "to" in row or "pose" in row


def _nowhere(robot: Robot) -> np.ndarray:
    """Positions that are still to be chosen."""
    return np.full(robot.n, np.nan)


def _known(reader: Reader, rows: list[Mapping[str, Any]]) -> None:
    for k, row in enumerate(rows):
        where = _where(k, row)
        if _moves(row) == ("wait" in row):
            reader.faults.append(f"{where}: expected either `to` or `wait`, or `pose`")
        reader.known(row, WAITING if "wait" in row else MOVING, where)


def _where(k: int, row: Mapping[str, Any]) -> str:
    name = row.get("name")
    return f"step {k + 1} ({name})" if isinstance(name, str) else f"step {k + 1}"


def _step(
    reader: Reader,
    row: Mapping[str, Any],
    where: str,
    at: np.ndarray,
    target: Target | None,
    payload: Load,
    scene: Path | None,
) -> Step:
    name = row.get("name", where)
    if not isinstance(name, str) or not name.isprintable():
        reader.faults.append(f"{where}: name = {name!r}; expected words")
        name = where
    if "wait" in row:
        wait = reader.number(row, "wait", where, 1.0, BRIEFEST)
        brakes = reader.truth(row, "brakes", where, False)
        return Step(name, at, at, wait, brakes, payload=payload, scene=scene)
    mode = row.get("mode", reader.document.get("mode", "reshape"))
    if mode not in ("retime", "reshape"):
        reader.faults.append(f"{where}: mode = {mode!r}; expected retime or reshape")
        mode = "reshape"
    least = reader.number(row, "min_duration", where, 0.0)
    most = reader.number(row, "max_duration", where, np.inf)
    if least > most:
        reader.faults.append(f"{where}: min_duration = {least:g} is above max_duration = {most:g}")
    stop = reader.truth(row, "stop", where, True)
    if isinstance(target, Pose):
        pose = replace(target, name=f"{name}: {target.name}" if target.name not in name else name)
        return Step(name, at, _nowhere(reader.robot), None, False, mode, least, most, payload, scene, stop, pose)
    goal = at if target is None else target
    return Step(name, at, goal, None, False, mode, least, most, payload, scene, stop)
