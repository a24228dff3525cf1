"""`log.toml`: the runs of a set, their columns, properties of the meter, and the cutting of recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints, model_validator

from energy_opt.errors import BadInput
from energy_opt.files import inside, read_toml
from energy_opt.measured.columns import COMBINED, PRESETS, Rule, rule_from
from energy_opt.measured.layout import Csv, layout_of
from energy_opt.schema import Number, Table, parse

FORMAT = "energy-opt/log/1"
NAME = "log.toml"
Text = Annotated[str, StringConstraints(strict=True, min_length=1)]  # a file's name or path


class RunEntry(Table):
    """One [[run]] table.

    Attributes:
        start: the set time of the run's time 0, s; None where the log does not say.
        power_file: the meter's own file. power_start: that file's time 0 (its first stamp, where stamps are dates or
            beyond an hour) on the run's clock, s; None is estimated.
        energy: total energy of the run, J, if only that is known.
    """

    file: Text
    kind: Literal["motion", "static"] = "motion"
    start: Number | None = None
    power_file: Text | None = None
    power_start: Number | None = None
    energy: Annotated[Number, Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _one_source_of_power(self) -> RunEntry:
        if self.power_start is not None and self.power_file is None:
            raise ValueError(f"power_start = {self.power_start:g} without a power_file; it is that file's clock")
        if self.energy is not None and self.power_file is not None:
            raise ValueError("energy and power_file; give the run's total or the meter's readings")
        return self


class MeterTable(Table):
    """The meter: window [s] of the mean in a reading."""

    window: Annotated[Number, Field(ge=0, le=3600)] | None = None


class SegmentTable(Table):
    """Where recordings are cut."""

    at: Literal["standstill"]


class LogTable(Table):
    """log.toml as it is written; `columns` are read by `rule_from`."""

    format: Literal["energy-opt/log/1"]
    robot: Text
    run: list[RunEntry] = []
    columns: str | dict[str, Any] = {}
    segment: SegmentTable | None = None
    preset: Any = None
    csv: Csv = Csv()
    meter: MeterTable = MeterTable()


@dataclass(frozen=True)
class LogFile:
    """Content of log.toml.

    Attributes:
        path: the file itself; runs are found beside it.
        robot: a robot's name or a URDF's path, as written.
        standstill: True if every recording is cut at standstill.
        csv: format of the tables, if stated. window: of the meter's mean, s, None if not stated.
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
    found = parse(LogTable, read_toml(path, "log"), str(path))
    if not found.run:
        raise BadInput(f"{path}: no [[run]] table; a set has one for every run")
    files = [run.file for run in found.run]
    twice = next((name for name in files if files.count(name) > 1), None)
    if twice is not None:
        raise BadInput(f"{path}: file {twice!r} is in two [[run]] tables")
    preset, rules = _columns(found, path)
    log = LogFile(
        path, found.robot, tuple(found.run), preset, rules, found.segment is not None, found.csv, found.meter.window,
        allow_outside,
    )  # fmt: skip
    for entry in found.run:
        for name in (entry.file, entry.power_file):
            if name is not None:
                log.file(name)
    return log


def _columns(found: LogTable, path: Path) -> tuple[str | None, dict[str, Rule]]:
    """The preset's name and the rule of every quantity that the log itself describes."""
    table = {"preset": found.columns} if isinstance(found.columns, str) else found.columns
    preset = table.get("preset", found.preset)
    if preset is not None and (not isinstance(preset, str) or preset not in PRESETS):
        raise BadInput(f"{path}: preset = {preset!r}; known: {', '.join(PRESETS)}")
    rules: dict[str, Rule] = {}
    for key, value in table.items():
        if key == "preset":
            continue
        if isinstance(value, dict) and not {*COMBINED, "unit"} & set(value) and "." not in key:
            # `shoulder.position = {...}` without quotes is a nested table in TOML.
            for signal, entry in value.items():
                rules[f"{key}.{signal}"] = rule_from(f"{key}.{signal}", entry, str(path))
        else:
            rules[key] = rule_from(key, value, str(path))
    return preset, rules


def _missing(folder: Path) -> str:
    """Message on what to write if a folder has no log.toml, based on its CSV files."""
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
