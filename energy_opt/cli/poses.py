"""Options for starts and goals that are poses of the tool, or one of several."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from energy_opt.errors import BadInput

if TYPE_CHECKING:
    from energy_opt.cell.request import CellRequest
    from energy_opt.poses.ends import Ends
    from energy_opt.robot import Robot


def add_poses(parser: argparse.ArgumentParser) -> None:
    """The options."""
    group = parser.add_argument_group("poses of the tool (--tool) in the robot's base frame")
    form = "X,Y,Z,R,P,Y or X,Y,Z,QX,QY,QZ,QW [m, rad]; OBJECT: before it, a name of the scene file, or FILE.yaml"
    group.add_argument("--start-pose", metavar="POSE", help=f"in place of --start: {form}")
    group.add_argument("--goal-pose", metavar="POSE", help="in place of --goal; the cheapest joint goal is chosen")
    group.add_argument(
        "--via-pose", action="append", default=[], metavar="POSE", help="what the tool passes (reshape; repeatable)"
    )
    group.add_argument(
        "--free", action="append", default=[], metavar="AXIS[:FROM:TO]",
        help="x, y, z, rx, ry or rz of the tool's frame that goal and via poses leave free [mm, deg] (repeatable)",
    )  # fmt: skip
    group.add_argument("--pose-tolerance", metavar="1mm,1deg", help="by how much the poses may be missed (1e-6 m, rad)")


def ends_of(args: argparse.Namespace, robot: Robot, asked: CellRequest) -> Ends | None:
    """The ends that these options describe; None where start and goal are one position each."""
    from energy_opt.cli.common import pose_from as positions_from
    from energy_opt.cli.common import refuse_degrees
    from energy_opt.poses.ends import Ends
    from energy_opt.poses.given import Given, poses_of_request

    given = args.goal or []
    if args.start_pose is None and args.goal_pose is None and not args.via_pose and len(given) < 2:
        for option in ("free", "pose_tolerance"):
            if getattr(args, option):
                raise BadInput(f"--{option.replace('_', '-')} belongs to --goal-pose")
        return None
    if args.path is not None:
        raise BadInput("--path says where the move begins and ends; give it, or poses")
    if args.start_pose is not None and args.start is not None:
        raise BadInput("--start and --start-pose are both given; give one")
    if args.free and args.goal_pose is None and not args.via_pose:
        raise BadInput("--free belongs to --goal-pose")
    if args.via_pose and args.via:
        raise BadInput("--via and --via-pose are both given; give one")
    reader = Given(None, poses_of_request(asked))
    goals: list[Any] = []
    for word in given:
        goals.append(positions_from(word, robot, "--goal", args.srdf))
        refuse_degrees(robot, goals[-1], "--goal")
    if args.goal_pose is not None:
        goals.append(reader.pose(args.goal_pose, "--goal-pose", args.free, args.pose_tolerance))
    if not goals:
        raise BadInput("--goal is missing; give --goal or --goal-pose")
    start = None
    if args.start_pose is not None:
        start = reader.pose(args.start_pose, "--start-pose", (), args.pose_tolerance)
    elif args.start is None:
        raise BadInput("--start is missing; give --start or --start-pose")
    via = tuple(reader.pose(word, "--via-pose", args.free, args.pose_tolerance) for word in args.via_pose)
    return Ends(start, tuple(goals), via).in_base(robot, asked)
