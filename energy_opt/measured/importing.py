"""Import of a lab's files as a measured set: they are copied, and a log.toml states what was guessed."""

from __future__ import annotations

import difflib
import re
import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.files import write_toml
from energy_opt.folders import no_other_verb, written_whole
from energy_opt.measured.columns import ByHand, given_names, quoted, understood
from energy_opt.measured.guess import (
    Guess,
    guess_joints,
    guess_meter,
    guess_robot,
    in_one_unit,
    is_motion,
    same_columns,
)
from energy_opt.measured.log import FORMAT, NAME, read_log
from energy_opt.measured.names import joint_columns
from energy_opt.measured.run import Run, cut_at_standstill, is_at_rest
from energy_opt.measured.sets import collect
from energy_opt.measured.table import Table
from energy_opt.numerics.stamps import EPOCH
from energy_opt.robot import Robot

FEW = 6  # from this number of files on, recordings are not cut: each file is assumed to be one run


@dataclass(frozen=True)
class Imported:
    """An imported set: its robot, log as written, and what was guessed and found, one sentence each."""

    robot: Robot
    log: dict[str, Any]
    words: tuple[str, ...]
    remarks: tuple[str, ...]
    runs: tuple[Run, ...]


def import_files(
    files: Sequence[Path], out: Path, robot: Robot | None = None, replace: bool = False, hand: ByHand | None = None
) -> Imported:
    """Make a measured set of files; nothing is written on failure.

    Args:
        files: tables of joints (with or without power) and of meters, in any order.
        out: the set's folder.
        robot: the robot of the joints; None to find it by columns and torques.
        replace: True to replace an existing set.
        hand: columns that are named by hand.

    Raises:
        BadInput: a file is not usable or its columns are not understood, with file, row and column; or the folder holds
            a set, or results.
    """
    if not replace:
        no_other_verb(out, NAME)
        if (out / NAME).exists():
            raise BadInput(f"{out}: holds a measured set already; choose another --out, or add --force")
    tables = [Table(path) for path in _without_repeats(files)]
    hand = (hand or ByHand()).with_units_moved(tables, robot)
    words: list[str] = []
    moving = [table for table in tables if robot is not None or is_motion(table)]
    if robot is None:
        if not moving:
            raise BadInput(f"{tables[0].path}: no file has positions of joints; name the arm with --robot")
        robot, why = guess_robot(moving[0])
        words.append(f"robot: {robot.name} ({why})")
    joints, meters = _joints_and_meters(tables, robot, hand)
    if not joints:
        raise BadInput(
            f"{tables[0].path}: no file has a column for the position of every joint of {robot.name}; expected "
            f"{', '.join(robot.joints)} in any order, found {quoted(tables[0].header)} (another robot's? Else name "
            "the columns with --joint JOINT=COLUMN)"
        )
    first_joint, first_meter = next(iter(joints.values())), next(iter(meters.values()), None)
    same_columns({str(t.path): g for t, g in joints.items()})
    same_columns({str(t.path): g for t, g in meters.items()})
    for table, guess in [*list(joints.items())[:1], *list(meters.items())[:1]]:
        words += [_layout_words(table), *guess.words]
        words += [] if guess.preset else [understood(table, guess.columns)]
    known = {key.rpartition(".")[2] for key in [*first_joint.columns, *(first_meter.columns if first_meter else ())]}
    if not known & {"power", "energy", "current", "effort"} and first_joint.preset is None:
        table, guess = next(iter(joints.items()))
        said = f"no column of power, energy, currents or torques in any file; {understood(table, guess.columns)}"
        raise BadInput(f"{table.path}: {said}")
    pairs = _pairs(joints, meters, words)
    simulated = ["declared.toml", "truth.toml"] if (out / "truth.toml").is_file() else []  # of a set that is replaced
    with written_whole(out, NAME, simulated) as folder:
        document = _document(robot.named_in(folder), first_joint, first_meter, joints, pairs)
        for table in tables:
            shutil.copyfile(table.path, folder / table.path.name)
        for again in (False, True):  # which runs are static is known after the first reading
            write_toml(folder / NAME, document)
            runs, _, faults, remarks = collect(read_log(folder), robot)
            if faults:
                raise BadInput("\n".join(_with_original_path(fault, folder, tables) for fault in faults))
            if not again:
                _kinds(document, runs, words)
    return Imported(robot, document, tuple(words), tuple(remarks), tuple(runs))


