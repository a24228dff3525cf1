"""What several verbs share: options, and how words of the command line become robots, models and moves."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from energy_opt.cli.faults import printable
from energy_opt.cli.numbers import numbers_of
from energy_opt.cli.view import add_view
from energy_opt.errors import BadInput, near
from energy_opt.files import finite_number

if TYPE_CHECKING:
    import numpy as np

    from energy_opt.cell.request import CellRequest
    from energy_opt.effects import Payload
    from energy_opt.motion import Move, Settings
    from energy_opt.motion.plan.robust import Kind, Rival
    from energy_opt.poses.ends import Ends
    from energy_opt.power import PowerModel
    from energy_opt.robot import Robot


DEGREES = 4 * 3.15  # [rad] outside a limit, from which a position is taken for degrees: two turns


def add_common(parser: argparse.ArgumentParser, out: str, alone: bool = True) -> None:
    """Options of every verb that plans."""
    group = parser.add_argument_group("robot and model")
    group.add_argument("--robot", required=alone, metavar="NAME_OR_URDF", help="a name (`energy-opt robots`) or a URDF")
    limits = "MoveIt's joint_limits.yaml (default: published or the URDF's)"
    group.add_argument("--limits", type=Path, metavar="FILE", help=limits)
    add_lock(group)
    group.add_argument(
        "--payload", metavar="MASS[,CX,CY,CZ]", help="point mass [kg] in the last joint's frame [m] (none)"
    )
    add_model(group)
    group.add_argument(
        "--dynamics", default="auto", metavar="SOURCE", help="auto (default), compact, templates or pinocchio"
    )
    add_output(parser, out)


def add_model(group: argparse._ArgumentGroup, default: str = "source-method-2 and careful, in the mean") -> None:
    """The power model."""
    group.add_argument(
        "--model", action="append", default=[], metavar="MODEL",
        help=f"power model: a file, or source-method-1, source-method-2, careful (default: {default})",
    )  # fmt: skip


def add_output(parser: argparse.ArgumentParser, out: str, report: bool = True) -> None:
    """Where results go and what is said; `report`: is there one to be viewed?"""
    group = parser.add_argument_group("output")
    group.add_argument("--out", type=Path, default=Path(out), metavar="DIR", help=f"folder of results (default: {out})")
    group.add_argument("--json", action="store_true", help="the result as one JSON document on stdout")
    group.add_argument("--seed", type=int, default=0, metavar="N", help="seed of all random choices (0)")
    group.add_argument("--quiet", action="store_true", help="no progress and no messages")
    group.add_argument("--force", action="store_true", help="overwrite what DIR holds of another request")
    if report:
        add_view(group)


def add_move(parser: argparse.ArgumentParser) -> None:
    """Options that say which move, shared by optimize and tradeoff."""
    group = parser.add_argument_group("move")
    group.add_argument(
        "--start", metavar="Q", help="comma-separated joint positions [rad, m], name=value pairs, or a pose of the SRDF"
    )
    group.add_argument("--goal", action="append", metavar="Q", help="the same, for the end (several: any of them)")
    group.add_argument("--path", type=Path, metavar="FILE", help="waypoints [rad, m] or a trajectory instead of both")
    add_prefix(group)
    group.add_argument(
        "--via", action="append", default=[], metavar="Q", help="a point [rad, m] to pass (reshape; repeatable)"
    )
    group.add_argument("--mode", default="reshape", metavar="MODE", help="reshape (default) or retime")
    group = parser.add_argument_group("conditions")
    group.add_argument("--max-power", type=float, metavar="W", help="bound of the arm's electrical power [W]")
    group.add_argument("--tool-speed", type=float, metavar="V", help="bound of the speed of the tool's origin [m/s]")
    group.add_argument(
        "--tool-acceleration", type=float, metavar="A", help="bound of the acceleration of the tool's origin [m/s^2]"
    )
    group.add_argument(
        "--keep", action="append", default=[], metavar="WHAT",
        help="upright[:DEG] (5), orientation[:DEG] (2) or line[:MM] (1) of the tool (repeatable)",
    )  # fmt: skip
    group.add_argument("--tube", metavar="WIDTH", help="0.1rad (each joint) or 0.02m (tool): near the given path (no)")
    group = parser.add_argument_group("solving")
    group.add_argument("--solver", default="ipopt", metavar="NAME", help="ipopt (default), sqp (no last polish)")
    group.add_argument("--starts", type=int, metavar="N", help="starting points of a reshaping at most (24)")
    group.add_argument("--ways", type=int, metavar="N", help="free ways to start from (1; 0 besides a free --path)")
    group.add_argument(
        "--deadline", type=float, metavar="S", help="end the search of each motion after S seconds (never)"
    )
    group.add_argument("--controls", type=int, metavar="N", help="control points per joint of a reshaped move (48)")
    group.add_argument("--end-acceleration", default="zero", metavar="KIND", help="zero (default) or free (reshape)")
    group.add_argument("--compile", default="auto", metavar="WHEN", help="functions: auto (default), always or never")
    objectives = "energy (default), torque, power_squared, path_length, time"
    group.add_argument("--objective", default="energy", metavar="NAME", help=objectives)
    group.add_argument("--verify-samples", type=int, metavar="N", help="samples of the certificate (default: 10 a row)")


def add_cell(parser: argparse.ArgumentParser) -> None:
    """Options of every verb that makes or judges a motion: the arm's own body and what stands around it."""
    group = parser.add_argument_group("body and cell")
    group.add_argument(
        "--self-collision", choices=("on", "off"), default="on", help="the arm keeps clear of itself (on)"
    )
    group.add_argument("--srdf", type=Path, metavar="FILE", help="links that may touch (default: known robots')")
    group.add_argument("--package-dir", action="append", type=Path, default=[], metavar="DIR", help="for package://")
    group.add_argument("--scene", type=Path, metavar="FILE", help="MoveIt PlanningScene, .scene text, or short YAML")
    group.add_argument("--base", metavar="X,Y,Z,R,P,Y", help="robot's base in the scene's frame [m, rad] (the same)")
    group.add_argument("--floor", type=float, metavar="Z", help="solid below this height of the scene's frame [m]")
    group.add_argument("--clearance", type=float, metavar="M", help="kept from everything [m] (0.002)")
    group.add_argument("--planner", default="auto", metavar="NAME", help="first path: auto (default), none or ompl")
    group.add_argument("--tool", metavar="FRAME[,X,Y,Z]", help="the tool's frame and origin [m] (the last joint's)")
    group.add_argument(
        "--payload-size", metavar="X,Y,Z", help="edges of the payload's box about its centre of mass [m]"
    )
    group.add_argument("--allow-outside", action="store_true", help="named files may lie outside the folder of theirs")
    group.add_argument("--allow-large", action="store_true", help="larger files and meshes are read too")


