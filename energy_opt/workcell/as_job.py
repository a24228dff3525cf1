"""A robot of a cell as a job of one robot, so that paths, poses and payloads are treated as in the verb `job`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.files import inside
from energy_opt.jobs.file import Job
from energy_opt.jobs.file import job_of as read_job
from energy_opt.jobs.legs import wrong_frames
from energy_opt.poses.given import poses_of_request
from energy_opt.poses.pose import Pose
from energy_opt.power.known import load_model
from energy_opt.robot import Robot, robot_named, tool_of
from energy_opt.workcell.curves import ring_of
from energy_opt.workcell.file import PoseTable, RobotTable, StepTable, WorkCell, load_workcell, step_name


def explicit_steps(table: RobotTable) -> list[StepTable]:
    """The robot's steps, each with its name and its payload, so that they can be reordered."""
    out, payload = [], table.payload
    for k, step in enumerate(table.step):
        payload = payload if step.payload is None else step.payload
        out.append(step.model_copy(update={"name": step_name(k, step), "payload": payload}))
    return out


def at_positions(table: RobotTable, chosen: Mapping[int, np.ndarray]) -> RobotTable:
    """The robot's table with joint positions (n,) in place of the poses of the tool at which steps k end."""
    steps, poses, home = list(table.step), dict(table.poses), table.home
    for k, q in chosen.items():
        alone = isinstance(steps[k].to, str) and sum(step.to == steps[k].to for step in steps) == 1
        at = {} if alone else {"to": q.tolist()}  # keep a name that modes may use
        if alone:
            poses[str(steps[k].to)] = q.tolist()
        steps[k] = steps[k].model_copy(update={**at, "pose": None, "free": None, "pose_tolerance": None})
    last = max(k for k, step in enumerate(steps) if step.moves)
    home = home if home is None or last not in chosen else chosen[last].tolist()
    return table.model_copy(update={"step": steps, "poses": poses, "home": home})


def job_of(
    cell: WorkCell,
    table: RobotTable,
    load: Callable[[str], Robot],
    path: Path,
    allow_outside: bool,
    named: Mapping[str, Pose],
) -> Job:
    """The robot's steps as a job of one robot.

    Args:
        cell: with cycle time and common poses. table: the robot's. load: loads a robot from its name or URDF.
        path: the job file. allow_outside: URDFs and scenes may lie outside of its folder. named: poses of the scene.

    Raises:
        BadInput: every fault, one a line, with robot and step.
    """
    document = {
        "format": "energy-opt/job/1",
        "robot": table.robot,
        "cycle_time": cell.cycle_time,
        **({} if table.home is None else {"home": table.home}),
        "poses": {name: _plain(place) for name, place in {**cell.poses, **table.poses}.items()},
        "step": [_step(k, step) for k, step in enumerate(table.step)],
    }
    try:
        return read_job(document, path, load, allow_outside=allow_outside, named=named)
    except BadInput as error:
        raise BadInput(str(error).replace(f"{path}: ", f"{path}: robot {table.name}: ")) from None


def check_workcell(path: Path, load: Callable[[str], Robot], around: CellRequest, notes: list[str]) -> list[str]:
    """Every fault of a job file of format 2, one line each; empty if it is usable.

    Args:
        load: loads a robot from its name or from the path of its URDF. around: the arms, as for the verb `job`.
        notes: takes further remarks.
    """
    try:
        cell = load_workcell(path)
    except BadInput as error:
        return str(error).splitlines()
    faults: list[str] = []
    for table in cell.robot:
        try:
            if table.robot is None:
                ring_of(cell, table)
                continue
            request = request_of(cell, table, path, arms_beside(cell, table, path, load, around))
            explicit = table.model_copy(update={"step": explicit_steps(table)})
            job = job_of(cell, explicit, load, path, around.allow_outside, poses_of_request(request))
            notes += [f"robot {table.name}: {remark}" for remark in job.remarks]
            tool_of(job.robot.body, table.tool)
            if table.model is not None:
                load_model(model_named(table.model, path, around.allow_outside), job.robot).check(job.robot.n)
            faults += [f"{path}: robot {table.name}: {fault}" for fault in wrong_frames(job, request)]
        except BadInput as error:
            lines = (line if line.startswith(f"{path}: ") else f"{path}: {line}" for line in str(error).splitlines())
            faults += [line for line in lines if line not in faults]
    return faults


def request_of(cell: WorkCell, table: RobotTable, path: Path, request: CellRequest) -> CellRequest:
    """Body and cell of a robot: the request with the robot's base and tool, and the file's scene where it has none.

    Args:
        table: the robot's. path: the job file, in whose folder the scene is looked for.

    Raises:
        BadInput: the base is none, or the scene lies outside of the job's folder.
    """
    try:
        own = None if cell.scene is None else inside(path.parent, cell.scene, request.allow_outside)
        scene = request.scene or own
        return replace(request, base=tuple(table.base), scene=scene, tool=table.tool or request.tool)
    except BadInput as error:
        raise BadInput(f"{path}: robot {table.name}: {error}") from None


def robot_in(table: RobotTable, path: Path, load: Callable[[str], Robot], around: CellRequest) -> Robot | None:
    """The arm of a robot of the job file `path`; None without one, or if it is faulty: reading its steps says why.

    Args:
        load: loads a robot from its name or from the path of its URDF. around: whether files may lie outside.
    """
    with suppress(BadInput):
        return None if table.robot is None else load(robot_named(table.robot, path.parent, around.allow_outside))
    return None


def arms_beside(
    cell: WorkCell, table: RobotTable, path: Path, load: Callable[[str], Robot], around: CellRequest
) -> CellRequest:
    """The request with the other arms of the cell; see `robot_in`."""
    others = ((other, robot_in(other, path, load, around)) for other in cell.robot if other.name != table.name)
    return replace(around, beside=tuple((other.name, robot, tuple(other.base)) for other, robot in others if robot))


def model_named(name: str, path: Path, allow_outside: bool) -> str:
    """A model's name in the job file `path`, or the path of the model file beside it.

    Raises:
        BadInput: the file lies outside of the job's folder, and `allow_outside` is False.
    """
    return str(inside(path.parent, name, allow_outside)) if (path.parent / name).is_file() else name


def _step(k: int, step: StepTable) -> dict[str, Any]:
    """A step as an entry of a job file of format 1; a wait has its shortest duration."""
    out: dict[str, Any] = {"name": step_name(k, step)}
    if step.payload is not None:
        out["payload"] = _plain(step.payload)
    if not step.moves:
        return {**out, "wait": max(step.span[0], 1e-6)}
    given = {key: getattr(step, key) for key in ("to", "pose", "free", "pose_tolerance", "mode", "max_duration")}
    out |= {key: value for key, value in given.items() if value is not None}
    return out | {"min_duration": step.min_duration, "stop": step.stop}


def _plain(value: Any) -> Any:
    if isinstance(value, PoseTable):
        return value.model_dump(exclude_unset=True)
    return list(value) if isinstance(value, tuple) else value
