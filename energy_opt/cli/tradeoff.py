"""`energy-opt tradeoff`: energy against duration for one move, and over a fixed cycle."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from energy_opt.cli.common import (
    add_cell,
    add_common,
    add_move,
    cell_of,
    load_robot_of,
    move_of,
    rivals_of,
    say,
    settings_of,
)
from energy_opt.cli.job_front import run_job_front
from energy_opt.cli.per_year import add_per_year, per_year_from
from energy_opt.cli.poses import add_poses, ends_of
from energy_opt.errors import BadInput

if TYPE_CHECKING:
    from energy_opt.tradeoff import Front

MOST = 1000  # durations of a front, each a solve or more: some minutes
EXITS = {"solved": 0, "infeasible": 3, "not_converged": 4, "interrupted": 130}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("job", nargs="?", type=Path, metavar="JOB.toml", help="a job over its cycle time, not one move")
    add_common(parser, "energy_opt_tradeoff", alone=False)
    add_move(parser)
    add_poses(parser)
    add_cell(parser)
    add_per_year(parser)
    group = parser.add_argument_group("durations")
    group.add_argument("--durations", metavar="FIRST:LAST:COUNT", help="where [s] (default: 20, chosen by the program)")
    group.add_argument("--duration", type=float, metavar="T", help="only this duration [s]")
    group.add_argument("--max-duration", type=float, metavar="T", help="the front ends here [s]")
    group.add_argument("--cycle", type=float, metavar="T", help="also the energy over a cycle of T s, waiting included")
    group.add_argument("--idle-power", type=float, metavar="W", help="overhead while waiting, instead of standby [W]")


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.cell.load import load_cell
    from energy_opt.cli.interrupt import stop_on_interrupt
    from energy_opt.cli.progress import Progress
    from energy_opt.cli.view import view
    from energy_opt.files import read_text
    from energy_opt.front.request import guard, request_of_move
    from energy_opt.front.rivals import robust_of
    from energy_opt.front.tradeoff import chosen_for, cycle_for, document_of, mean_of, planner_for, traced
    from energy_opt.power.assumptions import Assumption, said
    from energy_opt.tradeoff.output import text, write

    if args.objective != "energy":
        raise BadInput(f"--objective {args.objective}: a front of energy minimises energy; leave it out")
    durations, worth = _durations(args), per_year_from(args)
    if args.job is not None:
        return run_job_front(args, durations)
    if args.robot is None:
        raise BadInput("--robot is missing: a name (`energy-opt robots`) or a URDF; or give a JOB.toml")
    robot = load_robot_of(args)
    rivals, kind = rivals_of(args, robot)
    ends = ends_of(args, robot, cell_of(args))
    move = move_of(args, robot, ends=ends)
    for warning in robot.warnings:
        say(args, f"warning: {warning}")
    named = {"path": args.path, "limits": args.limits, "scene": args.scene}
    named["cell"] = cell_of(args).document()
    over: dict[str, Any] = {
        "durations": durations,
        "longest": args.max_duration,
        "cycle": args.cycle,
        "idle_power": args.idle_power,
    }
    over |= {"robust": robust_of(rivals, kind)}
    over |= {} if worth is None else {"per_year": worth.document()}
    settings = settings_of(args)
    request = request_of_move(robot, rivals[0].model, move, settings, **named, command=args.command, **over)
    request = request if ends is None else ends.asked(request)
    guard(args.out / "tradeoff.json", request, args.force)

    with stop_on_interrupt() as stopped, Progress(args) as show:

        def progress(front: Front, expected: int) -> None:
            show(f"{front.solves}/{expected} solves", front.solves / expected)

        planner = planner_for(robot, rivals, kind, settings, cell=load_cell(robot, cell_of(args)), stopped=stopped)
        goals: dict[str, Any] = {}
        if ends is not None:
            move, goals = chosen_for(planner, ends, move, rivals, settings)
        cycle = cycle_for(robot, rivals[0].model, move, args.cycle, args.idle_power)
        front = traced(
            planner,
            move,
            cycle,
            durations=durations,
            longest=args.max_duration,
            progress=progress,
            stopped=stopped,
        )
        found = {**document_of(planner, rivals, move, front, cycle, request, worth), **goals}
        write(args.out, front, found, robot, mean_of(planner).cell)
    if line := said([Assumption(**row) for row in found["assumptions"]]):
        say(args, line)
    for warning in found["warnings"]:
        say(args, f"warning: {warning}")
    view(args, args.out)
    if args.json:
        sys.stdout.write(read_text(args.out / "tradeoff.json"))
    elif not args.quiet:
        sys.stdout.write(text(front, found, args.out))
    if "message" in found:
        say(args, found["message"])
    return EXITS[front.status]


def _durations(args: argparse.Namespace) -> list[float] | None:
    """Durations [s] that --durations or --duration ask for, None where the program chooses."""
    import numpy as np

    if args.durations is None:
        if args.duration is None:
            return None
        if not 0 < args.duration < np.inf:
            raise BadInput(f"--duration {args.duration:g}: expected seconds above 0")
        return [args.duration]
    for name in ("duration", "max_duration"):
        if getattr(args, name) is not None:
            raise BadInput(f"--durations says which; leave --{name.replace('_', '-')} out")
    parts = args.durations.split(":")
    try:
        first, last, count = float(parts[0]), float(parts[1]), int(parts[2])
        if len(parts) != 3 or not 0 < first <= last < np.inf or count < 1 or (count == 1 and first != last):
            raise ValueError
    except (ValueError, IndexError):
        raise BadInput(
            f"--durations {args.durations}: expected FIRST:LAST:COUNT, seconds above 0 in rising order and how many"
        ) from None
    if count > MOST and not args.allow_large:
        raise BadInput(f"--durations {args.durations}: expected at most {MOST} durations, or --allow-large")
    return [float(d) for d in np.linspace(first, last, count)]