def add_lock(group: argparse._ActionsContainer) -> None:
    """Joints that take no part."""
    group.add_argument("--lock", action="append", default=[], metavar="JOINT=VALUE", help="a joint that stays [rad, m]")


def add_prefix(group: argparse._ActionsContainer) -> None:
    """How joints are called in files that others wrote."""
    group.add_argument("--joint-prefix", default="", metavar="PREFIX", help="what stands before joints' names in files")


def say(args: argparse.Namespace, text: str) -> None:
    """A message on stderr, unless --quiet."""
    if not args.quiet:
        print(printable(text), file=sys.stderr)


def load_robot_of(args: argparse.Namespace, name: str = "") -> Robot:
    """The robot that --robot (or else `name`), --limits and --lock describe."""
    from energy_opt.robot import load_robot

    return load_robot(args.robot or name, limits=args.limits, lock=locks_of(args), prefix=args.joint_prefix)


def locks_of(args: argparse.Namespace) -> dict[str, float]:
    """The joints that --lock holds, and where."""
    lock = {}
    for word in args.lock:
        joint, _, value = word.partition("=")
        lock[joint] = finite_number(value, f"--lock {word}", "JOINT=VALUE")
    return lock


def model_of(model: PowerModel, args: argparse.Namespace, robot: Robot) -> PowerModel:
    """The model with what --payload and --base say: gravity is the scene's -z."""
    if args.payload is not None:
        model = model.for_move(payload_from(args.payload))
    model = model if args.base is None else model.standing(*cell_of(args).base[3:5])
    model.check(robot.n)
    return model


