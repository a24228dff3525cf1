"""`energy-opt evaluate`: motions as they are: energy under models, limits, clearance, baselines; in other formats."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from energy_opt.cli.common import (
    add_cell,
    add_lock,
    add_model,
    add_output,
    add_prefix,
    cell_of,
    load_robot_of,
    payload_from,
    say,
)  # fmt: skip
from energy_opt.cli.controllers import add_written, check_written


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE",
        help="a trajectory, program, bag or recording; or a result of optimize or job (folder, JSON or table), with "
        "its payloads and brakes",
    )  # fmt: skip
    group = parser.add_argument_group("robot and model")
    group.add_argument("--robot", metavar="NAME_OR_URDF", help="default: the one that the files name or have")
    group.add_argument("--limits", type=Path, metavar="FILE", help="joint limits (MoveIt's joint_limits.yaml)")
    add_lock(group)
    group.add_argument(
        "--payload", metavar="MASS[,CX,CY,CZ]", help="carried all the time [kg, m], whatever the files say"
    )
    add_model(group, "source-method-2 and careful")
    add_prefix(group)
    add_cell(parser)
    add_written(parser)
    add_output(parser, "energy_opt_evaluation", report=False)


def run(args: argparse.Namespace) -> int:
    """Run the verb; 0 where all motions keep their limits and all files hold, else 3 or 4."""
    from energy_opt.evaluate.output import ANSWER, table, write
    from energy_opt.files import to_json
    from energy_opt.front.evaluating import EvaluateRequest, answered, robot_of
    from energy_opt.front.request import guard

    robot = load_robot_of(args, "" if args.robot else robot_of(args.files, args.joint_prefix))
    formats = check_written(args, robot.n)
    payload = None if args.payload is None else payload_from(args.payload)
    asked = EvaluateRequest(
        tuple(args.files), None, tuple(args.model), payload, args.limits, cell_of(args), args.joint_prefix
    )
    answers = answered(asked, args.command, robot)
    if payload is not None:
        answers.request["payload"] = {name: values.tolist() for name, values in payload.values.items()}
    guard(args.out / ANSWER, answers.request, args.force)
    found, rows = write(robot, answers.found, answers.request, args.out, formats, args.rate, args.joint_prefix)
    for evaluation in answers.found:
        for note in evaluation.motion.notes:
            say(args, f"note: {note}")
    for row in rows:
        say(args, f"{args.out / row.file}: {row}")
    if args.json:
        sys.stdout.write(to_json(found))
    elif not args.quiet:
        print(table(answers.found))
    return 0 if all(row.valid for row in rows) else 4