def _without_repeats(files: Sequence[Path]) -> list[Path]:
    """The files without repeats.

    Raises:
        BadInput: two files have the same name, or one is a log.toml.
    """
    out = list(dict.fromkeys(Path(path) for path in files))
    names = [path.name for path in out]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise BadInput(f"{twice}: two files of this name; a set's files lie in one folder, so rename one")
    if NAME in names:
        raise BadInput(f"{NAME}: is written by the import; give the tables only")
    return out


def _joints_and_meters(
    tables: Sequence[Table], robot: Robot, hand: ByHand
) -> tuple[dict[Table, Guess], dict[Table, Guess]]:
    """Sort the files into those with the robot's joints and those of meters."""
    joints: dict[Table, Guess] = {}
    meters: dict[Table, Guess] = {}

    def of_meter(table: Table) -> Guess:
        spans = [guess.last - guess.first for guess in joints.values()]
        return guess_meter(table, robot, float(np.median(spans)) if spans else None, hand)

    has = {
        table: "position" in joint_columns(table.header, robot, given_names(table)) or hand.positions(table, {})
        for table in tables
    }
    for table in sorted(tables, key=lambda t: not has[t]):
        if table.faults:
            raise BadInput(table.faults[0])
        if has[table]:
            joints[table] = guess_joints(table, robot, hand)
        else:
            meters[table] = of_meter(table)
        if table.faults:
            raise BadInput(table.faults[0])
    _refuse_unsure(joints, robot)
    return in_one_unit(joints, lambda table: guess_joints(table, robot, hand)), in_one_unit(meters, of_meter)


def _refuse_unsure(joints: Mapping[Table, Guess], robot: Robot) -> None:
    """Refuse angles whose unit is not clear: those of other joints have one in which they would hardly move.

    Where most angles of a table are clear, the others have their unit, and a line says so.

    Raises:
        BadInput: names the columns that no file shows to be in degrees.
    """
    shown = {column for guess in joints.values() for column, sure in guess.sure.items() if sure}
    for table, guess in joints.items():
        unsure = [column for column, sure in guess.sure.items() if not sure and column not in shown]
        rules = {key.rpartition(".")[0]: rule for key, rule in guess.columns.items() if key.endswith(".position")}
        columns = {joint: rule if isinstance(rule, str) else rule["column"] for joint, rule in rules.items()}
        units = {joint: "rad" if column in unsure else "deg" for joint, column in columns.items()}
        given = [f"{joint}={columns[joint]}:{units[joint]}" for joint in rules if columns[joint] in guess.sure]
        options = f"`--joint {' --joint '.join(map(shlex.quote, given))}`"
        if unsure and 2 * len(unsure) >= robot.slides.count(False):
            raise BadInput(
                f"{table.path}: column(s) {quoted(unsure)} may be in rad, though other angles are not; give units, "
                f"as by {options} (or :deg)"
            )
        if unsure:
            said = f"{quoted(unsure)} may be in rad, but taken to be in the unit of most angles; if wrong, {options}"
            guess.words.append(said)


def _layout_words(table: Table) -> str:
    """One line on a table's layout."""
    at = table.layout
    name = {",": "comma", ";": "semicolon", "\t": "tab", " ": "space", "|": "bar"}.get(at.delimiter, at.delimiter)
    units = ", a row of units" if at.units else ""
    sign = {".": "point", ",": "comma"}[at.decimal]
    return f"{table.path.name}: {name}-separated, decimal {sign}, data from row {at.first_row}{units}"


