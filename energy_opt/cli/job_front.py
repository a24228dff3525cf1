"""`energy-opt tradeoff JOB.toml`: energy of a job over its cycle time."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from energy_opt.cli.common import cell_of, load_robot_of, rivals_of, say, settings_of
from energy_opt.cli.per_year import per_year_from
from energy_opt.errors import BadInput

OF_A_MOVE = (
    "start", "goal", "start_pose", "goal_pose", "path", "duration", "max_duration", "cycle", "idle_power", "payload",
)  # fmt: skip
EXITS = {"solved": 0, "infeasible": 3, "not_converged": 4, "interrupted": 130}


def run_job_front(args: argparse.Namespace, times: list[float] | None) -> int:
    """Run the verb for a job at cycle times [s], chosen by the program where None; returns the exit code."""
    from energy_opt.cli.interrupt import stop_on_interrupt
    from energy_opt.cli.progress import Progress
    from energy_opt.cli.view import view
    from energy_opt.files import plain, read_text
    from energy_opt.front.request import guard, request_of_job
    from energy_opt.front.rivals import robust_of
    from energy_opt.job import load_job
    from energy_opt.job.models import mean_of, stated
    from energy_opt.job.over_time import document, over_time
    from energy_opt.job.over_time_output import write
    from energy_opt.poses.given import poses_of_request

    given = next((name for name in OF_A_MOVE if getattr(args, name) is not None), None)
    if given is not None or args.via or args.via_pose or args.free:
        raise BadInput(f"--{(given or 'via').replace('_', '-')} is of one move; {args.job} has its own")
    worth = per_year_from(args)
    cell = cell_of(args)
    outside = args.allow_outside
    job = load_job(args.job, lambda n: load_robot_of(args, n), allow_outside=outside, named=poses_of_request(cell))
    (rivals, kind), settings = rivals_of(args, job.robot), settings_of(args)
    named: dict[str, Any] = {"limits": args.limits, "cell": cell.document(), "durations": times}
    named |= {} if worth is None else {"per_year": worth.document()}
    named |= {"robust": robust_of(rivals, kind)}
    request = request_of_job(args.job, job.robot, rivals[0].model, settings, **named, command=args.command)
    guard(args.out / "tradeoff.json", request, args.force)
    with stop_on_interrupt() as stopped, Progress(args) as progress:
        points, shortest = over_time(
            job, mean_of(rivals), settings, cell=cell, times=times, stopped=stopped, progress=progress,
            restated=lambda result: result if kind is None else stated(result, rivals),
        )  # fmt: skip
        found = {**document(job, points, shortest, stopped()), "request": plain(request)}
        if worth is not None:
            bend = found["knee"] or found["minimum"] or {}
            row: dict[str, Any] = next((row for row in found["points"] if row["duration"] == bend.get("duration")), {})
            plain_way = row.get("evenly_slowed")
            found["per_year"] = worth.of(None if plain_way is None else plain_way - row["energy_total"])
        write(args.out, found)
    view(args, args.out)
    if args.json:
        sys.stdout.write(read_text(args.out / "tradeoff.json"))
    elif not args.quiet:
        print(_text(found, args.out))
    if found["status"] == "infeasible":
        say(args, f"no cycle time asked for can be done; the shortest that can is {shortest:.6g} s")
    return EXITS[found["status"]]


def _text(found: dict[str, Any], out: Path) -> str:
    from energy_opt.power.per_year import per_year_words

    lines = [f"{'cycle [s]':>10} {'energy [J]':>14} {'evenly slowed':>14} {'fastest, wait':>14}  status"]
    for row in found["points"]:
        joules = (row["energy_total"], row.get("evenly_slowed"), row.get("fastest_then_wait"))
        cells = [f"{'-' if value is None else format(value, '.2f'):>14}" for value in joules]
        lines.append(f"{row['duration']:>10.3f} {' '.join(cells)}  {row['status']}")
    lines.append(f"shortest cycle: {found['fastest']:.4g} s")
    if found["knee"] is not None:
        knee = found["knee"]
        lines.append(f"knee: {knee['duration']:.4g} s, {knee['energy_total']:.5g} J")
    if "per_year" in found:
        lines.append(per_year_words(found["per_year"], found["request"]["per_year"]["cycles_per_year"]))
    return "\n".join([*lines, f"files in {out}"])
