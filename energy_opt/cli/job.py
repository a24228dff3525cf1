"""`energy-opt job`: a cycle of moves and waits, the time of the cycle distributed for least energy."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
from energy_opt.cli.controllers import add_written, check_rate_of, check_written
from energy_opt.cli.per_year import add_per_year, per_year_from
from energy_opt.errors import Infeasible

if TYPE_CHECKING:
    from energy_opt.power import PowerModel
    from energy_opt.robot import Robot

WORKCELL = "energy-opt/job/2"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("job", type=Path, metavar="JOB.toml", help="the cycle (`energy-opt --example job`)")
    group = parser.add_argument_group("robot and model")
    group.add_argument("--robot", metavar="NAME_OR_URDF", help="in place of the job's own")
    group.add_argument("--limits", type=Path, metavar="FILE", help="joint limits (MoveIt's joint_limits.yaml)")
    add_lock(group)
    group.add_argument(
        "--payload", metavar="MASS[,CX,CY,CZ]",
        help="point mass [kg] in the last joint's frame [m], until a step says another (the job's, else the model's)",
    )  # fmt: skip
    add_model(group)
    add_prefix(group)
    group = parser.add_argument_group("solving")
    group.add_argument(
        "--deadline", type=float, metavar="S", help="end the search of each motion after S seconds (never)"
    )
    group.add_argument("--starts", type=int, metavar="N", help="starting points of a reshaping at most (24)")
    group.add_argument("--compile", default="auto", metavar="WHEN", help="auto, always or never (auto)")
    group.add_argument("--resume", action="store_true", help="take the answers that an earlier run into --out left")
    add_cell(parser)
    add_written(parser)
    add_output(parser, "energy_opt_job")
    add_per_year(parser)


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.cli.interrupt import stop_on_interrupt
    from energy_opt.cli.progress import Progress
    from energy_opt.cli.view import view
    from energy_opt.files import read_text, read_toml, write_json
    from energy_opt.folders import written_whole
    from energy_opt.formats.room import Files
    from energy_opt.front.request import guard, request_of_job
    from energy_opt.front.rivals import robust_of, said, with_careful
    from energy_opt.job import load_job, run_job, run_posed
    from energy_opt.job.models import compared, mean_of, stated
    from energy_opt.job.output import write
    from energy_opt.job.program import with_room, write_programs
    from energy_opt.job.resume import Answers
    from energy_opt.motion import Settings
    from energy_opt.poses.given import poses_of_request
    from energy_opt.power.assumptions import assumptions
    from energy_opt.power.assumptions import said as assumed

    if read_toml(args.job).get("format") == WORKCELL:
        return _run_workcell(args)
    worth = per_year_from(args)
    cell = cell_of(args)
    more: dict[str, Any] = {"allow_outside": args.allow_outside, "named": poses_of_request(cell)}
    job = load_job(args.job, lambda name: _robot(args, name), **more)
    rivals, kind = rivals_of(args, job.robot)
    model = rivals[0].model
    held = model.get("payload")
    if held is not None and (args.payload is not None or "payload" not in read_toml(args.job)):
        mass, (x, y, z) = float(held.values["mass"][0]), held.values["com"].tolist()
        job = load_job(args.job, lambda _: job.robot, **more, payload=(mass, x, y, z))
    formats = check_written(args, job.robot.n)
    given = {"seed": args.seed, "compile": args.compile}
    settings = Settings(**given, **({} if args.starts is None else {"starts": args.starts}), deadline=args.deadline)
    limits = vars(job.robot.limits)
    named: dict[str, Any] = {"limits": args.limits, "cell": cell.document()}
    named |= {"robust": robust_of(rivals, kind)}
    named |= {} if worth is None else {"per_year": worth.document()}
    request = request_of_job(args.job, job.robot, model, settings, **named, command=args.command)
    guard(args.out / "job.json", request, args.force)
    about = [*(rival.model.to_document() for rival in rivals), job.robot.name, limits, vars(settings), cell.document()]
    answers = Answers(args.out, job.robot.joints, about, args.resume)
    with stop_on_interrupt() as stopped, Progress(args) as progress:
        usual: dict[str, Any] = {"cell": cell, "stopped": stopped, "progress": progress}
        try:
            result = first = run_posed(
                job, mean_of(rivals), settings, known=answers.known, answered=answers.keep, **usual
            )
            again = partial(run_job, first.job, mean_of(rivals), settings, **usual)
            result = with_room(
                result, Files(formats, args.rate), lambda shares: replace(again(room=shares), choice=first.choice),
            )  # fmt: skip
        except Infeasible as error:
            error.about = {"robot": job.robot.name, "cycle_time": job.cycle_time, "request": request}
            with written_whole(args.out, "job.json") as aside:
                write_json(aside / "job.json", error.document())
            raise
        if kind is None:
            result = compared(result, with_careful(rivals, job.robot))
            result = replace(result, warnings=(*result.warnings, *said(result.models, "the cycle")))
        else:
            result = stated(result, rivals)
        result = replace(result, assumptions=assumptions(job.robot, [rival.model for rival in rivals]))
        with written_whole(args.out, "job.json") as aside:
            rows = write_programs(result, formats, aside, args.rate, args.joint_prefix)
            found = write(result, request, aside, worth, rows)
    for row in rows:
        say(args, f"{args.out / row.file}: {row}")
    if result.solved:
        answers.forget()
    if line := assumed(result.assumptions):
        say(args, line)
    for warning in found["warnings"]:
        say(args, f"warning: {warning}")
    view(args, args.out)
    if args.json:
        sys.stdout.write(read_text(args.out / "job.json"))
    elif not args.quiet:
        print(_text(found, args.out))
    if result.interrupted:
        return 130
    return 0 if result.solved and all(row["valid"] for row in found["written"]) else 4


def _run_workcell(args: argparse.Namespace) -> int:
    from energy_opt.cli.interrupt import stop_on_interrupt
    from energy_opt.cli.progress import Progress
    from energy_opt.cli.view import view
    from energy_opt.files import read_toml, to_json
    from energy_opt.folders import written_whole
    from energy_opt.front.request import guard, stamp
    from energy_opt.front.rivals import rivals_from
    from energy_opt.job.models import mean_of
    from energy_opt.motion import Settings
    from energy_opt.robot import load_robot
    from energy_opt.workcell.file import load_workcell
    from energy_opt.workcell.output import write
    from energy_opt.workcell.program import formats_of, write_programs
    from energy_opt.workcell.run import run_workcell

    cell = load_workcell(args.job)
    given = args.model[0] if args.model else None

    def model_of(name: str | None, robot: Robot) -> PowerModel:
        beside = None if name is None else args.job.parent / name
        named = given or (beside if beside is not None and beside.is_file() else name)
        return mean_of(rivals_from([] if named is None else [named], None, robot)[0])

    check_rate_of(args)
    formats = formats_of(cell, args.write, args.job, load_robot, args.allow_outside)
    worth = per_year_from(args)
    request = {"job": read_toml(args.job), **stamp(args.command)}
    request |= {} if worth is None else {"per_year": worth.document()}
    guard(args.out / "job.json", request, args.force)
    settings = Settings(
        seed=args.seed,
        compile=args.compile,
        **({} if args.starts is None else {"starts": args.starts}),
        deadline=args.deadline,
    )
    with stop_on_interrupt() as stopped, Progress(args) as progress:
        result = run_workcell(
            cell, args.job, load=load_robot, model_of=model_of, settings=settings, request=cell_of(args),
            stopped=stopped, progress=progress,
        )  # fmt: skip
        with written_whole(args.out, "job.json") as aside:
            rows = write_programs(result, formats, aside, args.rate, args.joint_prefix)
            found = write(result, request, aside, worth, rows)
    for row in rows:
        if row.written.format != "csv" or not row.written.valid:
            say(args, f"{args.out / row.written.file}: {row.written}; begins at {row.start:.3f} s of the cell's cycle")
    for warning in found["warnings"]:
        say(args, f"warning: {warning}")
    view(args, args.out)
    if args.json:
        sys.stdout.write(to_json(found))
    elif not args.quiet:
        print(_text_of_workcell(found, args.out))
    if result.interrupted:
        return 130
    return 0 if result.solved and all(row.written.valid for row in rows) else 4


def _text_of_workcell(found: dict[str, Any], out: Path) -> str:
    lines = [f"{'robot':<14} {'step':<28} {'begins [s]':>10} {'takes [s]':>10} {'mode':<16} {'energy [J]':>12}"]
    for robot in found["robots"]:
        lines += [
            f"{robot['name'][:14]:<14} {s['name'][:28]:<28} {s['start']:>10.3f} {s['duration']:>10.3f} "
            f"{(s['mode'] or 'moves')[:16]:<16} {s['energy_total']:>12.1f}"
            for s in robot["steps"]
        ]
    bound = "" if found["bound"] is None else f"; no schedule of these curves takes less than {found['bound']:.1f} J"
    lines.append(f"the cycle of {found['cycle_time']:g} s takes {found['energy_total']:.1f} J{bound}")
    first = found["levers"][0]["energy_total"]
    for lever in found["levers"]:
        saved = 100 * (1 - lever["energy_total"] / first)
        lines.append(f"{lever['name'].replace('_', ' '):<8} {lever['energy_total']:>12.1f} J ({saved:.1f} % saved)")
    lines += _year(found)
    return "\n".join([*lines, f"files in {out}"])


def _year(found: dict[str, Any]) -> list[str]:
    """What the saving is worth in a year, where that was asked for."""
    from energy_opt.power.per_year import per_year_words

    return (
        [per_year_words(found["per_year"], found["request"]["per_year"]["cycles_per_year"])]
        if "per_year" in found
        else []
    )


def _robot(args: argparse.Namespace, name: str) -> Robot:
    args.robot = args.robot or name
    return load_robot_of(args)


def _text(found: dict[str, Any], out: Path) -> str:
    lines = [f"{'step':<24} {'begins [s]':>10} {'takes [s]':>10} {'energy [J]':>11} {'kg':>5}"]
    for row in found["steps"]:
        lines.append(
            f"{row['name'][:24]:<24} {row['start']:>10.3f} {row['duration']:>10.3f} {row['energy_total']:>11.3f} "
            f"{row['payload']:>5.2g}"
        )
    lines.append(f"in a {found['cycle_time']:g} s cycle: this plan {found['energy_total']:.3f} J")
    for row in found["baselines"]:
        name = row["name"].replace("_", " ")
        if row["energy_total"] is None:
            lines.append(f"  {name}: not possible within the limits")
        else:
            saved = 100 * (1 - found["energy_total"] / row["energy_total"])
            lines.append(f"  {name} {row['energy_total']:.3f} J (this plan saves {saved:.2f} %)")
    lines += _year(found)
    if found["optimality"]["lower_bound"] is not None:
        lines.append(
            f"no timing of these paths takes less than {found['optimality']['lower_bound']:.3f} J "
            f"(gap {found['optimality']['gap_percent']:.2g} %)"
        )
    lines.append(f"files in {out}")
    return "\n".join(lines)
