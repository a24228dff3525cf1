"""`evaluate` from Python: motions as they are, under one or several models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.evaluate import Evaluation, Recorded, load
from energy_opt.evaluate import evaluate as evaluated
from energy_opt.evaluate.source import Stretch, joints_in, robot_named
from energy_opt.front.given import AnyModel, AnyPayload, AnyRobot, robot_from
from energy_opt.front.request import stamp
from energy_opt.front.rivals import rivals_from
from energy_opt.motion.standing import standstills
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.robot import Robot, known_robots, load_robot

AnyMotion = Trajectory | str | PathLike[str]


@dataclass(frozen=True)
class EvaluateRequest:
    """What to evaluate, and under what.

    Attributes:
        files: trajectories, programs, recordings, or results of `optimize` and `job` (folder, JSON or table).
        robot: a robot, a name or a URDF; None: the one that the files name, or whose joints they have.
        models: the models; none: those that `optimize` plans under.
        payload: mass [kg], or mass and centre [m] in the last joint's frame, in place of what the files say.
        limits: a joint_limits.yaml in MoveIt's format.
        cell: what the arm keeps clear of; by default its own body.
        prefix: what stands before joints' names in the files.
    """

    files: tuple[AnyMotion, ...]
    robot: AnyRobot | None = None
    models: tuple[AnyModel, ...] = ()
    payload: AnyPayload | None = None
    limits: str | PathLike[str] | None = None
    cell: CellRequest = field(default_factory=CellRequest)
    prefix: str = ""


@dataclass(frozen=True)
class Answers:
    """Evaluations of all motions, with the robot and what was asked for."""

    robot: Robot
    request: dict[str, Any]
    found: tuple[Evaluation, ...]

    def __str__(self) -> str:
        from energy_opt.evaluate.output import table

        return table(self.found)

    def save(
        self, out: str | PathLike[str], write: Sequence[str] = (), rate: float | None = None, prefix: str = ""
    ) -> Path:
        """Write evaluate.json, and every motion in the formats of `write`, at `rate` Hz where given, into `out`."""
        from energy_opt.evaluate.output import write as saved
        from energy_opt.formats.output import wanted

        saved(self.robot, self.found, self.request, Path(out), wanted(write, self.robot.n), rate, prefix)
        return Path(out)


def evaluate(
    files: AnyMotion | Sequence[AnyMotion],
    robot: AnyRobot | None = None,
    model: AnyModel | Sequence[AnyModel] = None,
    *,
    payload: AnyPayload | None = None,
    limits: str | PathLike[str] | None = None,
    scene: str | PathLike[str] | None = None,
    cell: CellRequest | None = None,
    prefix: str = "",
) -> Answers:
    """Any trajectory, cycle or recorded motion as it is: energy by effect under every model, limits, clearance,
    baselines. Arguments are the fields of `EvaluateRequest`; one file or model, or several.

    Raises:
        BadInput: a file holds no motion, or the robot is not known from it.
    """
    several = [files] if isinstance(files, (Trajectory, str, PathLike)) else list(files)
    models = [model] if model is None or isinstance(model, (str, PathLike, PowerModel)) else list(model)
    asked = cell or CellRequest()
    asked = asked if scene is None else replace(asked, scene=Path(scene))
    models = [] if models == [None] else models
    return answered(EvaluateRequest(tuple(several), robot, tuple(models), payload, limits, asked, prefix))


def answered(asked: EvaluateRequest, command: list[str] | None = None, robot: Robot | None = None) -> Answers:
    """The evaluations that a request asks for; `robot` in place of the one that it names."""
    if not asked.files:
        raise BadInput("no FILE; give a trajectory, a cycle or a recording")
    arm = robot or robot_from(asked.robot or robot_of(asked.files, asked.prefix), asked.limits)
    rivals, _ = rivals_from(asked.models, None, arm, asked.payload)
    if any(asked.cell.base[3:5]):  # gravity is the scene's -z
        rivals = [replace(rival, model=rival.model.standing(*asked.cell.base[3:5])) for rival in rivals]
    cell = load_cell(arm, asked.cell)
    cell = cell if cell is not None and cell.checks else None
    motions = [_motion(given, arm, asked.prefix) for given in asked.files]
    found = tuple(evaluated(arm, motion, rivals, cell, asked.payload is not None) for motion in motions)
    request = {
        "files": [motion.name for motion in motions],
        "robot": arm.name,
        "models": [{"name": rival.name, **rival.model.to_document()} for rival in rivals],
        "payload": asked.payload,
        "limits": None if asked.limits is None else str(asked.limits),
        "cell": asked.cell.document(),
        **stamp(command),
    }
    return Answers(arm, request, found)


def robot_of(files: Sequence[AnyMotion], prefix: str = "") -> str:
    """The robot that files name, or the known one whose joints they have.

    Raises:
        BadInput: neither.
    """
    paths = [Path(given) for given in files if not isinstance(given, Trajectory)]
    for path in paths:
        if (named := robot_named(path)) in known_robots():
            return str(named)
    names = joints_in(paths[0]) if paths else files[0].joints if isinstance(files[0], Trajectory) else ()
    joints = {name.removeprefix(prefix) for name in names}
    matching = [name for name in known_robots() if set(load_robot(name).joints) <= joints]
    if not matching:
        raise BadInput(f"joints {', '.join(names)} are those of no robot by name; say which with --robot")
    return matching[0]


def _motion(given: AnyMotion, robot: Robot, prefix: str) -> Recorded:
    if not isinstance(given, Trajectory):
        return load(Path(given), robot.joints, prefix)
    missing = set(robot.joints) - set(given.joints)
    if missing:
        raise BadInput(f"the trajectory has joints {', '.join(given.joints)}; missing: {', '.join(sorted(missing))}")
    index = [given.joints.index(joint) for joint in robot.joints]
    rows = (np.asarray(x)[:, index] for x in (given.position, given.velocity, given.acceleration))
    trajectory = Trajectory(robot.joints, given.time - given.time[0], *rows).on_nanoseconds()
    return Recorded("trajectory", trajectory, (Stretch(0.0, trajectory.duration),), standstills(trajectory))
