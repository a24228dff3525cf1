"""The verb `check`: is this log, trajectory, model, limits file, suite or URDF usable; every fault is named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.batches.suite import load_suite
from energy_opt.cell.load import inspected, load_cell
from energy_opt.cell.scene_files import check_scene, is_scene, read_scene
from energy_opt.errors import BadInput, EnergyOptError
from energy_opt.files import KINDS, read_json, read_toml, read_yaml_documents
from energy_opt.folders import ANSWERS, faults_of_results, listed_files
from energy_opt.formats import read
from energy_opt.formats.judging import Judging
from energy_opt.formats.messages import trajectories
from energy_opt.formats.recording import motion_of
from energy_opt.formats.waypoints import Samples
from energy_opt.front.bench import cell_entries
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import cell_of, model_from, on_arm, robot_of, robot_of_files
from energy_opt.jobs.file import load_job
from energy_opt.jobs.legs import wrong_frames
from energy_opt.measured import inspect_set
from energy_opt.motion.judge.certificate import ALLOWED, certify
from energy_opt.motion.judge.clearance import clearance_of
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.base import Violation
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.standstills import standstills
from energy_opt.motion.trajectory import Trajectory
from energy_opt.poses.given import poses_of_request, poses_of_scene
from energy_opt.power.model import model_from_document
from energy_opt.requests.verbs import CheckRequest
from energy_opt.results import Found
from energy_opt.robot import Robot, known_robots, load_robot
from energy_opt.robot.degrees import doubted_units
from energy_opt.robot.limits import limits_in, names_in
from energy_opt.robot.srdf import read_srdf
from energy_opt.workcell.as_job import check_workcell


@dataclass(frozen=True, eq=False)
class Checked(Found):
    """Whether all files are `usable`, and the `faults` and further `remarks` of each."""

    faults: Mapping[str, list[str]]
    remarks: Mapping[str, list[str]] = field(default_factory=dict)

    @property
    def usable(self) -> bool:
        """True if there is no fault."""
        return not any(self.faults.values())

    @property
    def exit_code(self) -> int:
        """Exit code of the command line."""
        return 0 if self.usable else BadInput.exit_code

    def document(self) -> dict[str, Any]:
        """Whether all are usable, and of each file its faults and remarks."""
        records = [
            {"file": name, "usable": not found, "faults": found, "remarks": self.remarks.get(name, [])}
            for name, found in self.faults.items()
        ]
        failed = {} if self.usable else {"status": BadInput.status, "message": "\n".join(self._lines)}
        return {"usable": self.usable, **failed, "files": records}

    def text(self, out: Path) -> str:
        """A line for every file that is usable."""
        return "\n".join(f"{name}: usable" for name, found in self.faults.items() if not found)

    def __str__(self) -> str:
        """A line for each fault, and for every file that is usable."""
        return "\n".join([*self._lines, *self.text(Path()).splitlines()])

    @property
    def _lines(self) -> list[str]:
        return [fault for found in self.faults.values() for fault in found]


def run(request: CheckRequest, desk: Desk) -> Checked:
    """Whether files are usable; every fault is named with its place."""
    faults: dict[str, list[str]] = {}
    notes: dict[str, list[str]] = {}
    for file in map(Path, request.files):
        notes[str(file)] = []
        try:
            faults[str(file)] = _faults(file, request, notes[str(file)])
        except EnergyOptError as error:
            faults[str(file)] = str(error).splitlines()
    for name, found in faults.items():
        for fault in found:
            desk.complain(fault)
        for note in notes[name]:
            desk.say(f"note: {note}")
    return Checked(faults, notes)


check = verb(CheckRequest, run)


def _faults(file: Path, request: CheckRequest, notes: list[str]) -> list[str]:
    """Faults of a file or folder; further remarks go to `notes`."""
    if file.is_dir() and (file / "metadata.yaml").is_file():
        return _trajectory(file, request, notes)
    answer = file.is_file() and file.name in ANSWERS and (file.suffix != ".json" or listed_files(file) is not None)
    if answer:
        notes.append(f"{file}: its folder is checked")
    folder = file.parent if answer else file
    held = faults_of_results(folder) if folder.is_dir() else None
    if held is not None and (answer or not (file / "log.toml").is_file()):
        return held
    if file.is_dir() or file.name == "log.toml":
        return _set(file, request, notes)
    if not file.is_file():
        return [f"{file}: no such file or folder"]
    if file.suffix == ".toml":
        return _toml(file, request, notes)
    if file.suffix in (".yaml", ".yml", ".json", ".scene"):
        return _document(file, request, notes)
    if file.suffix == ".srdf":
        read_srdf(file)
        return []
    if file.suffix in (".urdf", ".xml", ".xacro", ".sdf"):
        robot = load_robot(str(file), limits=request.limits, lock=request.locked, prefix=request.joint_prefix)
        notes += inspected(robot, cell_of(request))
        return []
    return _trajectory(file, request, notes)


def _document(file: Path, request: CheckRequest, notes: list[str]) -> list[str]:
    """A scene, a message with a planned trajectory, or joint limits."""
    if file.suffix == ".scene":
        return _scene(file, request, notes)
    documents = [read_json(file)] if file.suffix == ".json" else read_yaml_documents(file)
    if any(True for document in documents for _ in trajectories(document)):
        return _trajectory(file, request, notes)
    if any(map(is_scene, documents)):
        return _scene(file, request, notes)
    if file.suffix == ".json":
        return _trajectory(file, request, notes)
    if any(map(limits_in, documents)):
        return _limits(file, request)
    return [f"{file}: of no known form; expected a scene (with world or objects), a message with a trajectory (with "
            "joint_names and points), or joint limits (with joint_limits)"]  # fmt: skip


def _scene(file: Path, request: CheckRequest, notes: list[str]) -> list[str]:
    """Faults of a scene; with a robot also of the names of its links."""
    faults = check_scene(file, allow_outside=request.allow_outside, allow_large=request.allow_large)
    if faults:
        return faults
    scene = read_scene(file, allow_outside=request.allow_outside, allow_large=request.allow_large)
    poses_of_scene(scene)
    if request.robot is None:
        frames = ", ".join(dict.fromkeys(filter(None, (thing.still_in for thing in scene.objects))))
        notes += [f"{file}: objects are in the frame of {frames}: not checked without --robot"] if frames else []
    else:
        cell = load_cell(robot_of(request), replace(cell_of(request), scene=file))
        notes += cell.warnings if cell else ()
    return []


def _set(file: Path, request: CheckRequest, notes: list[str]) -> list[str]:
    """Faults of a measured set."""
    faults, remarks = inspect_set(file, request.allow_outside, request.locked)
    notes += remarks
    return faults


def _toml(file: Path, request: CheckRequest, notes: list[str]) -> list[str]:
    """Faults of a TOML file: a model, a log, a job or a suite, by its `format`.

    Raises:
        BadInput: with a line for each fault.
    """
    document = read_toml(file, *KINDS)
    kind = str(document.get("format", ""))
    if kind.startswith("energy-opt/model/"):
        model = model_from_document(document, str(file))
        known = model.robot if model.robot in known_robots() else None
        if request.robot is not None or known is not None:
            its_robot = robot_of(request, known)
            try:
                model_from(model, its_robot)
            except BadInput as error:
                return [f"{file}: {error}"]
        return []
    if kind.startswith("energy-opt/log/"):
        return _set(file, request, notes)
    if kind.startswith("energy-opt/job/"):
        robot, cell = partial(robot_of, request), cell_of(request)
        if kind == "energy-opt/job/2":
            return check_workcell(file, robot, cell, notes)
        job = load_job(file, robot, allow_outside=cell.allow_outside, named=poses_of_request(cell))
        notes += job.remarks
        return [f"{file}: {fault}" for fault in wrong_frames(job, cell)]
    notes += load_suite(
        file, overrides=cell_entries(cell_of(request)),
        allow_outside=request.allow_outside, allow_large=request.allow_large,
    ).notes  # fmt: skip
    return []


def _limits(file: Path, request: CheckRequest) -> list[str]:
    """Faults of a joint_limits.yaml, for the named robot or for the first known robot with one of its joints."""
    names = names_in(file)
    candidates = [str(request.robot)] if request.robot else list(known_robots())
    for name in candidates:
        if {request.joint_prefix + joint for joint in load_robot(name).joints} & set(names):
            load_robot(name, limits=file, prefix=request.joint_prefix)
            return []
    return [f"{file}: names {', '.join(names)}, which are joints of none of {', '.join(candidates)} (give --robot)"]


def _trajectory(file: Path, request: CheckRequest, notes: list[str]) -> list[str]:
    """Waypoints and trajectories: readable, and a trajectory within the robot's limits."""
    samples = read(file)
    if request.robot is None:
        robot = robot_of(request, robot_of_files([file], request.joint_prefix))
        notes.append(f"{file}: read as a file of {robot.name} (--robot names another one)")
    else:
        robot = robot_of(request)
    samples = samples.of(robot.joints, request.joint_prefix, robot.followers)
    notes += samples.notes
    notes += doubted_units(robot, samples.doubtful, samples.position, samples.where)
    if samples.time is None:
        return []
    trajectory, more = motion_of(samples)
    notes += more
    scorer = Scorer(robot, on_arm(model_from(request.model, robot), request, robot))
    faults = _touches(file, request, robot, trajectory, notes)
    for found in _found(samples, trajectory, scorer):
        excess = _excess(found)
        if excess > ALLOWED:
            before = int(np.searchsorted(samples.time - samples.time[0], found.time, side="right"))
            place = f"row {before + 1}" if file.suffix == ".csv" else f"points[{before - 1}]"  # the header is row 1
            by = f"{100 * excess:.3g} %"
            if found.limit == "position":
                by = f"{abs(found.value - found.bound):.3g} {robot.unit('position', found.where)}"
            faults.append(
                f"{file}: {found.limit} of {found.where} is {found.value:.6g} at {samples.time[0] + found.time:.4f} s "
                f"({place}); bound {found.bound:.6g}, exceeded by {by}"
            )
    return faults


