"""A whole batch: runs the remaining moves of a suite, keeps each result as it arrives, and writes tables at the end."""

from __future__ import annotations

import logging
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from energy_opt.batches.executors import Solver, cluster, local, run_tasks, solve_task
from energy_opt.batches.records import NAME, Journal, Record, Row, read_journal, write_parquet
from energy_opt.batches.suite import Suite
from energy_opt.batches.summary import summarize, table, write_report
from energy_opt.errors import Infeasible
from energy_opt.files import plain, write_json
from energy_opt.power.per_year import PerYear
from energy_opt.requests.option import Request
from energy_opt.results import Found, exit_of

log = logging.getLogger(__name__)


@dataclass(frozen=True, repr=False, eq=False)
class Batch(Found):
    """A batch, finished or interrupted: the `records` of its moves, its folder `out`; by name, as `["status"]`, the
    values of summary.json.

    Attributes:
        records: of every finished move, in the order of the suite. summary: summary.json.
        interrupted: whether it stopped early; `resume` runs the remaining moves.
        left_out: number of earlier records that belong to another version of the suite.
        out: the folder of its results. request: the request, if known.
    """

    records: list[Row]
    summary: dict[str, Any]
    interrupted: bool
    left_out: int
    out: Path = Path(".")
    request: Request | None = None
    answer = NAME

    @property
    def exit_code(self) -> int:
        """The exit code of the command line."""
        if self.interrupted:
            return 130
        statuses = {name for name, moves in self.summary["status"].items() if moves}
        return Infeasible.exit_code if statuses == {Infeasible.status} else exit_of(False, "solved" in statuses)

    def document(self) -> dict[str, Any]:
        """The content of summary.json."""
        return self.summary

    def text(self, out: Path | None = None) -> str:
        """A short table for a terminal; the results are where the batch wrote them."""
        return table(self.summary, self.out)

    def kept(self, out: Path) -> Batch:
        """Copy the results into the folder `out`."""
        if out.resolve() != self.out.resolve():
            shutil.copytree(self.out, out, dirs_exist_ok=True)
        return self

    def __repr__(self) -> str:
        solved = self.summary["status"].get("solved", 0)
        return f"Batch({self.summary['suite']!r}, {solved} of {self.summary['moves']} solved, in {str(self.out)!r})"


def run_batch(
    suite: Suite,
    out: str | Path,
    *,
    jobs: int = 1,
    resume: bool = False,
    force: bool = False,
    scheduler: str | None = None,
    show: Callable[[str, float], None] = lambda text, share: None,
    solve: Solver = solve_task,
    request: Mapping[str, Any] = MappingProxyType({}),
    worth: PerYear | None = None,
) -> Batch:
    """Run the remaining moves of a suite. results.jsonl grows during the run; results.parquet, report.html and
    summary.json follow.

    Over all resumed runs, each task is done exactly once. Ctrl-C stops the workers and keeps finished moves.

    Args:
        suite: the moves. out: folder of the results.
        jobs: number of processes on this machine; not used with `scheduler`.
        resume: continue an earlier run into `out`.
        force: overwrite finished results of another suite, or of another version of this one.
        scheduler: address of a Dask cluster that computes instead.
        show: called after every move with a line for the user and the finished share of the remaining moves.
        solve: what workers do with a task; workers must be able to import it.
        request: the document of the request, for summary.json and the report.
        worth: runs of all moves per year, each once; the summary states the value of the savings.

    Raises:
        BadInput: `out` holds an unfinished batch and `resume` is False, or results of another suite or version and
            `force` is False, or the scheduler does not answer.
    """
    wanted = {task.key: task for task in suite.tasks}
    header = {"suite": suite.name, "digest": suite.digest}
    with Journal(Path(out), header, resume=resume, force=force) as journal:
        records: dict[str, Record] = {}
        for record in journal.records:
            if record["key"] in wanted:
                records.setdefault(record["key"], record)
        left_out = sum(record["key"] not in wanted for record in journal.records)
        (Path(out) / "summary.json").unlink(missing_ok=True)
        before, begin = len(records), time.monotonic()
        place = partial(cluster, scheduler) if scheduler else partial(local, jobs)
        left = [task for task in suite.tasks if task.key not in records]
        log.info("%d moves to do, %d known; starting %s", len(left), len(records), scheduler or f"{jobs} processes")
        interrupted, failed = False, 0
        try:
            for record in run_tasks(left, place, solve):
                journal.append(record)
                records[record["key"]] = record
                log.info("%s", _progress_line(record["row"]))
                failed += record["row"]["status"] != "solved"
                text = f"{len(records)}/{len(wanted)} moves" + (f", {failed} not solved" if failed else "")
                show(text, (len(records) - before) / len(left))
        except KeyboardInterrupt:
            interrupted = True
            for record in read_journal(journal.path)[1]:  # it may be on disk but not yet in `records`
                if record["key"] in wanted:
                    records.setdefault(record["key"], record)
        found = [records[key]["row"] for key in wanted if key in records]
        seconds, count = time.monotonic() - begin, len(records) - before
        run = {
            "jobs": None if scheduler else jobs,
            "scheduler": scheduler,
            "seconds": seconds,
            "moves": count,
            "moves_per_second": count / max(seconds, 1e-9),
            "command": request.get("command"),
        }
        log.info("writing results.parquet, report.html and summary.json")
        asked = {"request": plain(request)} if request else {}
        summary = {**summarize(suite.name, found, len(wanted), run, worth), **asked}
        write_parquet(Path(out) / "results.parquet", found)
        write_report(Path(out) / "report.html", found, summary)
        write_json(Path(out) / "summary.json", summary)
    return Batch(found, summary, interrupted, left_out, Path(out))


def _progress_line(row: Row) -> str:
    """A finished move as a line: its name, its status, and the seconds of building and solving."""
    named = " ".join(str(row[name]) for name in ("robot", "move", "mode", "timing") if row[name])
    times = [
        f"{kind} {row[f'{kind}_seconds']:.2f} s" for kind in ("build", "solve") if row[f"{kind}_seconds"] is not None
    ]
    return ", ".join([f"{named}: {row['status']}", *times, *([str(row["error"])] if row["error"] else [])])
