"""The programs of a cell's arms: one file per robot for its controller, read back and judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from energy_opt.errors import BadInput
from energy_opt.formats import FORMATS, Format, controller_files
from energy_opt.formats.controller_files import Shares, Written, unchanged, wanted
from energy_opt.formats.controller_program import Part
from energy_opt.formats.cycle_file import certificates, write_cycle
from energy_opt.formats.judging import CycleJudging
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.trajectory import joined
from energy_opt.robot import Robot, robot_named
from energy_opt.workcell.arm import Arm
from energy_opt.workcell.between import Between
from energy_opt.workcell.file import MOTORS, WorkCell
from energy_opt.workcell.motion import PeriodicMotion
from energy_opt.workcell.solve_cell import CellResult

BRIEF = 1e-7  # [s] shorter waits are rounding errors
ROUNDS = 2  # most plans of a cell with tightened bounds: each takes as long as the first


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


def with_room(
    result: CellResult, forms: Mapping[str, Sequence[Format]], rate: float | None, again: Callable[[Shares], CellResult]
) -> CellResult:
    """The plan, or one that is planned again so that the programs of all arms hold all limits.

    Args:
        forms: by the robot's name. rate: [Hz] of their samples; None: those of the plan.
        again: plans the cell with these shares of the limits' bounds.
    """

    def certificates_of(found: CellResult) -> list[Certificate]:
        """Certificates of all programs; none of a plan that is not solved: it is not planned again."""
        every = _cycles(found) if found.solved else ()
        return [x for arm, _, parts, judge in every for x in certificates(parts, judge, forms.get(arm.name, ()), rate)]

    found, shares = controller_files.with_room(result, certificates_of, again, ROUNDS)
    if not shares or not found.solved:
        return result
    return replace(found, remarks=(controller_files.said(shares, found.energy - result.energy),))


def write_programs(
    result: CellResult, forms: Mapping[str, Sequence[Format]], out: Path, rate: float | None = None, prefix: str = ""
) -> list[Written]:
    """Write `cycle_<robot>.csv` of every arm, and its cycle as a program in each of several formats.

    Args:
        forms: by the robot's name.
        rate, prefix: as in `cycle_file.write_cycle`.

    Returns:
        The files; the record of each has its robot, and `starts_at`: the begin of the robot's cycle [s] after that of
        the first robot. None is valid of an arm that is not proven to keep apart from the others.
    """
    files: list[Written] = []
    for arm, motion, parts, judge in _cycles(result):
        stem = f"cycle_{arm.name.replace('/', '_')}"
        cycle = joined([part.trajectory for part in parts])
        file = out / f"{stem}.csv"
        FORMATS["csv"].write(cycle, file)
        own = unchanged(file, FORMATS["csv"], cycle, judge(cycle), judge.scorer.robot)
        asked = [form for form in forms.get(arm.name, ()) if form.name != "csv" or rate is not None]
        programs = [write_cycle(parts, judge, form, out, rate, prefix, stem) for form in asked]
        begins = f"; begins at {motion.begin:.3f} s of the cell's cycle"
        programs = [replace(row, text=row.text + begins) for row in programs]
        # a table whose samples break a limit at every rate has the judged samples, and their file's name
        written = [*(() if any(row.file == own.file for row in programs) else (own,)), *programs]
        r = next(k for k, table in enumerate(result.cell.robot) if table.name == arm.name)
        unproven = next((b for b in result.clearance if r in b.robots and b.verdict != "proven"), None)
        if unproven is not None:
            worst: dict[str, object] = {"limit": "clearance", "joint": unproven_words(result, unproven)}
            worst |= {"time": unproven.time, "value": None, "bound": None}
            written = [replace(one, valid=False, worst=worst) for one in written]
        files += [replace(one, about={"robot": arm.name, "starts_at": motion.begin}) for one in written]
    return files


def asked_of(files: Sequence[Written]) -> list[Written]:
    """The files that `--write` asked for: those of `write_programs` that are not only an arm's judged samples."""
    return [row for row in files if (row.format, row.text) != ("csv", FORMATS["csv"].text)]


def _cycles(result: CellResult) -> Iterator[tuple[Arm, PeriodicMotion, list[Part], CycleJudging]]:
    """The motion of every arm, its moves and waits in order, and their judge."""
    for r, (arm, motion) in enumerate(zip(result.arms, result.planned.motions, strict=True)):
        if arm is None or motion is None:
            continue
        ring, of = result.schedule.problem.rings[r], arm.worker.scorers.of
        modes = dict(zip((step.name for step in ring.steps), result.schedule.modes[r], strict=True))
        judge = CycleJudging.of((part.duration, of(arm.step_of(part.name)), arm.cell) for part in motion.parts)
        yield arm, motion, _parts(arm, motion, modes), judge


def unproven_words(result: CellResult, between: Between) -> str:
    """The arms that are not proven to keep apart, their bodies, and the time."""
    names = " and ".join(result.cell.robot[k].name for k in between.robots)
    bodies = "" if between.pair is None else f", {between.pair[0]} and {between.pair[1]}"
    return f"{names}{bodies}: {between.verdict} at {between.time or 0.0:.4g} s"


def _parts(arm: Arm, motion: PeriodicMotion, modes: dict[str, str]) -> list[Part]:
    """Moves and waits in order, each with its payload and the mode of waiting."""
    out = []
    for part in motion.parts:
        if part.duration < BRIEF:
            continue
        mode, name = modes[part.name], f"{part.name}, at {part.start:.3f} s of the cell's cycle"
        other = mode if mode != MOTORS else ""
        out.append(Part(part.trajectory, name, bool(mode), other, arm.step_of(part.name).payload))
    return out
