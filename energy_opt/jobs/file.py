"""JOB.toml: an ordered list of moves and waits, repeated in a fixed cycle; see example.toml.

Every fault is named with its step. Without a `home`, the cycle begins at the last `to`. In [poses] and in steps, a pose
of the tool is written pose = [0.5, 0.2, 0.1, 3.14159, 0, 0] (m, rad, in the base frame) or "box_1: 0,0,0.1,3.14159,0,0"
(in that object's frame), with free = ["rz"] and pose_tolerance = "1mm,1deg".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, StrictBool, StrictStr, model_validator

from energy_opt.batches.tables import joint_values, payload_values
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput, suggest
from energy_opt.files import KINDS, inside, read_toml
from energy_opt.jobs.legs import SAME, Job, Load, Step
from energy_opt.motion.move import LONGEST, SHORTEST
from energy_opt.poses.given import SUFFIXES, Given, poses_of_request
from energy_opt.poses.pose import UNIT, Pose
from energy_opt.robot import Robot, robot_named
from energy_opt.schema import Name, Number, Table, parse, reads

OF_POSE = {"pose", "free", "pose_tolerance"}
MOVING = {"to", "mode", "min_duration", "max_duration", "stop", *OF_POSE}  # keys of steps that do not wait
FORMATS = tuple(f"energy-opt/{form}" for form in KINDS["job"])
LISTED = "joint positions are a list of numbers, without quotes"
Target = Pose | np.ndarray


Seconds = Annotated[Number, Field(ge=0, le=LONGEST)]
Lasting = Annotated[Number, Field(ge=SHORTEST, le=LONGEST)]
Mode = Literal["retime", "reshape"]
Carried = Annotated[Load, reads(payload_values)]


class StepTable(Table):
    """One [[step]]: a move `to` positions, or to a `pose` of the tool, or a `wait`."""

    name: Name | None = None
    to: Any = None
    pose: Any = None
    free: Any = ()
    pose_tolerance: Any = None
    wait: Lasting | None = None
    brakes: StrictBool = False
    mode: Mode | None = None
    min_duration: Seconds = 0.0
    max_duration: Seconds = np.inf
    payload: Carried | None = None
    scene: StrictStr | None = None
    stop: StrictBool = True

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if self.moves == (self.wait is not None):
            raise ValueError("expected either `to` or `wait`, or `pose`")
        other = (self.model_fields_set & {"brakes"}) if self.moves else (self.model_fields_set & MOVING)
        if other:
            raise ValueError(f"{min(other)} belongs to a step that {'waits' if self.moves else 'moves'}")
        if self.min_duration > self.max_duration:
            raise ValueError(f"min_duration = {self.min_duration:g} is above max_duration = {self.max_duration:g}")
        return self

    @property
    def moves(self) -> bool:
        """True if it is a move."""
        return self.to is not None or self.pose is not None


class JobTable(Table):
    """The content of JOB.toml; positions and poses are read for the robot later."""

    format: Literal["energy-opt/job/1"]
    robot: StrictStr
    cycle_time: Lasting
    home: Any = None
    mode: Mode = "reshape"
    brakes: StrictBool = False
    payload: Carried = (0.0, 0.0, 0.0, 0.0)
    scene: StrictStr | None = None
    poses: dict[str, Any] = {}
    step: Annotated[list[StepTable], Field(min_length=1, max_length=1000)]


def load_job(path: Path, load: Callable[[str], Robot], **more: Any) -> Job:
    """Read the job file `path`; further arguments and errors are those of `job_of`."""
    return job_of(read_toml(Path(path), "job"), Path(path), load, **more)


def job_of(
    document: Mapping[str, Any],
    path: Path,
    load: Callable[[str], Robot],
    *,
    allow_outside: bool = False,
    payload: Load | None = None,
    named: Mapping[str, Pose] | None = None,
) -> Job:
    """A job from its document.

    Args:
        path: of the job file, the base of other files' paths, also for messages.
        load: loads the robot from its name, or from the path of its URDF.
        allow_outside: URDF and scenes may lie outside the job's folder.
        payload: initial payload instead of the job's, until a step changes it.
        named: further poses by name, as from a scene file.

    Raises:
        BadInput: names every fault, one a line, with the step's name.
    """
    if document.get("format") not in FORMATS:
        raise BadInput(f"{path}: format = {document.get('format')!r}; expected {' or '.join(map(repr, FORMATS))}")
    table = parse(JobTable, document, str(path))
    try:
        name = robot_named(table.robot, path.parent, allow_outside)
    except BadInput as error:
        raise BadInput(f"{path}: robot: {error}") from None
    reading = _Reading(table, path, load(name), allow_outside)
    reading.name_poses(named or {})
    steps = reading.steps(payload)
    if reading.faults:
        raise BadInput("\n".join(f"{path}: {fault}" for fault in reading.faults))
    return Job(path.stem, reading.robot, table.cycle_time, tuple(steps), table.brakes, tuple(reading.remarks))


class _Reading:
    """The positions, poses and scenes of a job, read for its robot; faults are collected."""

    def __init__(self, job: JobTable, path: Path, robot: Robot, allow_outside: bool) -> None:
        self.job, self.path, self.robot, self.allow_outside = job, path, robot, allow_outside
        self.faults: dict[str, None] = {}
        self.remarks: list[str] = []
        self._poses: dict[str, Target] = {}

    def fault(self, text: object) -> None:
        """Record a fault, once."""
        self.faults[str(text)] = None

    def name_poses(self, named: Mapping[str, Pose]) -> None:
        """Collect the poses of the job's scene file, the given ones, and the job's own."""
        scene = self._scene(self.job.scene, "job")
        if scene is not None:
            with suppress(BadInput):  # the scene's own faults are reported where it is read
                self._poses |= poses_of_request(CellRequest(scene=scene))
        self._poses |= named
        for name, value in self.job.poses.items():
            target = self._target(value, f"poses: {name}")
            if target is None:
                continue
            self._poses[name] = target
            count = len(value) if isinstance(value, list) else 0
            if count == 6 or (count == 7 and abs(np.linalg.norm(np.array(value[3:], dtype=float)) - 1) <= UNIT):
                self.remarks.append(
                    f"poses: {name}: these {count} numbers are joint positions; a pose of the tool is "
                    f"{name} = {{ pose = [...] }}"
                )

    def steps(self, held: Load | None) -> list[Step]:
        """All steps in order; `held` is the first payload, instead of the job's."""
        tables = self.job.step
        places = [f"step {k}" + (f" ({row.name})" if row.name else "") for k, row in enumerate(tables, start=1)]
        home = None if self.job.home is None else self._target(self.job.home, "home")
        if home is not None:
            self._poses.setdefault("home", home)  # `to = "home"` also works if home is given as positions
        targets = [self._end(row, where) if row.moves else None for row, where in zip(tables, places, strict=True)]
        last = next((q for row, q in zip(tables[::-1], targets[::-1], strict=True) if row.moves), None)
        begin = last if self.job.home is None else home
        if begin is None and not self.faults:
            self.fault("step: no step moves; give `to` or `pose`, or `home` to wait at")
        if last is None and isinstance(begin, Pose) and not self.faults:
            self.fault("home: no step moves; a job that only waits has joint positions as its home")
        if self.faults or begin is None:
            return []
        nowhere = np.full(self.robot.n, np.nan)  # positions that are still to be chosen
        at = nowhere if isinstance(begin, Pose) else begin
        payload, scene = held or self.job.payload, self._scene(self.job.scene, "job")
        out: list[Step] = []
        for row, where, target in zip(tables, places, targets, strict=True):
            payload = payload if row.payload is None else row.payload
            scene = scene if row.scene is None else self._scene(row.scene, where)
            name, goal, pose = row.name or where, at if target is None else target, None
            if isinstance(goal, Pose):
                own = goal.name == where  # the step states the pose itself
                label = where if own else name if goal.name in name else f"{name}: {goal.name}"
                pose, goal = replace(goal, name=label), nowhere
            step = Step(
                name, at, goal, row.wait, row.brakes, row.mode or self.job.mode, row.min_duration, row.max_duration,
                payload, scene, row.stop, pose,
            )  # fmt: skip
            if not step.stop and (step.least, step.most) != (0.0, np.inf):
                self.fault(
                    f"{where}: stop = false; min_duration and max_duration belong to the step that stops, and "
                    "bound the whole motion"
                )
            before = out[-1] if out and not out[-1].stop else None
            if before and (step.wait is not None or (step.payload, step.scene) != (before.payload, before.scene)):
                self.fault(
                    f"{where}: the step before has stop = false; this one can neither wait nor change payload or scene"
                )
            out.append(step)
            at = step.goal
        self._check_return(places[-1], begin if last is None else last, begin)
        if not out[-1].stop:
            self.fault(f"{places[-1]}: stop = false; the last step must end at rest")
        return out

    def _check_return(self, where: str, end: Target, begin: Target) -> None:
        """Record a fault if the last step does not end at the cycle's beginning."""
        returns = f"{where}: the last step does not return to where the cycle begins"
        if isinstance(end, Pose) or isinstance(begin, Pose):
            if end is not begin and not (isinstance(end, Pose) and end.same_as(begin)):
                self.fault(f"{returns}: home is another pose")
        elif np.abs(end - begin).max() > SAME:
            j = int(np.argmax(np.abs(end - begin)))
            self.fault(f"{returns}: {self.robot.joints[j]} ends at {end[j]:.4g}, the cycle begins at {begin[j]:.4g}")

    def _end(self, row: StepTable, where: str) -> Target | None:
        """The end of a step: `to`, or a pose of the tool with its freedom."""
        given = [key for key in ("pose", "free", "pose_tolerance") if key in row.model_fields_set]
        if not given:
            return self._target(row.to, where)
        if row.pose is not None and row.to is not None:
            self.fault(f"{where}: expected either `to` or `pose`")
            return None
        value = row.to if row.pose is None else row.pose
        if row.pose is None and not isinstance(value, (str, Mapping)):
            self.fault(
                f"{where}: {given[0]} belongs to a pose of the tool; `to` is joint positions: expected `pose = ...`"
            )
            return None
        if isinstance(value, str) and isinstance(self._poses.get(value), np.ndarray):
            self.fault(f"{where}: {value!r} is joint positions; {given[0]} belongs to a pose of the tool")
            return None
        return self._pose(value, where, row.free, row.pose_tolerance)

    def _pose(self, value: Any, where: str, *freedom: Any) -> Pose | None:
        """A pose of the tool; its error becomes a fault."""
        try:
            return Given(self.path.parent, self._poses, self.allow_outside).pose(value, where, *freedom)
        except BadInput as error:
            self.fault(f"{error}; {LISTED}" if self._like_positions(value) else error)
            return None

    def _like_positions(self, value: Any) -> bool:
        """True for text with as many numbers as the arm has joints, in no object's frame."""
        return isinstance(value, str) and ":" not in value and value.count(",") == self.robot.n - 1

    def _target(self, value: Any, where: str) -> Target | None:
        """A pose of the tool, or positions within the position limits, by name or by value."""
        if isinstance(value, str) and value in self._poses:
            return self._poses[value]
        stated = {*self.job.poses, *(() if self.job.home is None else ("home",))}
        if isinstance(value, str) and self.faults and value in stated:
            return None  # its fault is already recorded
        if isinstance(value, str) and not ("," in value or value.endswith(SUFFIXES)):
            self.fault(f"{where}: unknown pose {value!r}{suggest(value, self._poses)}; [poses] names them")
            return None
        if isinstance(value, str) or (isinstance(value, Mapping) and "pose" in value):
            posed = self._pose(value, where)
            if posed is not None and self._like_positions(value):
                self.remarks.append(f"{where}: these {self.robot.n} numbers are read as a pose of the tool; {LISTED}")
            return posed
        try:
            q = np.array(joint_values(value, self.robot, lambda note: self.remarks.append(f"{where}: {note}")))
        except BadInput as error:
            # of several positions a job chooses only where they reach one pose
            like_pose = isinstance(value, list) and (len(value) in (6, 7) or isinstance((*value, 0)[0], list))
            hint = "; a pose of the tool is { pose = [...] }" if like_pose and len(value) != self.robot.n else ""
            self.fault(f"{where}: {error}{hint}")
            return None
        low, high = self.robot.limits.lower, self.robot.limits.upper
        outside = np.flatnonzero((q < low - SAME) | (q > high + SAME))
        for j in outside[:1]:
            name = self.robot.joints[j]
            self.fault(f"{where}: {name} = {q[j]:.4g} is outside its position limits [{low[j]:.4g}, {high[j]:.4g}]")
        return None if outside.size else q

    def _scene(self, name: str | None, where: str) -> Path | None:
        """The path of a scene file beside the job."""
        if name is None:
            return None
        try:
            path = inside(self.path.parent, name, self.allow_outside)
        except BadInput as error:
            self.fault(f"{where}: scene: {error}")
            return None
        if not path.is_file():
            self.fault(f"{where}: scene {name!r} is not a file beside the job")
        return path
