"""`energy-opt passport`: an arm's electrical passport from its models; several side by side."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from energy_opt.cli.common import add_output, say

if TYPE_CHECKING:
    from energy_opt.passport import Arm, Passport


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument(
        "models", nargs="+", metavar="MODEL",
        help="model files, or names of robots (published values where there are any); the others are compared with "
        "the first",
    )  # fmt: skip
    parser.add_argument("--robot", metavar="NAME_OR_URDF", help="the models' robot (default: the one that each names)")
    parser.add_argument("--limits", type=Path, metavar="FILE", help="joint limits (MoveIt's joint_limits.yaml)")
    add_output(parser, "passport")


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.cli.view import view
    from energy_opt.files import to_json
    from energy_opt.front.request import guard, stamp
    from energy_opt.passport import Passport, PassportRequest, passport

    made = passport(PassportRequest(tuple(args.models), args.robot, args.limits))
    states = [arm.model.to_document() for arm in made.arms]
    request = {**made.request, "contents": states, **stamp(args.command)}
    result = Passport(made.arms, made.changes, request)
    guard(args.out / "passport.json", request, args.force)
    result.save(args.out)
    say(args, _text(result) + f"\nwritten: {args.out}")
    view(args, args.out)
    if args.json:
        sys.stdout.write(to_json(result.document()))
    return 0


def _text(result: Passport) -> str:
    lines = [result.headline]
    for arm in result.arms:
        lines += _arm(arm)
    real = [change for change in result.changes if change.real]
    lines += [f"changed: {change}" for change in real]
    if len(real) < len(result.changes):
        lines.append(f"{len(result.changes) - len(real)} other quantities are in report.html")
    return "\n".join(lines)


def _arm(arm: Arm) -> list[str]:
    shares = "friction at 1, 10, 50 and 100 % of the velocity limit [N m]"
    lines = [f"{arm.label} ({arm.robot.name})", f"  {'joint':<24}{'R/Kt² [W/(N m)²]':>20}   {shares}"]
    for j, joint in enumerate(arm.robot.joints):
        heat = arm.number("copper_loss", "r_over_kt2", j)
        rubs = [arm.friction_at(j, k).value for k in range(arm.speeds.shape[1])]
        words = " / ".join(f"{x:.3g}" for x in rubs if x is not None) or "unknown"
        lines.append(f"  {joint:<24}{'unknown' if heat.value is None else f'{heat.value:.4g}':>20}   {words}")
    return lines
