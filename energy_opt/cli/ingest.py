"""`energy-opt import`: logs as labs have them to a measured set; guesses columns and units, asks nothing."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from energy_opt.cli.common import add_lock, locks_of, say
from energy_opt.errors import BadInput


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="tables of joints and of meters, or bags, any order"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="SET", help="folder of the measured set")
    parser.add_argument("--robot", metavar="NAME_OR_URDF", help="the robot (default: found by columns and torques)")
    add_lock(parser)
    group = parser.add_argument_group("columns named by hand (default: found by their headers)")
    group.add_argument("--time", metavar="COLUMN[:UNIT]", help="the stamps")
    group.add_argument("--power", metavar="COLUMN[:UNIT]", help="the whole robot's power; VOLTAGE*CURRENT is a product")
    group.add_argument(
        "--joint", action="append", default=[], metavar="JOINT=COLUMN[:UNIT]", help="a joint's position (repeatable)"
    )
    parser.add_argument("--force", action="store_true", help="replace a set that is there already")
    parser.add_argument("--json", action="store_true", help="what was made as one JSON document on stdout")
    parser.add_argument("--quiet", action="store_true", help="no messages")


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.cli.progress import Progress
    from energy_opt.files import to_json
    from energy_opt.measured.by_hand import ByHand
    from energy_opt.measured.importing import import_files
    from energy_opt.robot import load_robot

    lock = locks_of(args)
    if lock and not args.robot:
        raise BadInput("--lock needs --robot: the robot that is found by its columns has no other joints")
    robot = load_robot(args.robot, lock=lock) if args.robot else None
    pairs = [word.partition("=") for word in args.joint]
    if not all(joint and sign and column for joint, sign, column in pairs):
        raise BadInput(f"--joint {args.joint[[bool(a and b and c) for a, b, c in pairs].index(False)]}: JOINT=COLUMN")
    hand = ByHand(args.time, args.power, {joint: column for joint, _, column in pairs})
    with tempfile.TemporaryDirectory(prefix="energy-opt-") as folder:
        files = _unpacked(args, Path(folder))
        with Progress(args) as show:
            show("columns, clocks and robot of each file")
            made = import_files(files, args.out, robot, args.force, hand)
    motions = sum(run.kind == "motion" for run in made.runs)
    readings = sum(len(run.power) for run in made.runs)
    what = f"{len(made.runs)} run(s), {motions} of them motions, {readings} readings of power"
    say(args, "\n".join([*made.words, *(f"note: {remark}" for remark in made.remarks), f"written: {args.out}: {what}"]))
    if args.json:
        document = {
            "set": args.out, "robot": made.robot.name, "log": made.log, "guesses": made.words, "remarks": made.remarks,
            "runs": [
                {"file": r.file, "kind": r.kind, "rows": len(r.time), "readings": len(r.power), "meter": r.meter}
                for r in made.runs
            ],
        }  # fmt: skip
        sys.stdout.write(to_json(document))
    return 0


def _unpacked(args: argparse.Namespace, folder: Path) -> list[Path]:
    """The files, each bag among them as its table of joints and its table of power."""
    from energy_opt.formats.bags import is_bag
    from energy_opt.formats.recordings import unpack

    out: list[Path] = []
    for file in args.files:
        if is_bag(file):
            tables, notes = unpack(file, folder)
            out += tables
            say(args, "\n".join(notes))
        else:
            out.append(file)
    return out
