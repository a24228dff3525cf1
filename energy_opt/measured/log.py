"""`log.toml`: which runs a set has, where their columns are, what the meter does, and whether a recording is cut."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from energy_opt.errors import BadInput
from energy_opt.files import inside, read_toml
from energy_opt.measured.columns import Rule, only, rule_from
from energy_opt.measured.layout import DELIMITERS, Csv, layout_of
from energy_opt.measured.presets import PRESETS

FORMAT = "energy-opt/log/1"
KINDS = ("motion", "static")
NAME = "log.toml"


@dataclass(frozen=True)
class RunEntry:
    """One [[run]] table.

    Attributes:
        start: the set time of the run's time 0, s; None where the log does not say.
        power_file: the meter's own file. power_start: that file's time 0 (its first stamp, where stamps are dates or
            beyond an hour) on the run's clock, s; None is estimated.
        energy: all that the run took, J, where only that is known.
    """

    file: str
    kind: str
    start: float | None = None
    power_file: str | None = None
    power_start: float | None = None
    energy: float | None = None


@dataclass(frozen=True)
class LogFile:
    """What log.toml says.

    Attributes:
        path: the file itself; runs are found beside it.
        robot: a robot's name or a URDF's path, as written.
        standstill: True where every recording is cut at standstill.
        csv: how the tables are written, where the log says. window: of the meter's mean, s, None where not said.
        allow_outside: files may lie outside the set's folder.
    """

    path: Path
    robot: str
    runs: tuple[RunEntry, ...]
    preset: str | None = None
    rules: Mapping[str, Rule] = field(default_factory=dict)
    standstill: bool = False
    csv: Csv = field(default_factory=Csv)
    window: float | None = None
    allow_outside: bool = False

    def file(self, name: str) -> Path:
        """The path of a file that the log names.

        Raises:
            BadInput: it lies outside the set's folder, which has to be allowed.
        """
        try:
            return inside(self.path.parent, name, self.allow_outside)
        except BadInput as error:
            raise BadInput(f"{self.path}: file {error}") from None


def read_log(folder: str | Path, allow_outside: bool = False) -> LogFile:
    """Read the log.toml of a set (or the file itself).

    Raises:
        BadInput: names the file, the table and the key at fault; for a folder without log.toml, what to write there.
    """
    path = Path(folder)
    if path.is_dir():
        if not (path / NAME).is_file():
            raise BadInput(_missing(path))
        path = path / NAME
    document = read_toml(path)
    if document.get("format") != FORMAT:
        raise BadInput(f"{path}: format = {document.get('format')!r}; expected {FORMAT!r}")
    only(document, ("format", "robot", "run", "columns", "segment", "preset", "csv", "meter"), str(path))
    robot = document.get("robot")
    if not isinstance(robot, str) or not robot:
        raise BadInput(f"{path}: robot = {robot!r}; expected a robot's name or the path of a URDF file")
    records = document.get("run", [])
    if not isinstance(records, list) or not records:
        raise BadInput(f"{path}: no [[run]] table; a set has one for every run")
    runs = tuple(_entry(row, f"{path}: [[run]] {k}") for k, row in enumerate(records, start=1))
    files = [run.file for run in runs]
    twice = next((name for name in files if files.count(name) > 1), None)
    if twice is not None:
        raise BadInput(f"{path}: file {twice!r} is in two [[run]] tables")
    preset, rules = _columns(document, path)
    log = LogFile(
        path, robot, runs, preset, rules, _segment(document.get("segment"), path), _csv(document.get("csv", {}), path),
        _window(document.get("meter", {}), path), allow_outside,
    )  # fmt: skip
    for entry in runs:
        for name in (entry.file, entry.power_file):
            if name is not None:
                log.file(name)
    return log


def _entry(row: Any, where: str) -> RunEntry:
    if not isinstance(row, dict):
        raise BadInput(f"{where}: not a table")
    only(row, ("file", "kind", "start", "power_file", "power_start", "energy"), where)
    for key in ("file", "power_file"):
        if key in row and (not isinstance(row[key], str) or not row[key]):
            raise BadInput(f"{where}: {key} = {row[key]!r}; expected a file's name")
    if "file" not in row:
        raise BadInput(f"{where}: file is missing")
    kind = row.get("kind", "motion")
    if kind not in KINDS:
        raise BadInput(f"{where}: kind = {kind!r}; expected one of {', '.join(KINDS)}")
    start = _number(row, "start", where, "a time, s")
    power_start = _number(row, "power_start", where, "a time, s")
    energy = _number(row, "energy", where, "the run's total, J")
    if power_start is not None and "power_file" not in row:
        raise BadInput(f"{where}: power_start = {power_start:g} without a power_file; it is that file's clock")
    if energy is not None and "power_file" in row:
        raise BadInput(f"{where}: energy and power_file; give the run's total or the meter's readings")
    return RunEntry(row["file"], kind, start, row.get("power_file"), power_start, energy)


def _number(table: Mapping[str, Any], key: str, where: str, expected: str) -> float | None:
    """A number of a table, None where it is absent; strings and booleans are none."""
    value = table.get(key)
    if key not in table:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise BadInput(f"{where}: {key} = {value!r}; expected {expected}, as a number")
    return float(value)


def _csv(table: Any, path: Path) -> Csv:
    if not isinstance(table, dict):
        raise BadInput(f'{path}: csv = {table!r}; expected a table such as [csv] delimiter = ";", decimal = ","')
    only(table, ("delimiter", "decimal"), f"{path}: [csv]")
    delimiter, decimal = table.get("delimiter"), table.get("decimal")
    if delimiter is not None and (not isinstance(delimiter, str) or delimiter not in DELIMITERS):
        raise BadInput(f"{path}: [csv] delimiter = {delimiter!r}; expected one of {', '.join(map(repr, DELIMITERS))}")
    if decimal is not None and decimal not in (".", ","):
        raise BadInput(f"{path}: [csv] decimal = {decimal!r}; expected '.' or ','")
    return Csv(delimiter, decimal)


def _window(table: Any, path: Path) -> float | None:
    if not isinstance(table, dict):
        raise BadInput(f"{path}: meter = {table!r}; expected a table such as [meter] window = 0.1")
    only(table, ("window",), f"{path}: [meter]")
    window = _number(table, "window", f"{path}: [meter]", "a time, s")
    if window is not None and not 0 <= window <= 3600:
        raise BadInput(f"{path}: [meter] window = {window:g}; expected 0 to 3600 s")
    return window


def _columns(document: dict[str, Any], path: Path) -> tuple[str | None, dict[str, Rule]]:
    table = document.get("columns", {})
    if isinstance(table, str):
        table = {"preset": table}
    if not isinstance(table, dict):
        raise BadInput(f"{path}: columns is not a table")
    preset = table.get("preset", document.get("preset"))
    if preset is not None and (not isinstance(preset, str) or preset not in PRESETS):
        raise BadInput(f"{path}: preset = {preset!r}; known: {', '.join(PRESETS)}")
    rules: dict[str, Rule] = {}
    for key, value in table.items():
        if key == "preset":
            continue
        if isinstance(value, dict) and not {"column", "product", "unit"} & set(value) and "." not in key:
            # `shoulder.position = {...}` without quotes is a nested table in TOML.
            for signal, entry in value.items():
                rules[f"{key}.{signal}"] = rule_from(f"{key}.{signal}", entry, str(path))
        else:
            rules[key] = rule_from(key, value, str(path))
    return preset, rules


def _segment(table: Any, path: Path) -> bool:
    if table is None:
        return False
    if not isinstance(table, dict) or set(table) - {"at"} or table.get("at") != "standstill":
        raise BadInput(f'{path}: segment = {table!r}; expected at = "standstill"')
    return True


def _missing(folder: Path) -> str:
    """What to write where a folder has no log.toml, judged by the CSV files that lie there."""
    if (folder / "result.json").is_file() and (folder / "trajectory.csv").is_file():
        return (
            f"{folder}: a planned motion, not a measured set (no {NAME}); "
            f"`energy-opt check {folder / 'trajectory.csv'} --robot ROBOT` judges the motion"
        )
    tables = sorted(p.name for p in folder.glob("*.csv"))
    if not tables:
        return f"{folder}: no {NAME} and no CSV file; a measured set is a folder with a {NAME} and a CSV file per run"
    try:
        rtde = "actual_q_0" in layout_of(folder / tables[0]).names
    except BadInput:
        rtde = False
    robot = "ur5e" if rtde else "panda"
    lines = [f'format = "{FORMAT}"', f'robot = "{robot}"', "[[run]]", f'file = "{tables[0]}"', 'kind = "motion"']
    if rtde:
        lines += ["[columns]", 'preset = "ur_rtde"', "[segment]", 'at = "standstill"']
    return (
        f"{folder}: no {NAME}; `energy-opt import {folder}/*.csv --robot {robot} --out SET` writes one, or write it "
        f"there, line by line: {' | '.join(lines)} (robot: the arm's own name)"
    )
