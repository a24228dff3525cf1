"""Records of a batch's results: their columns, their journal, and the table at the end."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, TypedDict

from energy_opt.batches.task import Task
from energy_opt.errors import BadInput
from energy_opt.files import plain, replacing
from energy_opt.folders import files_of_earlier_runs, no_folder_in_the_way, no_foreign_files, no_other_verb

MOST_RECORDS, MOST_BYTES = 10**6, 2 * 10**8  # largest results.parquet that is read
# Columns of text, and all columns. Energies in J, durations and seconds in s, savings in percent against "scaled" (the
# same duration); energy_<baseline> is a baseline's total, loss_<baseline> its loss; max_violation a share of the bound.
TEXTS = "suite robot move mode status error objective model payload timing optimality key"
ALL = """suite robot move mode status
duration energy_total energy_standby energy_stored energy_loss energy_toppra loss_toppra duration_toppra energy_scaled
loss_scaled saving_total_percent saving_loss_percent max_violation iterations build_seconds solve_seconds error
objective model payload timing minimum_time optimality gap_percent key"""
COLUMNS: dict[str, str] = {
    name: "string" if name in TEXTS.split() else "int64" if name == "iterations" else "double" for name in ALL.split()
}
TIMES = ("build_seconds", "solve_seconds")  # the columns that differ from run to run
IDENTITY = ("suite", "robot", "move", "mode", "timing", "payload", "model", "objective")

Row = dict[str, Any]


class Record(TypedDict):
    """A worker's answer for one task: its key, its row, its process and the memory it uses [bytes]."""

    key: str
    row: Row
    worker: dict[str, Any]


def identity(task: Task) -> Row:
    """A row with only the identity of its task."""
    row: Row = dict.fromkeys(COLUMNS)
    row |= {name: getattr(task, name) for name in ("suite", "move", "mode", "objective", "model", "key")}
    return row | {"robot": task.robot.name, "payload": task.payload_label, "timing": task.timing.label}


def failed(task: Task, reason: str) -> Record:
    """The record of a move that failed."""
    row = {**identity(task), "status": "failed", "error": " ".join(reason.split())}
    return {"key": task.key, "row": row, "worker": {}}


def filled(row: Row, document: Mapping[str, Any]) -> Row:
    """`row` with the values of a result's document (result.json)."""
    energy, certificate = document["energy"], document["certificate"]
    violations = [value for value in certificate["max_violation"].values() if value is not None]
    out = {
        **row,
        "status": document["status"],
        "error": None if document["status"] == "solved" else document.get("message"),
        "duration": document["duration"],
        **{f"energy_{part}": energy[part] for part in ("total", "standby", "stored", "loss")},
        "max_violation": max(violations, default=None),
        "iterations": document["solver"]["iterations"],
        **{name: document["solver"][name] for name in TIMES},
        "optimality": document["optimality"]["kind"],
        "gap_percent": document["optimality"].get("gap_percent"),
    }
    for beside in document["baselines"]:
        values = {"energy": beside["energy"]["total"], "loss": beside["energy"]["loss"], "duration": beside["duration"]}
        columns = {f"{kind}_{beside['name']}": value for kind, value in values.items()}
        out |= {column: value for column, value in columns.items() if column in COLUMNS}
    saving = document.get("saving") or {}
    for name in ("total_percent", "loss_percent"):
        out[f"saving_{name}"] = saving.get(name)
    return out


def write_parquet(path: Path, records: Iterable[Row]) -> None:
    """Write the records as a Parquet table, completely or not at all."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    types = {"string": pa.string(), "double": pa.float64(), "int64": pa.int64()}
    schema = pa.schema([(name, types[kind]) for name, kind in COLUMNS.items()])
    with replacing(path) as aside:
        pq.write_table(pa.Table.from_pylist(list(records), schema=schema), aside)


def read_parquet(path: Path) -> list[Row]:
    """Records of a results.parquet.

    Raises:
        BadInput: no such file, not Parquet, or not a table of results.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        about = pq.read_metadata(path)
        groups = range(about.num_row_groups)
        if about.num_rows > MOST_RECORDS or sum(about.row_group(k).total_byte_size for k in groups) > MOST_BYTES:
            raise BadInput(f"{path}: its unpacked size is above {MOST_RECORDS:,} records or {MOST_BYTES / 1e6:g} MB")
        table = pq.read_table(path, columns=[name for name in about.schema.to_arrow_schema().names if name in COLUMNS])
    except (OSError, pa.ArrowException) as error:
        raise BadInput(f"{path}: cannot be read as Parquet: {str(error).splitlines()[0]}") from None
    missing = [name for name in COLUMNS if name not in table.column_names]
    if missing:
        raise BadInput(f"{path}: column {missing[0]} is missing; not a results.parquet of this program")
    records: list[Row] = table.to_pylist()
    return records


