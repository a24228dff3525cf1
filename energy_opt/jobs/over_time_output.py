"""What `tradeoff JOB.toml` writes: the job over its cycle time as a table, a document, a picture and a page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.files import write_json, write_text
from energy_opt.folders import written_whole
from energy_opt.reports.charts import Chart, Line
from energy_opt.reports.optimize import assumed
from energy_opt.reports.page import Report
from energy_opt.reports.words import yearly

COLUMNS = ("duration", "energy_total", "energy_standby", "energy_loss", "status")
PLAIN = ("evenly_slowed", "fastest_then_wait")


def write(out: Path, found: Mapping[str, Any]) -> None:
    """Write tradeoff.csv, plot.png, report.html and tradeoff.json, this last."""
    from energy_opt.reports import plots

    shown = [row for row in found["points"] if row["energy_total"] is not None]
    with written_whole(out, "tradeoff.json") as aside:
        records = [["" if row[name] is None else str(row[name]) for name in COLUMNS] for row in found["points"]]
        write_text(aside / "tradeoff.csv", "\n".join(",".join(row) for row in [list(COLUMNS), *records]) + "\n")
        if shown:
            time = np.array([row["duration"] for row in shown])
            parts = {name: np.array([row[f"energy_{name}"] for row in shown]) for name in ("loss", "standby")}
            figure = plots.plot_tradeoff(
                time, parts, _marks(found), fastest=found["fastest"], title="energy of the job over its cycle time",
                infeasible=[row["duration"] for row in found["points"] if row["status"] == "infeasible"],
            )  # fmt: skip
            plots.save(figure, aside / "plot.png")
        page(found, shown).write(aside / "report.html")
        write_json(aside / "tradeoff.json", found)


def _marks(found: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    knee = found["knee"]
    return {} if knee is None else {"knee": (knee["duration"], knee["energy_total"])}


def page(found: Mapping[str, Any], shown: list[dict[str, Any]]) -> Report:
    """The report."""
    report = Report(f"{found['robot']}: energy of a job over its cycle time")
    knee = found["knee"]
    if knee is not None:
        report.headline(f"Knee at a cycle of {knee['duration']:.4g} s: {knee['energy_total']:.5g} J.")
    if worth := yearly(found):
        report.numbers(worth)
    time = np.array([row["duration"] for row in shown])

    def line(name: str, column: str, style: str) -> Line:
        return Line(name, time, np.array([row.get(column) for row in shown], dtype=float), style)

    lines = [line("this plan", "energy_total", "dots")]
    lines += [line(name.replace("_", " "), name, "dash") for name in PLAIN if any(row.get(name) for row in shown)]
    report.charts(
        Chart("Energy of the cycle", "cycle time [s]", "energy [J]", lines, marks=_marks(found)),
        Chart("Standby left out", "cycle time [s]", "energy [J]", [line("this plan", "energy_loss", "dots")]),
    )
    report.table(
        ["cycle [s]", "energy [J]", "standby [J]", "evenly slowed [J]", "fastest then wait [J]", "status", "reason"],
        [
            [*(row[name] for name in COLUMNS[:3]), *(row.get(name) for name in PLAIN), row["status"], row.get("reason")]
            for row in found["points"]
        ],
        digits=6,
    )
    assumed(report, found)
    return report.command(found.get("request"))