def rivals_of(args: argparse.Namespace, robot: Robot) -> tuple[list[Rival], Kind | None]:
    """The models that --model, --robust and --payload describe; the first is the one that results are stated under."""
    from energy_opt.front.rivals import rivals_from

    payload = None if args.payload is None else payload_from(args.payload)
    rivals, kind = rivals_from(args.model, getattr(args, "robust", None), robot, payload)
    if args.base is not None:  # gravity is the scene's -z
        rivals = [replace(rival, model=rival.model.standing(*cell_of(args).base[3:5])) for rival in rivals]
    for rival in rivals:
        if rival.model.robot not in ("", robot.name):
            say(args, f"warning: {rival.name}: a model of {rival.model.robot}, used for {robot.name}")
    return rivals, kind


def payload_from(word: str) -> Payload:
    """A payload from MASS or MASS,CX,CY,CZ."""
    from energy_opt.effects import Payload

    numbers = [finite_number(part, f"--payload {word}", "MASS or MASS,CX,CY,CZ") for part in word.split(",")]
    if len(numbers) not in (1, 4):
        raise BadInput(f"--payload {word}: {len(numbers)} numbers; expected MASS or MASS,CX,CY,CZ")
    return Payload(mass=numbers[0], com=numbers[1:] or [0.0, 0.0, 0.0])


def cell_of(args: argparse.Namespace) -> CellRequest:
    """Body and cell as the options of `add_cell` say."""
    from energy_opt.cell.request import CellRequest

    size: tuple[float, ...] | None = None
    at: tuple[float, ...] = (0.0, 0.0, 0.0)
    if args.payload_size is not None:
        if getattr(args, "payload", None) is None:
            raise BadInput("--payload-size belongs to --payload MASS[,CX,CY,CZ]")
        size = numbers_of(args.payload_size, 3, "--payload-size", "three edges X,Y,Z [m]")
        at = tuple(payload_from(args.payload).values["com"].tolist())
    base = (0.0,) * 6 if args.base is None else numbers_of(args.base, 6, "--base", "X,Y,Z [m] and R,P,Y [rad]")
    return CellRequest(
        self_collision=args.self_collision == "on",
        srdf=args.srdf,
        scene=args.scene,
        base=base,
        floor=args.floor,
        clearance=args.clearance,
        planner=args.planner,
        package_dirs=tuple(args.package_dir),
        allow_outside=args.allow_outside,
        allow_large=args.allow_large,
        payload_size=size,
        payload_at=at,
        tool=args.tool,
    )


def pose_from(text: str, robot: Robot, option: str, srdf: Path | None = None) -> np.ndarray:
    """Joint positions (n,) as `joint_vector` takes them, or the name of a pose of the robot's SRDF."""
    word = text.strip()
    if not word or any(c in word for c in ",=") or word.replace(".", "").lstrip("+-").isdigit():
        return joint_vector(text, robot.joints, option)
    from energy_opt.robot.srdf import semantics

    try:
        return semantics(robot, srdf).pose(word, robot.joints)
    except BadInput as error:
        raise BadInput(f"{option} {word}: {error}") from None


