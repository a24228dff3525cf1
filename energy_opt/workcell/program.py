"""A cell's plan for its controllers: one file per robot, read back and judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from energy_opt import formats
from energy_opt.errors import BadInput
from energy_opt.formats import FORMATS, Format
from energy_opt.formats.cycle import write_cycle
from energy_opt.formats.judging import CycleJudging, Judging
from energy_opt.formats.output import Written, unchanged, wanted
from energy_opt.formats.program import Part, joined
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.robot import Robot, robot_named
from energy_opt.workcell.arm import Arm
from energy_opt.workcell.file import MOTORS, WorkCell
from energy_opt.workcell.motion import PeriodicMotion
from energy_opt.workcell.run import CellResult

BRIEF = 1e-7  # [s] shorter waits are rounding errors


def formats_of(
    cell: WorkCell, names: Sequence[str], path: Path, load: Callable[[str], Robot], allow_outside: bool
) -> dict[str, list[Format]]:
    """The formats that fit each arm of a cell, by the robot's name.

    Args:
        cell: its robots. names: of the formats. path: the job file. load: loads a robot from its name or URDF.
        allow_outside: URDFs may lie outside of the file's folder.

    Raises:
        BadInput: one is unknown, or fits no arm of the cell.
    """
    known = {
        table.name: load(robot_named(table.robot, path.parent, allow_outside)).n
        for table in cell.robot
        if table.robot is not None and names
    }
    out: dict[str, list[Format]] = {name: [] for name in known}
    for name in dict.fromkeys(names):
        faults = []
        for robot, joints in known.items():
            try:
                out[robot] += wanted([name], joints)
            except BadInput as error:
                faults.append(error)
        if len(faults) == len(known):
            raise faults[0] if faults else BadInput(f"--write {name}: no robot of this cell is known as an arm")
    return out


def write_programs(
    result: CellResult, forms: Mapping[str, Sequence[Format]], out: Path, rate: float | None = None, prefix: str = ""
) -> list[Written]:
    """Write `cycle_<robot>.csv` of every arm, and its cycle as a program in each of several formats.

    Args:
        forms: by the robot's name.
        rate, prefix: as in `formats.cycle.write_cycle`.

    Returns:
        The files; the record of each has its robot, and `starts_at`: the begin of the robot's cycle [s] after that of
        the first robot.
    """
    files: list[Written] = []
    for r, (arm, motion) in enumerate(zip(result.arms, result.planned.motions, strict=True)):
        if arm is None or motion is None:
            continue
        ring = result.schedule.problem.rings[r]
        modes = dict(zip((step.name for step in ring.steps), result.schedule.modes[r], strict=True))
        parts, judge = _parts(arm, motion, modes), _judging(arm, motion)
        stem = f"cycle_{arm.name.replace('/', '_')}"
        cycle = joined([part.trajectory for part in parts])
        file = out / f"{stem}.csv"
        formats.write(cycle, file)
        written = [unchanged(file, FORMATS["csv"], cycle, judge(cycle))]
        for form in forms.get(arm.name, ()):
            if form.name != "csv" or rate is not None:
                written += write_cycle(parts, judge, [form], out, rate, prefix, stem)
        files += [replace(one, about={"robot": arm.name, "starts_at": motion.begin}) for one in written]
    return files


def _parts(arm: Arm, motion: PeriodicMotion, modes: dict[str, str]) -> list[Part]:
    """Moves and waits in order, each with its payload and the mode of waiting."""
    out = []
    for part in motion.parts:
        if part.duration < BRIEF:
            continue
        mode = modes[part.name]
        out.append(
            Part(
                part.trajectory,
                f"{part.name}, at {part.start:.3f} s of the cell's cycle",
                bool(mode),
                mode if mode != MOTORS else "",
                arm.step_of(part.name).payload,
            )
        )
    return out


def _judging(arm: Arm, motion: PeriodicMotion) -> CycleJudging:
    """The judge of an arm's cycle: every part under the payload of its step."""
    limits = joint_limits(arm.job.robot.limits)
    return CycleJudging.of(
        (part.duration, Judging(arm.worker.scorers.of(arm.step_of(part.name)), limits, arm.cell))
        for part in motion.parts
    )
