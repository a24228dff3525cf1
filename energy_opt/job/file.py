"""JOB.toml: an ordered list of moves and waits, repeated in a fixed cycle; every fault is named with its step.

format = "energy-opt/job/1"
robot = "panda"
cycle_time = 8.0            # s
home = "rest"               # optional: a pose or positions; else the cycle begins at the last `to`
mode = "reshape"            # optional: of every step that does not say its own
brakes = false              # optional: may brakes hold the arm while time is left over?

[poses]
rest = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]

[[step]]
to = "rest"                 # or positions, in the robot's order or by joint name
[[step]]
wait = 0.5                  # s; brakes = true: without holding losses
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from energy_opt.bench.faults import is_number
from energy_opt.bench.moves import joint_values
from energy_opt.errors import BadInput, near
from energy_opt.files import inside, read_toml
from energy_opt.robot import Robot, robot_named

FORMAT = "energy-opt/job/1"
TOP = ("format", "robot", "cycle_time", "home", "mode", "brakes", "payload", "scene", "poses", "step")
MOVING = ("name", "to", "mode", "min_duration", "max_duration", "payload", "scene", "stop")
WAITING = ("name", "wait", "brakes", "payload", "scene")
SAME = 1e-9  # [rad] two poses nearer than this are one
MOST_STEPS = 1000
Load = tuple[float, float, float, float]  # mass [kg] and its centre [m] in the last joint's frame
BRIEFEST, LONGEST = 1e-6, 1e7  # [s] of a cycle and a wait: less is none, more is a slip of units


@dataclass(frozen=True)
class Step:
    """One step as it is done.

    Attributes:
        name: for messages and results.
        start, goal: (n,) [rad]; the same where it waits.
        wait: seconds, None for a move; brakes: it waits without holding losses.
        mode: "retime" or "reshape"; least, most: of the duration, s.
        payload: (4,) mass [kg] and its centre [m] in the last joint's frame.
        scene: file of what stands around the arm, if the job names one.
        stop: does the arm stand still at its end?
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


@dataclass(frozen=True)
class Job:
    """A cycle of steps; the last ends where the first begins.

    Attributes:
        cycle_time: s; brakes: may brakes hold the arm while time is left over?
    """

    name: str
    robot: Robot
    cycle_time: float
    steps: tuple[Step, ...]
    brakes: bool = False

    @property
    def waiting(self) -> float:
        """Seconds that the job itself asks to wait."""
        return sum(step.wait for step in self.steps if step.wait is not None)


def load_job(
    path: Path, load: Callable[[str], Robot], *, allow_outside: bool = False, payload: Load | None = None
) -> Job:
    """Read a job.

    Args:
        load: makes the robot out of its name, or of the path of its URDF.
        allow_outside: URDF and scenes may lie outside the job's folder.
        payload: held until a step says another, in place of what the job says.

    Raises:
        BadInput: names every fault, one a line, with the step's name.
    """
    return job_of(read_toml(Path(path)), Path(path), load, allow_outside=allow_outside, payload=payload)


def job_of(
    document: Mapping[str, Any],
    path: Path,
    load: Callable[[str], Robot],
    *,
    allow_outside: bool = False,
    payload: Load | None = None,
) -> Job:
    """A job from a document that was read; `path` is the file that other files lie beside. Else as `load_job`."""
    job, faults = _read(document, path, load, allow_outside, payload)
    if faults or job is None:
        raise BadInput("\n".join(f"{path}: {fault}" for fault in faults))
    return job


def check_job(path: Path, load: Callable[[str], Robot], *, allow_outside: bool = False) -> list[str]:
    """Every fault of a job file, one line each; empty where it is usable. Arguments are those of `load_job`."""
    try:
        return [f"{path}: {fault}" for fault in _read(read_toml(Path(path)), Path(path), load, allow_outside)[1]]
    except BadInput as error:
        return str(error).splitlines()


