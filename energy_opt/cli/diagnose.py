"""`energy-opt diagnose`: what the declared model lacks, from measured data."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from energy_opt.cli.common import add_cell, add_lock, add_output, cell_of, locks_of, payload_from, say
from energy_opt.errors import BadInput

if TYPE_CHECKING:
    from energy_opt.cell.request import CellRequest
    from energy_opt.diagnose import Diagnosis
    from energy_opt.measured import MeasuredSet
    from energy_opt.motion.trajectory import Trajectory
    from energy_opt.power import PowerModel

NEXT = "next_motion.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("set", type=Path, metavar="DIR", help="the measured set: a folder with a log.toml")
    parser.add_argument("--robot", metavar="NAME_OR_URDF", help="the robot (default: the one that log.toml names)")
    parser.add_argument(
        "--model",
        metavar="DECLARED.toml",
        help="the declared model, a file or a name (default: the set's own declared.toml, else mechanical power with "
        "standby and copper loss fitted)",
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        metavar="PERCENT",
        help="energy error within which a model is good enough to plan with (default 3)",
    )
    parser.add_argument("--limits", type=Path, metavar="FILE", help="joint limits (MoveIt's joint_limits.yaml)")
    add_lock(parser)
    parser.add_argument(
        "--payload", metavar="MASS[,CX,CY,CZ]", help="known payload [kg, m], put into the declared model"
    )
    add_cell(parser)
    add_output(parser, "diagnosis")


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.cli.interrupt import stop_on_interrupt
    from energy_opt.cli.progress import Progress
    from energy_opt.cli.view import view
    from energy_opt.diagnose import diagnose
    from energy_opt.diagnose.diagnosis import TOLERANCE
    from energy_opt.files import read_text
    from energy_opt.folders import written_whole
    from energy_opt.front.request import guard, request_of_set
    from energy_opt.measured import read_log, read_set
    from energy_opt.measured.sets import robot_of
    from energy_opt.next_motion.worth import add_worth, worth_words
    from energy_opt.passport import changes_since
    from energy_opt.robot import load_robot

    log = read_log(args.set, args.allow_outside)
    lock = locks_of(args)
    robot = load_robot(args.robot, limits=args.limits, lock=lock) if args.robot else robot_of(log, args.limits, lock)
    with Progress(args) as show:
        show.stage("reading", 0.0, 1.0)
        measured = read_set(args.set, robot, allow_outside=args.allow_outside, meter=False)
    declared, given, said = _declared(args, measured)
    if args.payload is not None:
        declared = declared.replaced(payload_from(args.payload))
    basis = {"model": declared, "payload": args.payload, "limits": args.limits}
    request = request_of_set(args.set, robot, args.seed, **basis, command=args.command)
    surroundings = cell_of(args)  # of the motion to record next
    request |= {"cell": surroundings.document()} if surroundings.document() else {}
    tolerance = TOLERANCE if args.tolerance is None else args.tolerance
    if not 0 < tolerance <= 100:
        raise BadInput(f"--tolerance {tolerance:g}: expected per cent of the energy, above 0 and at most 100")
    request |= {} if tolerance == TOLERANCE else {"tolerance": tolerance}
    guard(args.out / "diagnosis.json", request, args.force)
    with stop_on_interrupt() as stopped, Progress(args) as show:
        show.stage("searching", 0.0, 1.0)
        result = diagnose(measured, declared, args.seed, tolerance, given, stopped)
    result.document["request"] = request
    since = changes_since(declared, result.model, measured.robot) if declared.doubt is not None else []
    result.document["changes"] = [change.document() for change in since]
    if said:
        result.document["remarks"].insert(0, said)
    with stop_on_interrupt() as pressed, written_whole(args.out, "diagnosis.json") as aside:
        result.save(aside)
    if result.samples is not None and not result.document["interrupted"] and not pressed():
        motion = _next_motion(result, args.seed, surroundings)
        with stop_on_interrupt() as pressed, Progress(args) as show:
            show("what it is worth: two plans of the set's longest move")
            add_worth(result, surroundings, seed=args.seed, stopped=pressed)
            with written_whole(args.out, "diagnosis.json") as aside:
                if motion is not None:
                    from energy_opt.formats import table

                    table.write(motion, aside / NEXT)
                result.save(aside)
    worth = [worth_words(result.document["worth"])] if result.document.get("worth") else []
    say(args, "\n".join([str(result), *worth, f"written: {args.out / 'diagnosis.json'}, model.toml, report.html"]))
    for change in (x for x in since if x.real):
        say(args, f"changed since {args.model}: {change}")
    view(args, args.out)
    if args.json:
        sys.stdout.write(read_text(args.out / "diagnosis.json"))
    return 130 if result.document.get("interrupted") or pressed() else 0


def _declared(args: argparse.Namespace, measured: MeasuredSet) -> tuple[PowerModel, tuple[str, ...], str]:
    """The model to start from, its effects that are free without being news, and what to say of it."""
    import numpy as np

    from energy_opt.effects import CopperLoss, Standby
    from energy_opt.front.given import model_from
    from energy_opt.power import PowerModel, load_model, source_method_2
    from energy_opt.power.locked import of_joints

    if args.model is not None:
        return model_from(args.model, measured.robot), (), ""
    own = measured.path / "declared.toml"
    if own.is_file():
        return of_joints(load_model(own), measured.robot), (), f"No --model: starting from the set's own {own.name}."
    if not _has_meter(measured):
        return source_method_2(measured.robot), (), "No --model: standby and copper loss are source-method-2's."
    level = float(np.quantile(np.concatenate([run.power for run in measured.runs]), 0.2))
    start = PowerModel(measured.robot.name, (Standby(power=max(level, 0.0)), CopperLoss(r_over_kt2=_heat(measured))))
    said = "No --model: starting from mechanical power; standby and copper loss are fitted and not called causes."
    return start, ("standby", "copper_loss"), said


def _has_meter(measured: MeasuredSet) -> bool:
    return any(len(run.power) for run in measured.runs)


def _heat(measured: MeasuredSet) -> list[float]:
    """A usual copper loss of each joint, W/(N m)^2: two watts at three tenths of its effort limit, to start from."""
    return [2.0 / (0.3 * effort) ** 2 for effort in measured.robot.limits.effort]


def _next_motion(result: Diagnosis, seed: int, surroundings: CellRequest) -> Trajectory | None:
    """The motion to record next, where one would help; a diagnosis does not fail where none is found."""
    from energy_opt.cell.load import load_cell
    from energy_opt.diagnose.words import next_step
    from energy_opt.next_motion import propose, rivals_of

    if result.verdict not in ("ambiguous", "insufficient") or result.inference is None:
        return None
    robot, remarks = result.measured.robot, result.document["remarks"]
    try:
        cell = load_cell(robot, surroundings)
        motion = propose(rivals_of(result.inference, robot.n), robot, seed, cell)
    except KeyboardInterrupt:  # what was known before is written
        result.document["interrupted"] = True
        remarks.append("No motion to record next is proposed: the search for one was interrupted.")
        return None
    except Exception as error:  # the results are there already, whatever is wrong with bodies, meshes or limits
        logging.getLogger(__name__).debug("the search for the next motion failed", exc_info=True)
        remarks.append(f"No motion to record next is proposed: {error}.")
        return None
    if motion is None:
        remarks.append("No motion tells the alternatives apart: they are the same at the meter.")
        return None
    result.document["next_motion"] = NEXT
    result.document["next_step"] = next_step(result.document)
    more = "beyond what links, level and their own numbers can take up"
    remarks.append(f"Record {NEXT} next: over it the alternatives differ by {motion.difference:.3g} W rms {more}.")
    return motion.trajectory