def _pairs(joints: dict[Table, Guess], meters: dict[Table, Guess], words: list[str]) -> dict[Table, Table]:
    """The meter's file of each file of joints: by overlap if both clocks count from 1970, else by file names."""
    if not meters:
        return {}
    out: dict[Table, Table] = {}
    for table, guess in joints.items():
        lasting = [
            m for m, g in meters.items()
            if min(guess.first, g.first) > EPOCH and min(guess.last, g.last) > max(guess.first, g.first)
        ]  # fmt: skip
        if len(meters) == 1 and (len(joints) == 1 or lasting):
            out[table] = next(iter(meters))
        elif len(lasting) == 1:
            out[table] = lasting[0]
        else:
            out[table] = max(meters, key=lambda m: _name_similarity(table.path.stem, m.path.stem))
    used = list(out.values())
    shared = next((m for m in used if used.count(m) > 1), None)
    if shared is not None and not all(g.first > EPOCH for g in [*joints.values(), meters[shared]]):
        if len(joints) == len(meters):
            order = sorted(meters, key=lambda m: m.path.name)
            out = dict(zip(sorted(joints, key=lambda t: t.path.name), order, strict=True))
        else:
            raise BadInput(
                f"{shared.path}: it is not clear to which file of joints this meter's file belongs. "
                "Name the files alike, or let both clocks count from 1970"
            )
    words += [f"pair: {t.path.name} with {m.path.name}" for t, m in out.items()]
    return out


def _name_similarity(a: str, b: str) -> float:
    """Similarity of two file names; equal numbers count most."""
    numbers = re.findall(r"\d+", a), re.findall(r"\d+", b)
    same = sum(int(x) == int(y) for x, y in zip(*(n[::-1] for n in numbers), strict=False))
    return 2.0 * same + difflib.SequenceMatcher(None, a.lower(), b.lower()).ratio()


def _document(
    robot: str, guess: Guess, meter: Guess | None, joints: dict[Table, Guess], pairs: dict[Table, Table]
) -> dict[str, Any]:
    """Content of log.toml."""
    columns: dict[str, Any] = {"preset": guess.preset} if guess.preset else {}
    columns |= guess.columns
    if meter is not None:
        columns = {key: value for key, value in columns.items() if key not in ("power", "energy")} | meter.columns
    records = []
    absolute = all(g.first > EPOCH or (g.first > 3600 and not g.dated) for g in joints.values())
    begin = min(g.first for g in joints.values())
    for table, g in sorted(joints.items(), key=lambda item: (item[1].first if absolute else 0.0, item[0].path.name)):
        row: dict[str, Any] = {"file": table.path.name, "kind": "motion"}
        if absolute and len(joints) > 1:
            row["start"] = round(g.first - begin, 6)
        if table in pairs:
            row["power_file"] = pairs[table].path.name
        records.append(row)
    return {"format": FORMAT, "robot": robot, "run": records, "columns": columns}


def _kinds(document: dict[str, Any], runs: Sequence[Run], words: list[str]) -> None:
    """Write into the document which runs are static, and whether long recordings are cut."""
    still = {run.file.partition("#")[0]: True for run in runs}
    for run in runs:
        still[run.file.partition("#")[0]] &= is_at_rest(run.time, run.position)
    for row in document["run"]:
        row["kind"] = "static" if still.get(row["file"], False) else "motion"
    motions = [sum(piece.kind == "motion" for piece in cut_at_standstill(run)) for run in runs]
    if len(document["run"]) < FEW and max(motions, default=0) > 1:
        document["segment"] = {"at": "standstill"}
        words.append("cut into runs where the arm is at rest")


def _with_original_path(fault: str, folder: Path, tables: Sequence[Table]) -> str:
    """A fault of a copied file, in the name of the original file."""
    for table in tables:
        fault = fault.replace(str(folder / table.path.name), str(table.path))
    return fault.replace(str(folder / NAME), "import")