def joint_vector(text: str, joints: Sequence[str], option: str) -> np.ndarray:
    """Joint positions (n,) from `0.1,0.2,…` or `name=value,…` in any order."""
    import numpy as np

    parts = [part.strip() for part in text.split(",") if part.strip()]
    if any("=" in part for part in parts):
        given: dict[str, float] = {}
        for part in parts:
            name, _, value = part.partition("=")
            if name.strip() not in joints:
                hint = near(name.strip(), joints)
                raise BadInput(f"{option}: unknown joint {name.strip()!r}{hint}; joints are {', '.join(joints)}")
            if name.strip() in given:
                raise BadInput(f"{option}: joint {name.strip()} stands there twice")
            given[name.strip()] = finite_number(value, f"{option} {part}", "name=value")
        missing = [joint for joint in joints if joint not in given]
        if missing:
            raise BadInput(f"{option}: no value for {', '.join(missing)}")
        return np.array([given[joint] for joint in joints])
    if len(parts) != len(joints):
        raise BadInput(f"{option}: {len(parts)} positions; the robot has {len(joints)} joints: {', '.join(joints)}")
    return np.array([finite_number(part, f"{option} {text}", "numbers [rad, m]") for part in parts])


def refuse_degrees(robot: Robot, position: np.ndarray, where: str) -> None:
    """Refuse positions (N, n) or (n,) that are radians by the rules and degrees by their size.

    Raises:
        BadInput: names what to write instead.
    """
    import numpy as np

    from energy_opt.robot.limits import look_like_degrees

    found = look_like_degrees(robot.limits, position, DEGREES, robot.slides)
    if found is not None:
        value = float(np.atleast_2d(position)[found])
        raise BadInput(
            f"{where}: {value:g} rad for {robot.joints[found[1]]} is far outside its limits: these look like degrees; "
            f"positions are radians ({value:g} deg = {np.radians(value):.4g} rad)"
        )


def move_of(
    args: argparse.Namespace, robot: Robot, duration: float | None = None, longest: float | None = None,
    ends: Ends | None = None,
) -> Move:  # fmt: skip
    """The move that --start, --goal, --path, --via and --mode describe; with `ends` its goal is still to be chosen."""
    from energy_opt.formats import read
    from energy_opt.motion import Move

    path = None
    if args.path is not None:
        if args.start is not None or args.goal is not None:
            raise BadInput("--path says where the move begins and ends; give it, or --start and --goal")
        rows = read(args.path)
        for note in rows.notes:
            say(args, note)
        rows = rows.of(robot.joints, args.joint_prefix)
        refuse_degrees(robot, rows.position, rows.where)
        path = rows.path()
        start, goal = path.start, path.goal
    elif ends is not None:
        start = goal = robot.limits.near_zero if ends.start else pose_from(args.start, robot, "--start", args.srdf)
        refuse_degrees(robot, start, "--start")
    else:
        for option in ("start", "goal"):
            if getattr(args, option) is None:
                raise BadInput(f"--{option} is missing; give --start and --goal, or --path")
        start = pose_from(args.start, robot, "--start", args.srdf)
        goal = pose_from(args.goal[-1], robot, "--goal", args.srdf)
        refuse_degrees(robot, start, "--start")
        refuse_degrees(robot, goal, "--goal")
    via = tuple(joint_vector(word, robot.joints, "--via") for word in args.via)
    move = Move(start, goal, args.mode, duration, longest, path, via)
    if path is not None and path.source is not None:
        source = path.source
        move = replace(move, start=source.position[0], goal=source.position[-1], input=source)
    return move


def settings_of(args: argparse.Namespace) -> Settings:
    """How to solve, as the options say."""
    from energy_opt.motion import Settings

    given = {"starts": args.starts, "controls": args.controls, "ways": args.ways}
    return Settings(
        **{key: value for key, value in given.items() if value is not None},
        seed=args.seed,
        compile=args.compile,
        objective=args.objective,
        solver=args.solver,
        dynamics=args.dynamics,
        verify_samples=args.verify_samples,
        end_acceleration=args.end_acceleration,
        max_power=args.max_power,
        tool_speed=args.tool_speed,
        tool_acceleration=args.tool_acceleration,
        keep=tuple(args.keep),
        tube=args.tube,
        tool=args.tool,
        deadline=args.deadline,
        allow_large=getattr(args, "allow_large", False),
    )
