"""`energy-opt optimize`: one move to minimum energy, judged, with a table, a picture and files that others read."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from energy_opt.cli.common import add_common, add_move, load_model_of, load_robot_of, move_of, say, settings_of

if TYPE_CHECKING:
    from energy_opt.motion import Result
    from energy_opt.robot import Robot


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    add_common(parser, "energy_opt_out")
    add_move(parser)
    group = parser.add_argument_group("duration (default: free)")
    group.add_argument("--duration", type=float, metavar="T", help="exactly T seconds")
    group.add_argument("--max-duration", type=float, metavar="T", help="at most T seconds")


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.cli.interrupt import stop_on_interrupt
    from energy_opt.errors import Infeasible
    from energy_opt.files import to_json, write_json
    from energy_opt.motion import Planner

    robot = load_robot_of(args)
    model = load_model_of(args, robot)
    move = move_of(args, robot, args.duration, args.max_duration)
    with stop_on_interrupt() as stopped:
        planner = Planner(robot, model, settings_of(args), stopped=stopped)
        try:
            result = planner.solve(move)
        except Infeasible as error:
            error.about = {
                "robot": robot.name,
                "joints": list(robot.joints),
                "mode": move.mode,
                "duration": move.duration,
            }
            write_json(args.out / "result.json", error.document())
            raise
        write(result, robot, args.out)
    for warning in result.warnings:
        say(args, f"warning: {warning}")
    if result.message:
        say(args, f"{result.status}: {result.message}")
    if args.json:
        sys.stdout.write(to_json(result.document()))
    elif not args.quiet:
        print(table(result, args.out))
    if result.interrupted:
        return 130
    return 0 if result.status == "solved" else 4


def write(result: Result, robot: Robot, out: Path) -> None:
    """Write result.json, trajectory.csv, trajectory.yaml, plot.png and report.html; result.json last."""
    from energy_opt import formats
    from energy_opt.files import write_json

    formats.table.write(result.trajectory, out / "trajectory.csv")
    formats.messages.write_yaml(result.trajectory, out / "trajectory.yaml")
    _picture_and_report(result, robot, out)
    write_json(out / "result.json", result.document())


def _picture_and_report(result: Result, robot: Robot, out: Path) -> None:
    from energy_opt.files import replacing
    from energy_opt.reports import plots
    from energy_opt.reports.page import Report

    t, scaled = result.trajectory, result.baseline("scaled")
    assert t.effort is not None and t.power is not None
    curve = None
    if scaled.trajectory.power is not None:
        curve = plots.Curve("scaled", scaled.trajectory.time, scaled.trajectory.power)
    names = {"result": result.energy.by_effect, "scaled": scaled.energy.by_effect}
    shown = {name: {k: v for k, v in energy.items() if k != "standby"} for name, energy in names.items()}
    figure = plots.plot_move(
        t.time, t.velocity, t.effort, t.power, joints=t.joints, velocity_limit=robot.limits.velocity,
        effort_limit=robot.limits.effort, baseline=curve, by_effect=shown,
        title=f"{result.robot}, {result.mode}, {t.duration:.3f} s",
    )  # fmt: skip
    picture = plots.png(figure)
    with replacing(out / "plot.png") as aside:
        aside.write_bytes(picture)
    worst, saving = result.certificate.worst, result.saving
    report = Report(f"{result.robot}: {result.mode} in {t.duration:.3f} s")
    for warning in result.warnings:
        report.warning(warning)
    if result.message:
        report.warning(f"{result.status}: {result.message}")
    report.section("Energy [J]").table(*_energies(result))
    report.facts({"saved, % of total": saving["total_percent"], "saved, % of loss": saving["loss_percent"]})
    report.picture(picture)
    report.section("Certificate").facts({**result.certificate.max_violation, "samples": result.certificate.samples})
    report.text(
        f"Closest to its bound: {worst['limit']} of {worst['joint']} at {worst['time']:.4g} s, "
        f"{worst['value']:.6g} of {worst['bound']:.6g}. Violations are fractions of a bound, below 0 is inside."
    )
    report.section("Solver").facts({**vars(result.solver), **result.optimality.document(), "chosen": result.chosen})
    report.write(out / "report.html")


def _energies(result: Result) -> tuple[list[str], list[list[object]]]:
    """Header and rows of the table of energies."""
    columns = [("result", result.trajectory.duration, result.energy)]
    columns += [(b.name, b.duration, b.energy) for b in result.baselines]
    header = ["", *(name for name, _, _ in columns)]
    rows: list[list[object]] = [["duration [s]", *(duration for _, duration, _ in columns)]]
    for part in ("total", "standby", "stored", "loss"):
        rows.append([part, *(getattr(energy, part) for _, _, energy in columns)])
    for effect in result.energy.by_effect:
        rows.append([f"  {effect}", *(energy.by_effect.get(effect) for _, _, energy in columns)])
    return header, rows


def table(result: Result, out: Path) -> str:
    """The short table for the terminal."""
    header, rows = _energies(result)
    lines = [f"{'energy [J]':<22}" + "".join(f"{name:>12}" for name in header[1:])]
    for name, *values in rows:
        cells = "".join(f"{value:>12.4f}" if isinstance(value, float) else f"{'-':>12}" for value in values)
        lines.append(f"{name:<22}{cells}")
    saving, worst = result.saving, result.certificate.worst

    def percent(value: float | None) -> str:
        return "-" if value is None else f"{value:.2f} %"

    lines.append(
        f"saved at equal duration: {saving['joules']:.3f} J, {percent(saving['total_percent'])} of the total, "
        f"{percent(saving['loss_percent'])} of the loss"
    )
    lines.append(
        f"worst limit: {worst['limit']} of {worst['joint']} at {worst['time']:.4g} s, {worst['value']:.6g} of "
        f"{worst['bound']:.6g} ({result.certificate.violation:+.1e} of the bound, {result.certificate.samples} samples)"
    )
    if result.optimality.lower_bound is not None:
        lines.append(
            f"{result.optimality.kind} optimum of the timing: no timing of this path takes less than "
            f"{result.optimality.lower_bound:.6f} J (gap {result.optimality.gap_percent:.1e} %)"
        )
    lines.append(f"files: {out}/result.json, trajectory.csv, trajectory.yaml, plot.png, report.html")
    return "\n".join(lines)
