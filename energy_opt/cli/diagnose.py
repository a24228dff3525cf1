"""`energy-opt diagnose`: what the declared model lacks, from measured data."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from energy_opt.cli.common import add_output, payload_from, say

if TYPE_CHECKING:
    from energy_opt.diagnose import Diagnosis
    from energy_opt.measured import MeasuredSet
    from energy_opt.power import PowerModel

HELP = "trace the residual of measured power to the effect that the model lacks"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("set", type=Path, metavar="DIR", help="the measured set: a folder with a log.toml")
    parser.add_argument("--robot", metavar="NAME_OR_URDF", help="the robot (default: the one that log.toml names)")
    parser.add_argument(
        "--model",
        type=Path,
        metavar="DECLARED.toml",
        help="the declared model (default: mechanical power and the set's own mean power at standstill)",
    )
    parser.add_argument("--limits", type=Path, metavar="FILE", help="joint limits (MoveIt's joint_limits.yaml)")
    parser.add_argument(
        "--payload", metavar="MASS[,CX,CY,CZ]", help="known payload [kg, m], put into the declared model"
    )
    parser.add_argument("--allow-outside", action="store_true", help="the set's files may lie outside its folder")
    add_output(parser, "diagnosis")


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.cli.progress import Progress
    from energy_opt.cli.view import view
    from energy_opt.diagnose import diagnose, write
    from energy_opt.files import to_json
    from energy_opt.folders import written_whole
    from energy_opt.front.request import guard, request_of_set
    from energy_opt.measured import read_log, read_set
    from energy_opt.measured.sets import robot_of
    from energy_opt.power import load_model
    from energy_opt.robot import load_robot

    log = read_log(args.set, args.allow_outside)
    robot = load_robot(args.robot, limits=args.limits) if args.robot else robot_of(log, args.limits)
    measured = read_set(args.set, robot, allow_outside=args.allow_outside)
    for remark in measured.remarks:
        say(args, f"note: {remark}")
    declared = load_model(args.model) if args.model else _level(measured, args.seed)
    if args.payload:
        declared = declared.replaced(payload_from(args.payload))
    given = {"model": declared, "payload": args.payload, "limits": args.limits}
    request = request_of_set(args.set, robot, args.seed, **given, command=args.command)
    guard(args.out / "diagnosis.json", request, args.force)
    with Progress(args):
        result = diagnose(measured, declared, args.seed)
    result.document["request"] = request
    with written_whole(args.out, "diagnosis.json") as aside:
        if result.document["verdict"] in ("ambiguous", "insufficient"):
            _next_motion(result, aside, args.seed)
        write(result, aside)
    say(args, _summary(result, args.out))
    view(args, args.out)
    if args.json:
        sys.stdout.write(to_json(result.document))
    return 0


def _level(measured: MeasuredSet, seed: int) -> PowerModel:
    """Mechanical power and the mean power while every joint stands still in the training runs."""
    from energy_opt.diagnose.samples import take_samples
    from energy_opt.diagnose.split import split
    from energy_opt.effects import Standby
    from energy_opt.errors import BadInput
    from energy_opt.power import PowerModel

    samples, _ = take_samples(measured)
    samples = samples.part(split(samples, seed)[0])
    still = (samples.v == 0).all(axis=1)
    if not still.any():
        raise BadInput(f"{measured.path}: the arm never stands still, so its static power is unknown; give --model")
    return PowerModel(measured.robot.name, (Standby(power=float(samples.power[still].mean())),))


def _next_motion(result: Diagnosis, out: Path, seed: int) -> None:
    from energy_opt.errors import Infeasible
    from energy_opt.formats import table
    from energy_opt.next_motion import propose, rivals_of

    robot, remarks = result.measured.robot, result.document["remarks"]
    try:
        motion = propose(rivals_of(result.trace, robot.n), robot, seed)
    except Infeasible as error:
        remarks.append(f"No motion to record next is proposed: {error}.")
        return
    if motion is None:
        remarks.append("No motion tells the alternatives apart: they are the same at the meter.")
        return
    name = "next_motion.csv"
    table.write(motion.trajectory, out / name)
    result.document["next_motion"] = name
    remarks.append(f"Record {name} next: over it the rivals differ by {motion.difference:.3g} W rms.")


def _summary(result: Diagnosis, out: Path) -> str:
    d = result.document
    lines = [f"verdict: {d['verdict']}"]
    for row in d["effects"]:
        refit = " (declared value fitted anew)" if row["refit"] else ""
        lines.append(
            f"  {row['name']}{refit}: share of residual {row['share_of_residual']:.2f}, p = {row['p_value']:.3g}"
        )
    if d["alternatives"]:
        lines.append("  fit equally well: " + " | ".join(" + ".join(names) or "nothing" for names in d["alternatives"]))
    for row in d["residual_goes_with"][:3]:
        lines.append(f"  what is left goes with {row['signal']} {row['joint'] or ''}: {row['strength']:.2f}")
    for part in ("train", "holdout"):
        before, after = d["error"]["before"][part], d["error"]["after"][part]
        if before is not None and after is not None:
            lines.append(
                f"{part}: power RMSE {before['power_rmse']:.2f} -> {after['power_rmse']:.2f} W, energy error "
                f"{before['energy_percent']:.2f} -> {after['energy_percent']:.2f} %"
            )
    lines.append(f"noise floor: {d['error']['noise_floor']:.2f} W")
    lines += [f"note: {remark}" for remark in d["remarks"]]
    lines.append(f"written: {out / 'diagnosis.json'}, model.toml, report.html")
    return "\n".join(lines)
