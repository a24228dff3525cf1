"""`energy-opt optimize`: one move to minimum energy, judged, with a table, a picture and files that others read."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

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
from energy_opt.cli.controllers import add_controllers, check_controllers, moves_of, with_room_of, write_controllers
from energy_opt.cli.per_year import add_per_year, per_year_from
from energy_opt.cli.poses import add_poses, ends_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    add_common(parser, "energy_opt_out")
    add_move(parser)
    add_poses(parser)
    group = parser.add_argument_group("duration (default: free)")
    group.add_argument("--duration", type=float, metavar="T", help="exactly this long [s]")
    group.add_argument("--max-duration", type=float, metavar="T", help="at most this long [s]")
    add_cell(parser)
    parser.add_argument_group("several models").add_argument(
        "--robust",
        metavar="KIND",
        help="mean or worst energy over several --model, or one's draws and rivals (without --model: mean)",
    )
    add_controllers(parser)
    add_per_year(parser)


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.cell.load import load_cell
    from energy_opt.cli.interrupt import stop_on_interrupt
    from energy_opt.cli.progress import Progress
    from energy_opt.cli.view import view
    from energy_opt.errors import Infeasible
    from energy_opt.files import read_text, write_json
    from energy_opt.folders import written_whole
    from energy_opt.front.answer import answer_of
    from energy_opt.front.goals import with_goals
    from energy_opt.front.input_time import at_input_time, solved
    from energy_opt.front.output import put, table
    from energy_opt.front.request import guard, request_of_move
    from energy_opt.front.rivals import compared, members, robust_of
    from energy_opt.motion import Planner
    from energy_opt.motion.plan.robust import RobustPlanner
    from energy_opt.poses.solve import solve_to
    from energy_opt.power.assumptions import said

    worth = per_year_from(args)
    robot = load_robot_of(args)
    check_controllers(args, robot.n)
    rivals, kind = rivals_of(args, robot)
    model = rivals[0].model
    asked = cell_of(args)
    ends = ends_of(args, robot, asked)
    given = move_of(args, robot, args.duration, args.max_duration, ends)
    named = {"path": args.path, "limits": args.limits, "scene": args.scene, "cell": asked.document()}
    standard = None if args.as_ is None else {"as": args.as_, "vias": args.vias or 0}
    settings = settings_of(args)
    move = at_input_time(given, settings.objective)
    named |= {} if worth is None else {"per_year": worth.document()}
    named |= {"standard": standard, "robust": robust_of(rivals, kind)}
    request = request_of_move(robot, model, move, settings, **named, command=args.command)
    request = request if ends is None else ends.asked(request)
    guard(args.out / "result.json", request, args.force)
    with stop_on_interrupt() as stopped, Progress(args):
        cell = load_cell(robot, asked)
        planner = Planner(robot, model, settings, cell=cell, stopped=stopped)
        robust = None if kind is None else RobustPlanner(robot, rivals, kind, settings, cell=cell, stopped=stopped)
        try:
            solve, chosen = (planner if robust is None else robust).solve, None
            if ends is None:
                found, move = solved(solve, move, given)
            else:
                chosen = solve_to(ends, move, robot, members(rivals), cell, settings, solve, kind == "worst")
                found, move = chosen.result, chosen.move
            found, moves = with_room_of(args, planner, robust, move, *moves_of(args, planner, robust, move, found))
            result = answer_of(compared(found, rivals, robot), robot, request, cell, worth)
            if ends is not None and chosen is not None:
                result = with_goals(result, chosen, ends.poses, settings)
        except Infeasible as error:
            error.about = {
                "robot": robot.name,
                "joints": list(robot.joints),
                "mode": move.mode,
                "duration": move.duration,
                "request": request,
            }
            with written_whole(args.out, "result.json") as aside:
                write_json(aside / "result.json", error.document())
            raise
        with written_whole(args.out, "result.json") as aside:
            rows = write_controllers(args, planner, move, result, moves, aside)
            result = replace(result, written=tuple(row.document() for row in rows))
            put(result, robot, result.document(), aside, cell)
    if line := said(result.assumptions):
        say(args, line)
    for warning in result.warnings:
        say(args, f"warning: {warning}")
    if result.message:
        say(args, f"{result.status}: {result.message}")
    view(args, args.out)
    if args.json:
        sys.stdout.write(read_text(args.out / "result.json"))
    elif not args.quiet:
        print(table(result, args.out, robot, result.year))
    if result.interrupted:
        return 130
    return 0 if result.status == "solved" and all(row.valid for row in rows) else 4
