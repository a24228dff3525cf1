"""report.html of a batch: failures first, then savings, proxies, times, certificates, the machine."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.batches.records import IDENTITY, Row
from energy_opt.batches.summary import grouped
from energy_opt.power.per_year import per_year_words
from energy_opt.reports.charts import Chart
from energy_opt.reports.page import Report

NAMED = IDENTITY[1:]  # the suite is in the title
HEADS = {
    "timing": "timing [s, or x of the fastest]",
    "payload": "payload [kg, m]",
    "count": "moves",
    "build_seconds_longest": "longest build [s]",
    "solve_seconds_median": "solve: median [s]",
    "solve_seconds_p90": "p90 [s]",
    "solve_seconds_longest": "longest [s]",
    "solve_seconds_geometric_mean": "geometric mean [s]",
    "max_violation": "largest violation [share of the bound]",
}
LISTED = 200  # most failures on the page; all are in results.parquet


def write_report(path: Path, records: Sequence[Row], summary: dict[str, Any]) -> None:
    """Write the page.

    Args:
        path: the file. records: of the finished moves. summary: the content of summary.json.
    """
    report = Report(f"Batch {summary['suite']}")
    counts = ", ".join(f"{count} {status}" for status, count in sorted(summary["status"].items()))
    report.headline(f"{len(records)} of {summary['moves']} moves done: {counts or 'none'}.")
    saved = [row["saving_loss_percent"] for row in records if row["saving_loss_percent"] is not None]
    shares = {"of the loss saved, mean": np.mean(saved), "at worst": min(saved), "at best": max(saved)} if saved else {}
    report.numbers({name: f"{share:.3g} %" for name, share in shares.items()})
    if "per_year" in summary:
        report.text(
            f"The batch {per_year_words(summary['per_year'], summary['per_year']['cycles_per_year'])}, each move once."
        )
    if not summary["complete"]:
        report.warning("The batch is not complete; --resume runs the remaining moves.")
    _failures(report, summary["failures"])
    _savings(report, summary["savings"], records)
    if summary["proxies"]:
        report.section("Other objectives against energy")
        report.text("Additional loss if another quantity is minimised, for the same move and duration.")
        names = ("robot", "mode", "model", "timing", "objective", "pairs")
        header = (*_heads(names), "loss mean [%]", "loss most [%]", "energy mean [J]")
        report.table(
            header,
            [
                [row[name] for name in names]
                + [row["more_loss_percent"]["mean"], row["more_loss_percent"]["most"], row["more_joules_mean"]]
                for row in summary["proxies"]
            ],
        )
    report.section("Times")
    report.text("Building a problem happens once per robot and mode in each worker; solving happens for every move.")
    if summary["times"]:
        report.table(_heads(summary["times"][0]), [list(row.values()) for row in summary["times"]])
    run = summary["run"]
    report.facts(
        {
            "processes": run["jobs"],
            "scheduler": run["scheduler"],
            "moves of this run": run["moves"],
            "took [s]": run["seconds"],
            "moves per second": run["moves_per_second"],
        }
    )
    _certificates(report, summary["certificates"])
    report.section("Machine")
    machine = summary["machine"]
    report.facts({**{k: v for k, v in machine.items() if k != "versions"}, **machine["versions"]})
    report.command(run).write(path)


def _heads(names: Iterable[str]) -> list[str]:
    return [HEADS.get(name, name) for name in names]


def _failures(report: Report, failures: Sequence[dict[str, Any]]) -> None:
    """The moves that were not solved, with their reasons."""
    report.section("Not solved")
    if not failures:
        report.text("None.")
        return
    report.table(
        [*_heads(NAMED), "status", "reason"], [[r[n] for n in (*NAMED, "status", "error")] for r in failures[:LISTED]]
    )
    if len(failures) > LISTED:
        report.text(f"... and {len(failures) - LISTED} more.")


def _savings(report: Report, savings: Sequence[dict[str, Any]], records: Sequence[Row]) -> None:
    """Savings by robot, mode, objective, model, payload and timing; and charts of savings and times."""
    report.section("Savings at equal duration")
    if not savings:
        report.text("None: no move was solved.")
        return
    report.text("Against the same path at the same duration, timed by TOPP-RA and slowed evenly.")
    names = ("robot", "mode", "objective", "model", "payload", "timing")
    quantiles = ("mean", "worst", "p10", "median", "p90", "best")
    report.table(
        [*_heads(names), "moves", *(f"loss {q} [%]" for q in quantiles), "total mean [%]"],
        [
            [row[name] for name in names]
            + [row["loss_percent"]["count"], *(row["loss_percent"][q] for q in quantiles), row["total_percent"]["mean"]]
            for row in savings
        ],
    )
    charts = []
    for label, column in (("loss saved [%]", "saving_loss_percent"), ("solve time [s]", "solve_seconds")):
        spread = {}
        for key, group in grouped(records, ("robot", "mode", "objective")).items():
            data = np.array([row[column] for row in group if row[column] is not None])
            if data.size:
                spread[" ".join(key)] = data
        charts.append(Chart(f"{label.capitalize()}: each point is a move", label, "", spread=spread))
    report.charts(*charts)


def _certificates(report: Report, certificates: dict[str, Any]) -> None:
    """The number of judged trajectories, and the largest violations."""
    report.section("Worst certificates")
    report.text(
        f"{certificates['judged']} trajectories judged, {certificates['violated']} beyond a limit. "
        "A violation is a fraction of its bound; at or below zero is inside."
    )
    worst = certificates["worst"]
    if worst:
        names = (*NAMED, "status", "max_violation")
        report.table(_heads(names), [[row[name] for name in names] for row in worst])
