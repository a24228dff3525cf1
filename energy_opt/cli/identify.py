"""`energy-opt identify`: overhead and copper loss from static poses, by the two methods of the source paper."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from energy_opt.cli.common import add_cell, add_lock, add_output, cell_of, locks_of, payload_from, say
from energy_opt.errors import BadInput

if TYPE_CHECKING:
    import numpy as np

    from energy_opt.identify import Identification
    from energy_opt.robot import PointMass, Robot


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("set", type=Path, nargs="?", metavar="DIR", help="the measured set: a folder with a log.toml")
    parser.add_argument("--suggest", type=int, metavar="N", help="propose N static poses that would tell most")
    parser.add_argument("--robot", metavar="NAME_OR_URDF", help="the robot (default: the one that log.toml names)")
    parser.add_argument("--limits", type=Path, metavar="FILE", help="joint limits (MoveIt's joint_limits.yaml)")
    add_lock(parser)
    parser.add_argument("--payload", metavar="MASS[,CX,CY,CZ]", help="payload held in the poses [kg, m]")
    add_cell(parser)
    add_output(parser, "identify")


def run(args: argparse.Namespace) -> int:
    """Run the verb; returns the exit code."""
    from energy_opt.robot import load_robot

    if args.set is None and args.suggest is None:
        raise BadInput("identify needs a measured set (DIR), or --suggest N with --robot")
    robot = load_robot(args.robot, limits=args.limits, lock=locks_of(args)) if args.robot else None
    mass = _mass(args.payload)
    if args.suggest is not None:
        return _suggest(args, robot, mass)
    return _identify(args, robot, mass)


def _mass(text: str | None) -> PointMass | None:
    if text is None:
        return None
    from energy_opt.robot import PointMass

    effect = payload_from(text)
    return PointMass(float(effect.values["mass"][0]), effect.values["com"])


def _identify(args: argparse.Namespace, robot: Robot | None, mass: PointMass | None) -> int:
    from energy_opt.cli.progress import Progress
    from energy_opt.cli.view import view
    from energy_opt.files import read_text, write_json
    from energy_opt.folders import written_whole
    from energy_opt.front.request import guard, request_of_set
    from energy_opt.identify import identify, poses_of
    from energy_opt.measured import read_log, read_set
    from energy_opt.measured.sets import robot_of
    from energy_opt.reports.identify import page

    arm = robot or robot_of(read_log(args.set, args.allow_outside), args.limits, locks_of(args))
    with Progress(args) as show:
        show.stage("reading", 0.0, 1.0)
        measured = read_set(args.set, arm, allow_outside=args.allow_outside)
    for remark in measured.remarks:
        say(args, f"note: {remark}")
    given = {"payload": args.payload, "limits": args.limits, "command": args.command}
    request = request_of_set(args.set, measured.robot, args.seed, **given)
    guard(args.out / "identify.json", request, args.force)
    result = identify(measured.robot.name, poses_of(measured, mass))
    document = {**result.document(), "request": request}
    second = result.model_2()
    with written_whole(args.out, "identify.json") as aside:
        result.model_1().save(aside / "model_method1.toml")
        if second is not None:
            second.save(aside / "model_method2.toml")
        write_json(aside / "identify.json", document)
        _plot(result, aside / "plot.png")
        load, power = [pose.load for pose in result.poses], [pose.power for pose in result.poses]
        page(document, load, power, result.robot).write(aside / "report.html")
    say(args, _summary(result, args.out))
    view(args, args.out)
    if args.json:
        sys.stdout.write(read_text(args.out / "identify.json"))
    return 0


def _plot(result: Identification, path: Path) -> None:
    import numpy as np

    from energy_opt.reports.plots import COLOURS, labelled, legend_beside, new_figure, save

    figure, axes = new_figure(1, 1, width=9.5, height=4.2)
    at = labelled(axes[0, 0], "|gravity torque|^2 [(N m)^2]", "static power [W]", f"{result.robot}: static poses")
    load = np.array([p.load for p in result.poses])
    at.plot(load, [p.power for p in result.poses], "o", color=COLOURS[0], label="poses")
    ends = np.array([0.0, load.max() * 1.05])
    at.plot(ends, np.full(2, result.standby), "--", color=COLOURS[5], label=f"Method 1: {result.standby:.2f} W")
    if result.line is not None:
        r, p0 = result.line["r_over_kt2"], result.line["standby"]
        label = f"Method 2: {p0:.2f} W + {r:.4g} W/(N m)^2, R^2 = {result.line['r_squared']:.3f}"
        at.plot(ends, p0 + r * ends, color=COLOURS[1], label=label)
    legend_beside(at)
    save(figure, path)


def _summary(result: Identification, out: Path) -> str:
    lines = [f"{len(result.poses)} poses", f"Method 1: overhead {result.standby:.2f} W"]
    if result.line is not None:
        ci = result.line["ci95"]
        lines.append(
            f"Method 2: overhead {result.line['standby']:.2f} W [{ci['standby'][0]:.2f}, {ci['standby'][1]:.2f}], "
            f"R/Kt^2 {result.line['r_over_kt2']:.4g} W/(N m)^2 [{ci['r_over_kt2'][0]:.4g}, {ci['r_over_kt2'][1]:.4g}], "
            f"R^2 = {result.line['r_squared']:.3f}"
        )
    if result.word:
        lines.append(result.word)
    lines.append(f"written: {out}")
    return "\n".join(lines)


def _suggest(args: argparse.Namespace, robot: Robot | None, mass: PointMass | None) -> int:
    from energy_opt.cell.load import load_cell
    from energy_opt.files import to_json, write_table
    from energy_opt.identify import suggest
    from energy_opt.measured import read_log
    from energy_opt.measured.sets import robot_of

    if robot is None:
        if args.set is None:
            raise BadInput("identify --suggest needs --robot, or a set whose log.toml names one")
        robot = robot_of(read_log(args.set, args.allow_outside), args.limits, locks_of(args))
    cell = load_cell(robot, cell_of(args))
    found = suggest(robot, args.suggest, args.seed, mass, None if cell is None else cell.free)
    path = args.out / "suggested_poses.csv"
    header = [*(f"{joint}.position" for joint in robot.joints), "gravity_torque_squared"]
    columns = [*found.poses.T, found.load]
    _keep(path, header, columns, args.force)
    write_table(path, header, columns)
    say(
        args,
        f"{path}: {args.suggest} poses, |gravity torque|^2 from {found.load.min():.4g} to {found.load.max():.4g} "
        f"(N m)^2; r_over_kt2 to +-{found.width:.3g} W/(N m)^2 per watt of spread about the line",
    )
    if args.json:
        sys.stdout.write(
            to_json({"robot": robot.name, "joints": list(robot.joints), "poses": found.poses, "load": found.load})
        )
    return 0


def _keep(path: Path, header: list[str], columns: list[np.ndarray], force: bool) -> None:
    """Refuse to overwrite other poses, unless forced."""
    from energy_opt.files import read_table

    if force or not path.is_file():
        return
    held = read_table(path)
    if list(held) != header or any(list(held[name]) != list(x) for name, x in zip(header, columns, strict=True)):
        raise BadInput(f"{path} holds other poses; choose another --out, or overwrite it with --force")