FORMAT = "energy-opt/results/1"
NAME = "results.jsonl"


def read_journal(path: Path) -> tuple[dict[str, Any], list[Record], int]:
    """Header, records in the order of writing, and the length [bytes] of the complete lines.

    An incomplete last line is ignored; {} and no records if not even the header is complete.

    Raises:
        BadInput: not a journal, or a line before the last that is not JSON.
    """
    content = Path(path).read_bytes()
    whole = content.rfind(b"\n") + 1
    lines = content[:whole].splitlines()
    records: list[Any] = []
    for number, line in enumerate(lines, start=1):
        try:
            records.append(json.loads(line))
        except ValueError:
            if number < len(lines):
                raise BadInput(f"{path}: row {number}: not a line of JSON; the journal is damaged") from None
            whole -= len(line) + 1
    if not records:
        return {}, [], 0
    if not isinstance(records[0], dict) or records[0].get("format") != FORMAT:
        raise BadInput(f"{path}: row 1: not a journal of results ({FORMAT})")
    return records[0], records[1:], whole


def finished(folder: Path) -> bool:
    """True if `folder` contains a finished batch."""
    try:
        return bool(json.loads((folder / "summary.json").read_text(encoding="utf-8"))["complete"])
    except (OSError, ValueError, KeyError, TypeError):
        return False


class Journal:
    """An open journal; only one process can open it."""

    def __init__(self, folder: Path, header: Mapping[str, Any], *, resume: bool, force: bool = False) -> None:
        """Open `folder`/results.jsonl; a new one unless `resume`.

        Raises:
            BadInput: another process writes there, or an unfinished batch is there and `resume` is False, or the
                results of another suite, of an earlier version of this one, or of another verb, and `force` is False.
        """
        self.path = Path(folder) / NAME
        no_folder_in_the_way(self.path.parent, NAME)
        if not force:
            no_other_verb(self.path.parent, NAME)
            no_foreign_files(self.path.parent, NAME)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stream: IO[bytes] = self.path.open("ab")
        except OSError as error:
            raise BadInput(f"{self.path}: cannot be written: {error.strerror}") from None
        try:
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._stream.close()
            raise BadInput(f"{self.path}: another batch is writing there; choose another --out") from None
        try:
            self.records = self._records_to_continue(header, resume, force)
        except BaseException:
            self.__exit__()
            raise

    def _records_to_continue(self, header: Mapping[str, Any], resume: bool, force: bool) -> list[Record]:
        """The records that a resumed run continues from; none for a new run, whose journal starts empty.

        Raises:
            BadInput: the journal holds results that neither `resume` nor `force` allows to continue or to overwrite.
        """
        old, records, whole = read_journal(self.path)
        if records and not force and old.get("suite") != header.get("suite"):
            raise BadInput(
                f"{self.path}: holds {len(records)} results of the suite {old.get('suite')!r}; "
                "choose another --out, or add --force to overwrite them"
            )
        if records and not resume and not finished(self.path.parent):
            raise BadInput(
                f"{self.path}: holds {len(records)} results of an unfinished batch; "
                "add --resume to run the remaining moves, or choose another --out"
            )
        if records and not resume and not force and old.get("digest") != header.get("digest"):
            raise BadInput(
                f"{self.path}: holds {len(records)} results of the suite {old.get('suite')!r} as it was, with other "
                "moves, models or settings; choose another --out, add --resume to keep those that still fit, "
                "or add --force to overwrite them"
            )
        if resume and old:
            os.ftruncate(self._stream.fileno(), whole)
            return records
        for path in files_of_earlier_runs(self.path.parent, NAME) - {self.path}:
            path.unlink(missing_ok=True)
        os.ftruncate(self._stream.fileno(), 0)
        self.append({"format": FORMAT, **header})
        return []

    def append(self, record: Record | Mapping[str, Any]) -> None:
        """Write one record to the disk.

        Raises:
            BadInput: it is full; the records before are kept.
        """
        try:
            self._stream.write(json.dumps(plain(record), allow_nan=False).encode() + b"\n")
            self._stream.flush()
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise BadInput(
                f"{self.path}: cannot be written: {error.strerror}; where there is room, --resume runs the other moves"
            ) from None

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # a full disk has been reported by `append`
            self._stream.close()