def _found(samples: Samples, motion: Trajectory, scorer: Scorer) -> Sequence[Violation]:
    """Where a motion uses each limit most; rates that its file states are judged as they are stated."""
    limits = joint_limits(scorer.robot.limits)
    if samples.steps is not None:
        return Judging(scorer, limits).at_steps(motion, samples.steps).found
    found = {each.limit: each for each in certify(motion, scorer, limits).found}
    if samples.velocity is not None or samples.acceleration is not None:
        stated = certify(samples.trajectory(), scorer, limits, samples_only=True)
        for each in stated.found:
            if getattr(samples, each.limit, None) is not None and _excess(each) > _excess(found[each.limit]):
                found[each.limit] = each
    return tuple(found.values())


def _excess(found: Violation) -> float:
    """By which share a bound is exceeded; infinite if that is unknown."""
    return np.inf if found.excess is None else found.excess


def _touches(file: Path, request: CheckRequest, robot: Robot, trajectory: Trajectory, notes: list[str]) -> list[str]:
    """Where a trajectory touches the arm's own body or its cell, or comes too near."""
    cell = load_cell(robot, cell_of(request))
    notes += [f"{file}: {warning}" for warning in ([] if cell is None else cell.warnings)]
    if cell is None or not cell.checks:
        return []
    t = trajectory
    stops = t(t.time[0] + standstills(t).ravel())  # ends of the motions within a cycle, as `evaluate` takes them
    found = clearance_of(cell.beside(t.time, t.position, t.velocity, t.acceleration), t, stops)
    return [] if found.proven else [f"{file}: {found}"]
