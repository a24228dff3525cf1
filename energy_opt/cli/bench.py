"""`energy-opt bench`: a suite of moves, in parallel and resumable, or the comparison of two runs."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from energy_opt.cli.common import add_cell, add_lock, cell_of, locks_of
from energy_opt.cli.per_year import add_per_year, per_year_from
from energy_opt.cli.view import add_view
from energy_opt.errors import BadInput

MOST_JOBS = 1024  # on one machine


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("suite", nargs="?", type=Path, metavar="SUITE.toml", help="what to run")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where results go (default: bench_<suite>)")
    parser.add_argument("--jobs", type=int, metavar="N", help="processes on this machine (default: one per free core)")
    parser.add_argument("--resume", action="store_true", help="do what an earlier run into --out left")
    parser.add_argument("--force", action="store_true", help="overwrite results of another suite or version of it")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="compute on a Dask cluster, e.g. tcp://host:8786")
    parser.add_argument(
        "--compare", nargs=2, type=Path, metavar=("OLD", "NEW"), help="two results: what got better or worse"
    )
    parser.add_argument("--compile", choices=("auto", "always", "never"), default="auto", help="node functions (auto)")
    group = parser.add_argument_group("instead of what the suite says")
    group.add_argument("--robot", metavar="NAME_OR_URDF", help="robot for every move")
    group.add_argument("--limits", type=Path, metavar="joint_limits.yaml", help="joint limits with MoveIt's keys")
    group.add_argument("--payload", metavar="MASS[,CX,CY,CZ]", help="payload [kg, m] in the last joint's frame")
    group.add_argument(
        "--model", metavar="MODEL", help="power model: a file, or source-method-1, source-method-2, careful"
    )
    add_lock(group)
    group.add_argument(
        "--deadline", type=float, metavar="S", help="end the search of each motion after S seconds (never)"
    )
    group.add_argument("--seed", type=int, metavar="N", help="seed of random moves and of the solver's starts")
    add_cell(parser)
    parser.set_defaults(self_collision=None, planner=None)  # as the suite says
    add_per_year(parser)
    parser.add_argument("--json", action="store_true", help="the summary as one JSON document on stdout")
    add_view(parser)
    parser.add_argument("--quiet", action="store_true", help="no progress and no messages")


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    if args.compare:
        if args.suite is not None:
            raise BadInput("--compare takes two results and no suite")
        return _compare(args)
    if args.suite is None:
        raise BadInput("no suite: give SUITE.toml, or --compare OLD NEW")
    return _batch(args)


def _compare(args: argparse.Namespace) -> int:
    from energy_opt.bench import compare, comparison_text
    from energy_opt.files import to_json

    found = compare(*args.compare)
    sys.stdout.write(to_json(found) if args.json else comparison_text(found) + "\n")
    return 0


def _batch(args: argparse.Namespace) -> int:
    from energy_opt.bench import load_suite, run_batch
    from energy_opt.cli.progress import Progress
    from energy_opt.cli.view import view
    from energy_opt.files import to_json
    from energy_opt.front.request import stamp

    jobs = _free_cores() if args.jobs is None else args.jobs
    if not 1 <= jobs <= MOST_JOBS:
        raise BadInput(f"--jobs {str(jobs)[:24]}: expected 1 to {MOST_JOBS} processes")
    if args.seed is not None and args.seed < 0:
        raise BadInput(f"--seed {args.seed}: expected a whole number, 0 or above")
    worth = per_year_from(args)
    suite = load_suite(
        args.suite, overrides=_overrides(args), seed=args.seed, compile=args.compile,
        allow_outside=args.allow_outside, allow_large=args.allow_large,
    )  # fmt: skip
    out = args.out or Path(f"bench_{suite.name}")
    with Progress(args) if args.verbose and not args.quiet else nullcontext():
        batch = run_batch(
            suite, out, jobs=jobs, resume=args.resume, force=args.force, scheduler=args.scheduler, quiet=args.quiet,
            command=stamp(args.command)["command"], worth=worth,
        )  # fmt: skip
    if batch.left_out and not args.quiet:
        print(f"{batch.left_out} earlier results belong to another version of the suite; left out", file=sys.stderr)
    view(args, out)
    sys.stdout.write(to_json(batch.summary) if args.json else _text(batch.summary, out))
    if batch.interrupted and not args.quiet:
        print(f"interrupted; what is done is in {out}, --resume does what is left", file=sys.stderr)
    if batch.interrupted:
        return 130
    return 0 if batch.summary["status"].get("solved") else 4


def _overrides(args: argparse.Namespace) -> dict[str, Any]:
    out: dict[str, Any] = {}
    if args.robot is not None:
        path = Path(args.robot)
        out["robots"] = [str(path.resolve()) if path.is_file() else args.robot]
    if args.limits is not None:
        out["limits"] = str(args.limits.resolve())
    if args.model is not None:
        path = Path(args.model)
        out["models"] = [str(path.resolve()) if path.is_file() else args.model]
    if args.payload is not None:
        out["payloads"] = [args.payload]
    if args.deadline is not None:
        out["settings"] = {"deadline": args.deadline}
    if args.lock:
        out["lock"] = locks_of(args)
    return out | _surroundings(args)


def _surroundings(args: argparse.Namespace) -> dict[str, Any]:
    """Body and cell in a suite's words, as far as options say them."""
    from energy_opt.bench.surroundings import KEYS

    usual = {"self_collision": args.self_collision or "on", "planner": args.planner or "auto"}
    request = cell_of(argparse.Namespace(**{**vars(args), **usual}))
    out = {key: value for key, value in request.document().items() if key in KEYS}
    if args.self_collision is not None:
        out["self_collision"] = request.self_collision
    if args.planner is not None:
        out["planner"] = request.planner
    for key, file in (("scene", request.scene), ("srdf", request.srdf)):
        if file is not None:
            out[key] = str(file.resolve())
    if request.package_dirs:
        out["package_dirs"] = [str(folder.resolve()) for folder in request.package_dirs]
    return out


def _free_cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _text(summary: dict[str, Any], out: Path) -> str:
    """The summary as a short table."""
    from energy_opt.power.per_year import per_year_words

    status = ", ".join(f"{count} {name}" for name, count in sorted(summary["status"].items()))
    lines = [f"{summary['suite']}: {sum(summary['status'].values())} of {summary['moves']} moves: {status or 'none'}"]
    for row in summary["failures"][:10]:
        lines.append(f"  {row['robot']} {row['move']} {row['mode']} {row['timing']}: {row['status']}: {row['error']}")
    if len(summary["failures"]) > 10:
        lines.append(f"  ... and {len(summary['failures']) - 10} more, in report.html")
    if summary["savings"]:
        lines.append("loss saved against the same path at the same duration [%]:")
        lines.append(f"  {'':44s} {'moves':>6} {'mean':>7} {'worst':>7} {'median':>7} {'best':>7}")
    for row in summary["savings"]:
        label = " ".join(str(row[n]) for n in ("robot", "mode", "objective", "model", "payload", "timing") if row[n])
        found = row["loss_percent"]
        numbers = " ".join(
            f"{found[name]:7.2f}" if found[name] is not None else f"{'-':>7}"
            for name in ("mean", "worst", "median", "best")
        )
        lines.append(f"  {label:44s} {found['count']:6d} {numbers}")
    if "per_year" in summary:
        lines.append(per_year_words(summary["per_year"], summary["per_year"]["cycles_per_year"]))
    lines.append(f"{summary['run']['moves_per_second']:.3g} moves/s; results in {out}")
    return "\n".join(lines) + "\n"
