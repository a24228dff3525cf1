"""`energy-opt simulate`: trajectories played on a virtual arm, and the measured set that comes of it."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from energy_opt.cli.common import add_cell, add_lock, add_output, add_prefix, cell_of, load_robot_of, payload_from, say
from energy_opt.errors import BadInput, Infeasible

if TYPE_CHECKING:
    from energy_opt.motion.trajectory import Trajectory
    from energy_opt.robot import Robot
    from energy_opt.virtual_arm import Plant, Reference, Run

MOST_REPEATS = 100_000
BRIEFEST = 0.1  # [s] of a pose that is held: a meter has some readings of it
MOST_SECONDS = 3600.0  # of motion: 4 million steps, some minutes and 2 GB


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument(
        "trajectories", nargs="+", type=Path, metavar="TRAJECTORY", help="files of trajectories, in order"
    )
    add_lock(parser)
    add_prefix(parser)
    parser.add_argument(
        "--plant", type=Path, required=True, metavar="MODEL.toml", help="what the arm truly is: a model file"
    )
    group = parser.add_argument_group("robot and model")
    group.add_argument("--robot", metavar="NAME_OR_URDF", help="the arm (default: the plant file's)")
    group.add_argument("--limits", type=Path, metavar="FILE", help="joint limits (MoveIt's joint_limits.yaml)")
    group.add_argument("--payload", metavar="MASS[,CX,CY,CZ]", help="payload [kg, m] that the arm truly carries")
    group.add_argument(
        "--model", metavar="DECLARED.toml", help="what the owner believes, a file or a name: put into the set"
    )
    group = parser.add_argument_group("runs")
    group.add_argument("--repeat", type=int, default=1, metavar="N", help="play all of them N times (1)")
    group.add_argument("--rest", type=float, default=0.3, metavar="S", help="standing before and after each [s] (0.3)")
    group.add_argument(
        "--static",
        type=float,
        default=0.0,
        metavar="S",
        help="also a static run of S seconds where each begins (0: none)",
    )
    group = parser.add_argument_group("instruments")
    group.add_argument(
        "--noise", type=float, default=0.6, metavar="W", help="standard deviation of the meter's noise (0.6)"
    )
    group.add_argument("--rate", type=float, default=125.0, metavar="HZ", help="encoder samples per second (125)")
    group.add_argument("--meter-rate", type=float, metavar="HZ", help="a meter with a file and clock of its own")
    group.add_argument("--resolution", type=float, default=0.02, metavar="W", help="of the meter (0.02)")
    group.add_argument("--encoder", type=float, default=2e-5, metavar="RAD", help="resolution of the encoders (2e-5)")
    group.add_argument(
        "--jitter", type=float, default=0.0, metavar="S", help="standard deviation of sampling times (0)"
    )
    group.add_argument("--log", nargs="*", default=[], metavar="SIGNAL", help="also log velocity, effort")
    add_cell(parser)
    add_output(parser, "simulated", report=False)


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.cli.progress import Progress
    from energy_opt.files import to_json
    from energy_opt.folders import written_whole
    from energy_opt.front.given import model_from
    from energy_opt.power.locked import of_joints
    from energy_opt.robot import robot_named
    from energy_opt.virtual_arm import Instruments, load_plant, simulate

    if not 1 <= args.repeat <= MOST_REPEATS:
        raise BadInput(f"--repeat {args.repeat}: expected 1 to {MOST_REPEATS}")
    if args.seed < 0:
        raise BadInput(f"--seed {args.seed}: expected 0 or more")
    plant = load_plant(args.plant)
    if args.payload is not None:
        plant = dataclasses.replace(plant, model=plant.model.replaced(payload_from(args.payload)))
    robot = load_robot_of(args, args.robot or robot_named(plant.model.robot, args.plant.parent, args.allow_outside))
    plant = dataclasses.replace(plant, model=of_joints(plant.model, robot))
    declared = model_from(args.model, robot) if args.model is not None else None
    instruments = Instruments(
        rate=args.rate,
        meter_rate=args.meter_rate,
        noise=args.noise,
        power_resolution=args.resolution,
        position_resolution=args.encoder,
        jitter=args.jitter,
        rest=args.rest,
        extra=tuple(args.log),
    )
    references, sources = _references(args, robot)
    request = {"command": _words(args)}
    _guard(args, request)
    with Progress(args), written_whole(args.out, "log.toml", _simulated(args.out)) as aside:
        runs = simulate(references, plant, robot, aside, seed=args.seed, instruments=instruments, truth=request)
        if declared is not None:
            declared.save(aside / "declared.toml")
    for line in _remarks(runs, robot):
        say(args, line)
    if args.json:
        rows = [
            {"file": r.file, "trajectory": s, "start": r.start, "duration": r.duration, "energy": r.energy}
            for r, s in zip(runs, sources, strict=True)
        ]
        sys.stdout.write(to_json({"out": args.out, "robot": robot.name, "plant": _names(plant), "runs": rows}))
    used, duration = sum(r.energy for r in runs), sum(r.duration for r in runs)
    say(args, f"{args.out}: {len(runs)} runs, {duration:.1f} s, {used:.1f} J really used")
    return 0


def _simulated(out: Path) -> list[str]:
    """Files of the runs that lie in a folder already, where they were simulated and not measured."""
    from energy_opt.files import read_toml

    if not (out / "truth.toml").is_file() or not (out / "log.toml").is_file():
        return []
    try:
        rows = read_toml(out / "log.toml").get("run", [])
    except BadInput:
        return []
    names = [str(row[key]) for row in rows for key in ("file", "power_file") if key in row]
    return ["declared.toml", *(name for name in names if Path(name).name == name and (out / name).is_file())]


def _words(args: argparse.Namespace) -> list[str]:
    """The command line without what changes nothing in the set."""
    return [str(word) for word in args.command if word not in ("--force", "--json", "--quiet", "-v")]


def _guard(args: argparse.Namespace, request: dict[str, list[str]]) -> None:
    """Refuse to overwrite measured data, or what other words simulated, unless forced."""
    from energy_opt.files import read_toml
    from energy_opt.folders import take_folder

    take_folder(args.out)
    if args.force or not (args.out / "log.toml").exists():
        return
    truth = args.out / "truth.toml"
    if not truth.is_file() or read_toml(truth).get("command") != request["command"]:
        held = "what other words simulated" if truth.is_file() else "a measured set"
        raise BadInput(f"{args.out} holds {held}; choose another --out, or overwrite it with --force")


def _references(args: argparse.Namespace, robot: Robot) -> tuple[list[Reference], list[str]]:
    """What to play, in order, named run01, run02, ..., and the file that each comes from."""
    import numpy as np

    from energy_opt.formats import read_trajectory
    from energy_opt.virtual_arm import pose, reference_of

    if args.static != 0 and not BRIEFEST <= args.static < np.inf:
        raise BadInput(f"--static {args.static:g}: expected 0, or {BRIEFEST:g} s and more")
    files = [(read_trajectory(path, robot.joints, args.joint_prefix), path) for path in args.trajectories]
    _check_clear(args, robot, files)
    read = [(reference_of(trajectory, path.stem), str(path)) for trajectory, path in files]
    out: list[Reference] = []
    sources: list[str] = []
    seconds = args.repeat * sum(reference.duration + 2 * args.rest + args.static for reference, _ in read)
    if not seconds <= MOST_SECONDS and not args.allow_large:
        raise BadInput(
            f"{seconds:.6g} s to simulate; at most {MOST_SECONDS:g} s without --allow-large (are the times seconds?)"
        )
    for reference, source in read * args.repeat:
        if args.static > 0:
            out.append(pose(f"run{len(out) + 1:02d}", reference.position[0], args.static))
            sources.append(source)
        out.append(dataclasses.replace(reference, name=f"run{len(out) + 1:02d}"))
        sources.append(source)
    return out, sources


def _check_clear(args: argparse.Namespace, robot: Robot, files: list[tuple[Trajectory, Path]]) -> None:
    """Refuse what would break an arm.

    Raises:
        Infeasible: a trajectory touches the arm's own body or its cell; names pair, time and depth.
    """
    from energy_opt.cell.load import load_cell

    cell = load_cell(robot, cell_of(args))
    if cell is None:
        return
    for trajectory, path in files:
        t = trajectory
        found = cell.prove(t.time, t.position, t.velocity, t.acceleration)
        if found.verdict == "colliding":
            raise Infeasible(
                f"{path}: {found}; --self-collision off (and no --scene) plays it all the same",
                limit="clearance", position=found.time, excess=found.depth,
            )  # fmt: skip
        if not found.proven:
            say(args, f"warning: {path}: {found}")


def _remarks(runs: list[Run], robot: Robot) -> list[str]:
    """A line for every joint whose motor had to give more than its effort limit."""
    out = []
    for j, joint in enumerate(robot.joints):
        worst = max(float(abs(r.played.torque[:, j]).max()) for r in runs)
        if worst > robot.limits.effort[j]:
            unit = robot.unit("effort", joint)
            out.append(f"warning: {joint}: needed {worst:.3g} {unit}, its limit is {robot.limits.effort[j]:.3g} {unit}")
    return out


def _names(plant: Plant) -> list[str]:
    return [effect.name for effect in plant.model.effects] + [special.name for special in plant.specials]
