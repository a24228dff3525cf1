"""Results as they come: one JSON line per move, on disk before the next is asked for, readable after any death."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from energy_opt.batches.records import Record
from energy_opt.errors import BadInput
from energy_opt.files import plain
from energy_opt.results import earlier, no_folder_in_the_way, no_other_verb

FORMAT = "energy-opt/results/1"
NAME = "results.jsonl"


def read_journal(path: Path) -> tuple[dict[str, Any], list[Record], int]:
    """Header, records in the order of writing, and the length [bytes] of what is whole.

    A last line that a death cut short is left out; {} and no records where not even the header is whole.

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
    """Does `folder` hold a batch that was done to the end?"""
    try:
        return bool(json.loads((folder / "summary.json").read_text(encoding="utf-8"))["complete"])
    except (OSError, ValueError, KeyError, TypeError):
        return False


class Journal:
    """An open journal; only one process can hold it."""

    def __init__(self, folder: Path, header: Mapping[str, Any], *, resume: bool, force: bool = False) -> None:
        """Open `folder`/results.jsonl; a new one unless `resume`.

        Raises:
            BadInput: another process writes there, or an unfinished batch lies there and `resume` is False, or the
                results of another suite, of an earlier version of this one, or of another verb, and `force` is False.
        """
        self.path = Path(folder) / NAME
        no_folder_in_the_way(self.path.parent, NAME)
        if not force:
            no_other_verb(self.path.parent, NAME)
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
            self.records = self._kept(header, resume, force)
        except BaseException:
            self._stream.close()
            raise

    def _kept(self, header: Mapping[str, Any], resume: bool, force: bool) -> list[Record]:
        old, records, whole = read_journal(self.path)
        if records and not force and old.get("suite") != header.get("suite"):
            raise BadInput(
                f"{self.path}: holds {len(records)} results of the suite {old.get('suite')!r}; "
                "choose another --out, or add --force to overwrite them"
            )
        if records and not resume and not finished(self.path.parent):
            raise BadInput(
                f"{self.path}: holds {len(records)} results of an unfinished batch; "
                "add --resume to do what is left, or choose another --out"
            )
        if records and not resume and not force and old.get("digest") != header.get("digest"):
            raise BadInput(
                f"{self.path}: holds {len(records)} results of the suite {old.get('suite')!r} as it was, with other "
                "moves, models or settings; choose another --out, --resume, or add --force to overwrite them"
            )
        if resume and old:
            os.ftruncate(self._stream.fileno(), whole)
            return records
        for path in earlier(self.path.parent, NAME) - {self.path}:
            path.unlink(missing_ok=True)
        os.ftruncate(self._stream.fileno(), 0)
        self._write({"format": FORMAT, **header})
        return []

    def append(self, record: Record) -> None:
        """Write one record and wait until the disk has it."""
        self._write(record)

    def _write(self, record: Mapping[str, Any]) -> None:
        self._stream.write(json.dumps(plain(record), allow_nan=False).encode() + b"\n")
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stream.close()
