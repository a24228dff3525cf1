"""`energy-opt check`: is this log, trajectory, model, limits file, suite or URDF usable; every fault is named."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from energy_opt.cli.common import (
    add_cell,
    add_lock,
    add_prefix,
    cell_of,
    load_robot_of,
    locks_of,
    model_of,
    refuse_degrees,
    say,
)
from energy_opt.cli.faults import one_line
from energy_opt.errors import BadInput, EnergyOptError
from energy_opt.results import faults_of_results

if TYPE_CHECKING:
    from energy_opt.motion.trajectory import Trajectory
    from energy_opt.robot import Robot


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE_OR_DIR", help="what to check")
    parser.add_argument("--robot", metavar="NAME_OR_URDF", help="the robot whose joints and limits are meant")
    parser.add_argument("--limits", type=Path, metavar="FILE", help="joint limits (MoveIt's joint_limits.yaml)")
    parser.add_argument("--model", metavar="MODEL", help="model for the torque of a trajectory (source-method-2)")
    parser.add_argument("--payload", metavar="MASS[,CX,CY,CZ]", help="carried along a trajectory [kg, m] (none)")
    add_lock(parser)
    add_prefix(parser)
    add_cell(parser)
    parser.add_argument("--json", action="store_true", help="faults as one JSON document on stdout")
    parser.add_argument("--quiet", action="store_true", help="say nothing where nothing is wrong")


def run(args: argparse.Namespace) -> int:
    """Run the verb; 0 where all is usable, 2 where not."""
    from energy_opt.files import to_json

    faults: dict[str, list[str]] = {}
    notes: dict[str, list[str]] = {}
    for file in args.files:
        notes[str(file)] = []
        try:
            faults[str(file)] = _faults(file, args, notes[str(file)])
        except EnergyOptError as error:
            faults[str(file)] = str(error).splitlines()
    bad = any(faults.values())
    if args.json:
        rows = [
            {"file": name, "usable": not found, "faults": found, "remarks": notes[name]}
            for name, found in faults.items()
        ]
        failed = (
            {"status": "bad_input", "message": "\n".join(fault for found in faults.values() for fault in found)}
            if bad
            else {}
        )
        sys.stdout.write(to_json({"usable": not bad, **failed, "files": rows}))
    for name, found in faults.items():
        for fault in found:
            print(f"energy-opt: {one_line(fault)}", file=sys.stderr)
        for note in notes[name]:
            say(args, f"note: {note}")
        if not found and not args.quiet and not args.json:
            print(f"{name}: usable")
    return 2 if bad else 0


def _faults(file: Path, args: argparse.Namespace, notes: list[str]) -> list[str]:
    """Faults of a file or folder; what else its reader should know goes to `notes`."""
    if file.is_dir() and (file / "metadata.yaml").is_file():
        return _trajectory(file, args)
    held = faults_of_results(file) if file.is_dir() else None
    if held is not None and not (file / "log.toml").is_file():
        return held
    if file.is_dir() or file.name == "log.toml":
        return _set(file, args, notes)
    if not file.is_file():
        return [f"{file}: no such file or folder"]
    if file.suffix == ".toml":
        return _toml(file, args, notes)
    if file.suffix in (".yaml", ".yml", ".json", ".scene"):
        return _document(file, args)
    if file.suffix == ".srdf":
        from energy_opt.robot.srdf import read_srdf

        read_srdf(file)
        return []
    if file.suffix in (".urdf", ".xml", ".xacro"):
        from energy_opt.cell.usable import RobotInspection, inspect_robot

        notes += inspect_robot(
            RobotInspection(str(file), args.limits, locks_of(args), args.joint_prefix, cell_of(args))
        ).remarks
        return []
    return _trajectory(file, args)


def _document(file: Path, args: argparse.Namespace) -> list[str]:
    """A scene, a message with a planned trajectory, or joint limits."""
    from energy_opt.cell.scene_files import check_scene, is_scene
    from energy_opt.files import read_json, read_yaml_documents
    from energy_opt.formats.messages import trajectories

    if file.suffix == ".scene":
        return check_scene(file, allow_outside=args.allow_outside, allow_large=args.allow_large)
    documents = [read_json(file)] if file.suffix == ".json" else read_yaml_documents(file)
    if any(True for document in documents for _ in trajectories(document)):
        return _trajectory(file, args)
    if any(map(is_scene, documents)):
        return check_scene(file, allow_outside=args.allow_outside, allow_large=args.allow_large)
    return _trajectory(file, args) if file.suffix == ".json" else _limits(file, args)


def _set(file: Path, args: argparse.Namespace, notes: list[str]) -> list[str]:
    from energy_opt.measured import inspect_set

    faults, remarks = inspect_set(file, args.allow_outside, locks_of(args))
    notes += remarks
    return faults


def _toml(file: Path, args: argparse.Namespace, notes: list[str]) -> list[str]:
    from energy_opt.files import read_toml

    document = read_toml(file)
    kind = str(document.get("format", ""))
    if kind.startswith("energy-opt/model/"):
        from energy_opt.power.model import model_from_document
        from energy_opt.robot import known_robots, load_robot

        model = model_from_document(document, str(file))
        name = args.robot or (model.robot if model.robot in known_robots() else None)
        if name is not None:
            try:
                model.check(load_robot(name).n)
            except BadInput as error:
                return [f"{file}: {error}"]
        return []
    if kind.startswith("energy-opt/log/"):
        return _set(file, args, notes)
    if kind == "energy-opt/job/2":
        from energy_opt.workcell import check_workcell

        return check_workcell(file)
    if kind.startswith("energy-opt/job/"):
        from energy_opt.job import check_job
        from energy_opt.robot import load_robot

        def load(name: str) -> Robot:
            return load_robot(args.robot or name, limits=args.limits, prefix=args.joint_prefix)

        return check_job(file, load, allow_outside=args.allow_outside)
    from energy_opt.bench.suite import check_suite

    return check_suite(file, allow_outside=args.allow_outside, allow_large=args.allow_large)


def _limits(file: Path, args: argparse.Namespace) -> list[str]:
    from energy_opt.robot import known_robots, load_robot
    from energy_opt.robot.limits_file import names_in

    names = names_in(file)
    candidates = [args.robot] if args.robot else list(known_robots())
    for name in candidates:
        if {args.joint_prefix + joint for joint in load_robot(name).joints} & set(names):
            load_robot(name, limits=file, prefix=args.joint_prefix)
            return []
    return [f"{file}: names {', '.join(names)}, which are joints of none of {', '.join(candidates)} (say --robot)"]


def _trajectory(file: Path, args: argparse.Namespace) -> list[str]:
    """Waypoints and trajectories: readable, and a trajectory within the robot's limits."""
    import numpy as np

    from energy_opt.formats import read
    from energy_opt.front.given import model_from
    from energy_opt.motion.judge.certificate import ALLOWED, certify
    from energy_opt.motion.judge.energy import Scorer
    from energy_opt.motion.limits.registry import joint_limits
    from energy_opt.robot import known_robots, load_robot

    rows = read(file)
    for note in rows.notes:
        say(args, note)
    if args.robot is None:
        joints = {name.removeprefix(args.joint_prefix) for name in rows.joints}
        matching = [name for name in known_robots() if set(load_robot(name).joints) <= joints]
        if not matching:
            return [f"{file}: joints {', '.join(rows.joints)} are those of no robot by name; say which with --robot"]
        robot = load_robot_of(args, matching[0])
        say(args, f"{file}: taken for a {robot.name} (say --robot to change it)")
    else:
        robot = load_robot_of(args)
    rows = rows.of(robot.joints, args.joint_prefix)
    refuse_degrees(robot, rows.position, rows.where)
    if rows.time is None:
        return []
    trajectory = rows.trajectory()
    model = model_of(model_from(args.model, robot), args, robot)
    certificate = certify(trajectory, Scorer(robot, model), joint_limits(robot.limits))
    return [
        *_touches(file, args, robot, trajectory),
        *(
            f"{file}: {found.limit} of {found.where} is {found.value:.6g} at {found.time:.4g} s (row "
            f"{_row(trajectory, found.time)}), beyond its bound {found.bound:.6g} by {excess:.2e} of it"
            for found in certificate.found
            if (excess := np.inf if found.excess is None else found.excess) > ALLOWED
        ),
    ]


def _row(trajectory: Trajectory, time: float) -> int:
    """The row of data, counted from 1, that is last before `time` [s]."""
    import numpy as np

    return int(np.searchsorted(trajectory.time, time, side="right"))


def _touches(file: Path, args: argparse.Namespace, robot: Robot, trajectory: Trajectory) -> list[str]:
    """Where a trajectory touches the arm's own body or its cell, or comes too near."""
    from energy_opt.cell.load import load_cell
    from energy_opt.motion.judge.clearance import clearance_of

    cell = load_cell(robot, cell_of(args))
    for warning in [] if cell is None else cell.warnings:
        say(args, f"{file}: {warning}")
    if cell is None or not cell.checks:
        return []
    t = trajectory
    found = clearance_of(cell.beside(t.time, t.position, t.velocity, t.acceleration), t)
    return [] if found.proven else [f"{file}: {found}"]
