"""`energy-opt place`: the base pose that makes a job cheapest."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from energy_opt.cli.common import (
    add_cell,
    add_lock,
    add_model,
    add_output,
    add_prefix,
    cell_of,
    load_robot_of,
    rivals_of,
    say,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("job", type=Path, metavar="JOB.toml", help="a cycle with steps that end at poses of the tool")
    parser.add_argument(
        "--base-box", required=True, metavar="X0,X1,Y0,Y1,Z0,Z1[,yaw]",
        help="where the base may stand in the scene's frame [m]; `yaw`: turned as it likes, YAW0,YAW1: within [rad]",
    )  # fmt: skip
    group = parser.add_argument_group("robot and model")
    group.add_argument("--robot", metavar="NAME_OR_URDF", help="in place of the job's own")
    group.add_argument("--limits", type=Path, metavar="FILE", help="joint limits (MoveIt's joint_limits.yaml)")
    group.add_argument("--payload", metavar="MASS[,CX,CY,CZ]", help=argparse.SUPPRESS)
    add_lock(group)
    add_model(group)
    add_prefix(group)
    group = parser.add_argument_group("search")
    group.add_argument("--looked-at", type=int, default=120, metavar="N", help="placements that are estimated (120)")
    group.add_argument("--seeds", type=int, default=3, metavar="N", help="the best of them that are solved (3)")
    group.add_argument("--steps", type=int, default=4, metavar="N", help="solves on the way from the best (4)")
    group.add_argument("--starts", type=int, metavar="N", help="starting points of a reshaping at most (24)")
    group.add_argument("--compile", default="auto", metavar="WHEN", help="auto, always or never (auto)")
    add_cell(parser)
    add_output(parser, "energy_opt_place")


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.cli.interrupt import stop_on_interrupt
    from energy_opt.cli.progress import Progress
    from energy_opt.cli.view import view
    from energy_opt.errors import BadInput, Infeasible
    from energy_opt.files import read_text, write_json
    from energy_opt.folders import written_whole
    from energy_opt.front.request import guard, request_of_job
    from energy_opt.front.rivals import robust_of
    from energy_opt.job import load_job
    from energy_opt.job.models import mean_of
    from energy_opt.motion import Settings
    from energy_opt.place import PlaceRequest, place
    from energy_opt.place.output import headline, write
    from energy_opt.poses.given import poses_of_request

    if args.payload is not None:
        raise BadInput("--payload: the job says what is carried (`payload`)")
    counts = {"looked_at": args.looked_at, "seeds": args.seeds, "steps": args.steps}
    asked, cell = PlaceRequest.of(args.base_box, **counts), cell_of(args)
    named = poses_of_request(cell)
    job = load_job(args.job, lambda n: load_robot_of(args, n), allow_outside=args.allow_outside, named=named)
    rivals, kind = rivals_of(args, job.robot)
    given: dict[str, Any] = {} if args.starts is None else {"starts": args.starts}
    settings = Settings(seed=args.seed, compile=args.compile, **given)
    more = {
        "limits": args.limits,
        "cell": cell.document(),
        "place": asked.document(),
        "robust": robust_of(rivals, kind),
    }
    request = request_of_job(args.job, job.robot, rivals[0].model, settings, **more, command=args.command)
    guard(args.out / "place.json", request, args.force)
    with stop_on_interrupt() as stopped, Progress(args) as progress:
        try:
            found = place(
                job, mean_of(rivals), asked, settings=settings, cell=cell, stopped=stopped, progress=progress
            )  # fmt: skip
        except Infeasible as error:
            error.about = {"robot": job.robot.name, "request": request}
            with written_whole(args.out, "place.json") as aside:
                write_json(aside / "place.json", error.document())
            raise
        with written_whole(args.out, "place.json") as aside:
            document = write(found, request, aside)
        interrupted = stopped()
    for warning in document["warnings"]:
        say(args, f"warning: {warning}")
    view(args, args.out)
    if args.json:
        sys.stdout.write(read_text(args.out / "place.json"))
    elif not args.quiet:
        print(f"{headline(document)}\nfiles in {args.out}")
    if interrupted:
        return 130
    return 0 if found.solved else 4
