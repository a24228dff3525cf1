"""The verb `evaluate`: given motions, under one or several models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.load import load_cell
from energy_opt.errors import BadInput
from energy_opt.evaluations import Evaluation, Recorded, load
from energy_opt.evaluations import evaluate as evaluated
from energy_opt.evaluations.output import ANSWER, document, table
from energy_opt.evaluations.output import write as saved
from energy_opt.evaluations.source import Stretch, joints_in, robot_named
from energy_opt.formats.output import Written
from energy_opt.front.controllers import check_written
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import cell_of, named_robot, payload_document, robot_of
from energy_opt.front.moves import documents
from energy_opt.front.rivals import rivals_of
from energy_opt.motion.standing import standstills
from energy_opt.motion.trajectory import Trajectory
from energy_opt.requests.verbs import EvaluateRequest
from energy_opt.results import Found, exit_of
from energy_opt.robot import Robot, known_robots, load_robot

AnyMotion = Trajectory | str | PathLike[str]


@dataclass(frozen=True, repr=False)
class Answers(Found):
    """Evaluations of all motions, with the robot and the request.

    Attributes:
        asked: the request; request: the same as evaluate.json has it.
        files: those that were written for controllers, read back and judged.
    """

    robot: Robot
    asked: EvaluateRequest
    request: dict[str, Any]
    found: tuple[Evaluation, ...]
    files: tuple[Written, ...] = ()

    @property
    def exit_code(self) -> int:
        """Exit code of the command line."""
        return exit_of(False, all(row.valid for row in self.files))

    def document(self) -> dict[str, Any]:
        """evaluate.json."""
        written = [row.document() for row in self.files]
        return document(self.robot, self.found, self.request) | {"written": written}

    def text(self, out: Path) -> str:
        """Table of all motions, for a terminal."""
        return table(self.found)

    def __str__(self) -> str:
        return table(self.found)

    def __repr__(self) -> str:
        return f"Answers({self.robot.name!r}, {len(self.found)} motions)"

    def save(
        self, out: str | PathLike[str], write: Sequence[str] = (), rate: float | None = None, prefix: str = ""
    ) -> Path:
        """Write evaluate.json, and every motion in the formats asked for, into `out`.

        Args:
            write, rate, prefix: in place of the request's `write`, `rate` [Hz] and `joint_prefix`.
        """
        asked = replace(self.asked, write=tuple(write)) if write else self.asked
        asked = asked if rate is None else replace(asked, rate=rate)
        replace(self, asked=replace(asked, joint_prefix=prefix) if prefix else asked).kept(Path(out))
        return Path(out)

    def kept(self, out: Path) -> Answers:
        """Write evaluate.json, and every motion in the formats that the request asks for, into the folder `out`."""
        asked = self.asked
        formats = check_written(asked, self.robot.n)
        _, records = saved(self.robot, self.found, self.request, out, formats, asked.rate, asked.joint_prefix)
        return replace(self, files=tuple(records))


def run(request: EvaluateRequest, desk: Desk) -> Answers:
    """Energy by effect of given trajectories, cycles or recordings under every model; limits, clearance, baselines.

    Raises:
        BadInput: a file holds no motion, or the robot is not known from it.
    """
    given: Any = request.files
    files = [each if isinstance(each, Trajectory) else Path(str(each)) for each in given]
    if not files:
        raise BadInput("no FILE; give a trajectory, a cycle or a recording")
    robot = robot_of(request, None if request.robot is not None else robot_of_files(files, request.joint_prefix))
    check_written(request, robot.n)
    rivals, _ = rivals_of(request, robot, desk)
    cell = load_cell(robot, cell_of(request))
    cell = cell if cell is not None and cell.checks else None
    motions = [_motion(given, robot, request.joint_prefix) for given in files]
    found = tuple(evaluated(robot, motion, rivals, cell, request.payload is not None) for motion in motions)
    asked = replace(
        request, files=tuple(motion.name for motion in motions), robot=named_robot(robot, request.robot or robot),
        model=documents(rivals), payload=payload_document(request.payload),
    )  # fmt: skip
    document = desk.take(ANSWER, asked)
    answers = desk.keep(Answers(robot, asked, document, found))
    for evaluation in answers.found:
        for note in evaluation.motion.notes:
            desk.say(f"note: {note}")
    desk.report(answers.files)
    return answers


evaluate = verb(EvaluateRequest, run)


def robot_of_files(files: Sequence[AnyMotion], prefix: str = "") -> str:
    """The name of the robot of some files: the one that they name, or the known one with the same joints.

    Args:
        files: motions. prefix: of the joint names in the files.

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
        raise BadInput(f"joints {', '.join(names)} are not those of a known robot; give --robot")
    return matching[0]


def _motion(given: AnyMotion, robot: Robot, prefix: str) -> Recorded:
    """A motion of a file, or a trajectory with its columns in the robot's order."""
    if not isinstance(given, Trajectory):
        return load(Path(given), robot.joints, prefix)
    missing = set(robot.joints) - set(given.joints)
    if missing:
        raise BadInput(f"the trajectory has joints {', '.join(given.joints)}; missing: {', '.join(sorted(missing))}")
    index = [given.joints.index(joint) for joint in robot.joints]
    samples = (np.asarray(x)[:, index] for x in (given.position, given.velocity, given.acceleration))
    trajectory = Trajectory(robot.joints, given.time - given.time[0], *samples).on_nanoseconds()
    return Recorded("trajectory", trajectory, (Stretch(0.0, trajectory.duration),), standstills(trajectory))