class _Reader:
    """One reading of a document; faults are collected."""

    def __init__(self, document: Mapping[str, Any], path: Path, robot: Robot, allow_outside: bool) -> None:
        self.document, self.path, self.robot, self.allow_outside = document, path, robot, allow_outside
        self.faults: list[str] = []
        self.poses: dict[str, np.ndarray] = {}

    def pose(self, value: Any, where: str) -> np.ndarray | None:
        """A pose by name or as positions, within the position limits."""
        if isinstance(value, str):
            if value not in self.poses:
                self.faults.append(f"{where}: unknown pose {value!r}{near(value, self.poses)}; [poses] names them")
                return None
            return self.poses[value]
        try:
            q = np.array(joint_values(value, self.robot.joints))
        except BadInput as error:
            self.faults.append(f"{where}: {error}")
            return None
        limits = self.robot.limits
        outside = np.flatnonzero((q < limits.lower - SAME) | (q > limits.upper + SAME))
        for j in outside[:1]:
            self.faults.append(
                f"{where}: {self.robot.joints[j]} = {q[j]:.4g} is outside its position limits "
                f"[{limits.lower[j]:.4g}, {limits.upper[j]:.4g}]"
            )
        return None if outside.size else q

    def number(self, table: Mapping[str, Any], key: str, where: str, default: float, least: float = 0.0) -> float:
        """Seconds from `least` to `LONGEST`; `default` where the table says none."""
        if key not in table:
            return default
        value = table[key]
        if not is_number(value) or not least <= value <= LONGEST:
            self.faults.append(f"{where}: {key} = {value!r}; expected seconds, {least:g} to {LONGEST:g}")
            return default
        return float(value)

    def truth(self, table: Mapping[str, Any], key: str, where: str, default: bool) -> bool:
        """true or false."""
        value = table.get(key, default)
        if not isinstance(value, bool):
            self.faults.append(f"{where}: {key} = {value!r}; expected true or false")
            return default
        return value

    def known(self, table: Mapping[str, Any], names: tuple[str, ...], where: str) -> None:
        """Keys that nobody knows."""
        for key in table:
            if key not in names:
                self.faults.append(f"{where}: unknown key {key!r}{near(key, names)}; known: {', '.join(names)}")

    def payload(self, value: Any, where: str) -> Load:
        """MASS or [MASS, CX, CY, CZ]."""
        parts = value if isinstance(value, list) else [value]
        numbers = list(filter(is_number, parts))
        if len(numbers) != len(parts) or len(numbers) not in (1, 4) or numbers[0] < 0:
            self.faults.append(f"{where}: payload = {value!r}; expected a mass in kg, or [mass, cx, cy, cz] with m")
            return (0.0, 0.0, 0.0, 0.0)
        mass, *com = (float(x) for x in numbers)
        x, y, z = com or (0.0, 0.0, 0.0)
        return mass, x, y, z

    def scene(self, value: Any, where: str) -> Path | None:
        """A file beside the job."""
        try:
            path = inside(self.path.parent, str(value), self.allow_outside)
        except BadInput as error:
            self.faults.append(f"{where}: scene: {error}")
            return None
        if not path.is_file():
            self.faults.append(f"{where}: scene {value!r} is not a file beside the job")
        return path


def _read(
    document: Mapping[str, Any],
    path: Path,
    load: Callable[[str], Robot],
    allow_outside: bool,
    payload: Load | None = None,
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
    reader = _Reader(document, path, load(name), allow_outside)
    reader.known(document, TOP, "job")
    poses = document.get("poses", {})
    if not isinstance(poses, Mapping):
        reader.faults.append("poses: expected a table of names and positions")
        poses = {}
    for key, value in poses.items():
        q = reader.pose(value, f"poses: {key}")
        if q is not None:
            reader.poses[key] = q
    cycle = reader.number(document, "cycle_time", "job", 1.0, BRIEFEST)
    if "cycle_time" not in document:
        reader.faults.append("job: no cycle_time; expected seconds")
    rows = document.get("step", [])
    if not isinstance(rows, list) or not rows or not all(isinstance(row, Mapping) for row in rows):
        return None, [*reader.faults, "step: expected [[step]] tables, at least one"]
    if len(rows) > MOST_STEPS:
        return None, [*reader.faults, f"step: {len(rows)} steps; expected at most {MOST_STEPS}"]
    steps = _steps(reader, rows, payload)
    brakes = reader.truth(document, "brakes", "job", False)
    if reader.faults:
        return None, reader.faults
    return Job(path.stem, reader.robot, cycle, tuple(steps), brakes), []


def _steps(reader: _Reader, rows: list[Mapping[str, Any]], held: Load | None) -> list[Step]:
    top = reader.document
    at = reader.pose(top["home"], "home") if "home" in top else None
    if at is not None:
        reader.poses.setdefault("home", at)  # `to = "home"` goes there, also where home is given as positions
    targets = [reader.pose(row["to"], _where(k, row)) if "to" in row else None for k, row in enumerate(rows)]
    if "home" not in top:
        at = next((q for row, q in zip(reversed(rows), reversed(targets), strict=True) if "to" in row), None)
        if at is None and not reader.faults:
            reader.faults.append("step: no step moves; give `to`, or `home` to wait at")
    if reader.faults or at is None:
        _known(reader, rows)
        return []
    begin = at
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
    if np.abs(at - begin).max() > SAME:
        j = int(np.argmax(np.abs(at - begin)))
        reader.faults.append(
            f"{_where(len(rows) - 1, rows[-1])}: the last step does not return to where the cycle begins: "
            f"{reader.robot.joints[j]} ends at {at[j]:.4g}, the cycle begins at {begin[j]:.4g}"
        )
    if not out[-1].stop:
        reader.faults.append(f"{_where(len(rows) - 1, rows[-1])}: stop = false; the last step must end at rest")
    return out


def _known(reader: _Reader, rows: list[Mapping[str, Any]]) -> None:
    for k, row in enumerate(rows):
        where = _where(k, row)
        if ("to" in row) == ("wait" in row):
            reader.faults.append(f"{where}: expected either `to` or `wait`")
        reader.known(row, WAITING if "wait" in row else MOVING, where)


def _where(k: int, row: Mapping[str, Any]) -> str:
    name = row.get("name")
    return f"step {k + 1} ({name})" if isinstance(name, str) else f"step {k + 1}"


def _step(
    reader: _Reader,
    row: Mapping[str, Any],
    where: str,
    at: np.ndarray,
    target: np.ndarray | None,
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
    goal = at if target is None else target
    return Step(name, at, goal, None, False, mode, least, most, payload, scene, stop)
