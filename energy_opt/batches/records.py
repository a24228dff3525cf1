"""Records of a batch's results: their columns, and how they are written as a table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypedDict

from energy_opt.batches.task import Task
from energy_opt.errors import BadInput
from energy_opt.files import replacing

# Column: type. Energies in J, durations and seconds in s, savings in percent against "scaled" (the same duration);
# energy_<baseline> is the total of a baseline, loss_<baseline> its loss; max_violation a fraction of the bound.
MOST_RECORDS, MOST_BYTES = 10**6, 2 * 10**8  # of a results.parquet that is read
COLUMNS: dict[str, str] = {
    "suite": "string",
    "robot": "string",
    "move": "string",
    "mode": "string",
    "status": "string",
    "duration": "double",
    "energy_total": "double",
    "energy_standby": "double",
    "energy_stored": "double",
    "energy_loss": "double",
    "energy_toppra": "double",
    "loss_toppra": "double",
    "duration_toppra": "double",
    "energy_scaled": "double",
    "loss_scaled": "double",
    "saving_total_percent": "double",
    "saving_loss_percent": "double",
    "max_violation": "double",
    "iterations": "int64",
    "build_seconds": "double",
    "solve_seconds": "double",
    "error": "string",
    "objective": "string",
    "model": "string",
    "payload": "string",
    "timing": "string",
    "minimum_time": "double",
    "optimality": "string",
    "gap_percent": "double",
    "key": "string",
}
TIMES = ("build_seconds", "solve_seconds")  # the columns that differ from run to run
IDENTITY = ("suite", "robot", "move", "mode", "timing", "payload", "model", "objective")

Row = dict[str, Any]


class Record(TypedDict):
    """What a worker hands back for one task: its key, its row, its process and the memory it holds [bytes]."""

    key: str
    row: Row
    worker: dict[str, Any]


def identity(task: Task) -> Row:
    """A row that says which task it is and nothing else yet."""
    row: Row = dict.fromkeys(COLUMNS)
    row |= {
        "suite": task.suite,
        "robot": task.robot.name,
        "move": task.move,
        "mode": task.mode,
        "objective": task.objective,
        "model": task.model,
        "payload": task.payload_label,
        "timing": task.timing.label,
        "key": task.key,
    }
    return row


def failed(task: Task, reason: str) -> Record:
    """The record of a move that came to nothing."""
    row = {**identity(task), "status": "failed", "error": " ".join(reason.split())}
    return {"key": task.key, "row": row, "worker": {}}


def filled(row: Row, document: Mapping[str, Any]) -> Row:
    """`row` with what a result's document (CONTRACT's result.json) says."""
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
    for baseline in document["baselines"]:
        name = baseline["name"]
        for column, value in (
            (f"energy_{name}", baseline["energy"]["total"]),
            (f"loss_{name}", baseline["energy"]["loss"]),
            (f"duration_{name}", baseline["duration"]),
        ):
            if column in COLUMNS:
                out[column] = value
    saving = document.get("saving") or {}
    for name in ("total_percent", "loss_percent"):
        out[f"saving_{name}"] = saving.get(name)
    return out


def write_parquet(path: Path, records: Iterable[Row]) -> None:
    """Write the records as a Parquet table, whole or not at all."""
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
            raise BadInput(f"{path}: unpacks to more than {MOST_RECORDS:,} rows or {MOST_BYTES / 1e6:g} MB")
        table = pq.read_table(path, columns=[name for name in about.schema.to_arrow_schema().names if name in COLUMNS])
    except (OSError, pa.ArrowException) as error:
        raise BadInput(f"{path}: cannot be read as Parquet: {str(error).splitlines()[0]}") from None
    missing = [name for name in COLUMNS if name not in table.column_names]
    if missing:
        raise BadInput(f"{path}: column {missing[0]} is missing; not a results.parquet of this program")
    records: list[Row] = table.to_pylist()
    return records
