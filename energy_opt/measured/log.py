"""`log.toml`: which runs a set has, where their columns are, and whether a recording is cut."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from energy_opt.errors import BadInput
from energy_opt.files import read_text, read_toml
from energy_opt.measured.columns import PRESETS, Rule, rule_from

FORMAT = "energy-opt/log/1"
KINDS = ("motion", "static")
NAME = "log.toml"


@dataclass(frozen=True)
class RunEntry:
    """One [[run]] table; `start` is the set time of the run's time 0 [s], None where the log does not say."""

    file: str
    kind: str
    start: float | None = None
    power_file: str | None = None


@dataclass(frozen=True)
class LogFile:
    """What log.toml says.

    Attributes:
        path: the file itself; runs are found beside it.
        robot: a robot's name or a URDF's path, as written.
        standstill: True where every recording is cut at standstill.
    """

    path: Path
    robot: str
    runs: tuple[RunEntry, ...]
    preset: str | None = None
    rules: Mapping[str, Rule] = field(default_factory=dict)
    standstill: bool = False


def read_log(folder: Path) -> LogFile:
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
    unknown = sorted(set(document) - {"format", "robot", "run", "columns", "segment", "preset"})
    if unknown:
        raise BadInput(f"{path}: unknown key {unknown[0]!r}; expected format, robot, [[run]], [columns], [segment]")
    robot = document.get("robot")
    if not isinstance(robot, str) or not robot:
        raise BadInput(f"{path}: robot = {robot!r}; expected a robot's name or the path of a URDF file")
    rows = document.get("run", [])
    if not isinstance(rows, list) or not rows:
        raise BadInput(f"{path}: no [[run]] table; a set has one for every run")
    runs = tuple(_entry(row, f"{path}: [[run]] {k}") for k, row in enumerate(rows, start=1))
    files = [run.file for run in runs]
    twice = next((name for name in files if files.count(name) > 1), None)
    if twice is not None:
        raise BadInput(f"{path}: file {twice!r} stands in two [[run]] tables")
    preset, rules = _columns(document, path)
    return LogFile(path, robot, runs, preset, rules, _segment(document.get("segment"), path))


def _entry(row: Any, where: str) -> RunEntry:
    if not isinstance(row, dict):
        raise BadInput(f"{where}: not a table")
    unknown = sorted(set(row) - {"file", "kind", "start", "power_file"})
    if unknown:
        raise BadInput(f"{where}: unknown key {unknown[0]!r}; expected file, kind, start, power_file")
    for key in ("file", "power_file"):
        if key in row and (not isinstance(row[key], str) or not row[key]):
            raise BadInput(f"{where}: {key} = {row[key]!r}; expected a file's name")
    if "file" not in row:
        raise BadInput(f"{where}: file is missing")
    kind = row.get("kind", "motion")
    if kind not in KINDS:
        raise BadInput(f"{where}: kind = {kind!r}; expected one of {', '.join(KINDS)}")
    start = row.get("start")
    if start is not None and (
        isinstance(start, bool) or not isinstance(start, (int, float)) or not math.isfinite(start)
    ):
        raise BadInput(f"{where}: start = {start!r}; expected a time, s")
    return RunEntry(row["file"], kind, None if start is None else float(start), row.get("power_file"))


def _columns(document: dict[str, Any], path: Path) -> tuple[str | None, dict[str, Rule]]:
    table = document.get("columns", {})
    if isinstance(table, str):
        table = {"preset": table}
    if not isinstance(table, dict):
        raise BadInput(f"{path}: columns is not a table")
    preset = table.get("preset", document.get("preset"))
    if preset is not None and preset not in PRESETS:
        raise BadInput(f"{path}: preset = {preset!r}; known: {', '.join(PRESETS)}")
    rules: dict[str, Rule] = {}
    for key, value in table.items():
        if key == "preset":
            continue
        if isinstance(value, dict) and not {"column", "product"} & set(value):
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
    tables = sorted(p.name for p in folder.glob("*.csv"))
    if not tables:
        return f"{folder}: no {NAME} and no CSV file; a measured set is a folder with a {NAME} and a CSV file per run"
    header = read_text(folder / tables[0]).splitlines()[:1]
    rtde = bool(header) and "actual_q_0" in header[0]
    robot = "ur5e" if rtde else "panda"
    lines = [f'format = "{FORMAT}"', f'robot = "{robot}"', "[[run]]", f'file = "{tables[0]}"', 'kind = "motion"']
    if rtde:
        lines += ["[columns]", 'preset = "ur_rtde"', "[segment]", 'at = "standstill"']
    return (
        f"{folder}: no {NAME}; write one there that says, line by line: {' | '.join(lines)} (robot: the arm's own name)"
    )
