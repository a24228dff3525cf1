"""The page of a cell: what each lever saves, and a Gantt chart of all robots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from energy_opt.reports.charts import Chart
from energy_opt.reports.page import Report


def page(document: Mapping[str, Any]) -> Report:
    """The report of a job.json of several robots."""
    report = Report(f"A cell of {len(document['robots'])} robots: a cycle of {document['cycle_time']:.5g} s")
    report.headline(headline(document))
    for warning in document["warnings"]:
        report.warning(warning)
    levers = document["levers"]
    first = levers[0]["energy_total"]
    report.section("What each lever saves").charts(
        Chart("Energy of the cycle", "energy [J]", "", bars={"energy": {_said(x): x["energy_total"] for x in levers}})
    )
    report.table(
        ["with", "energy of the cycle [J]", "saved [J]", "saved [%]"],
        [
            [_said(x), x["energy_total"], first - x["energy_total"], 100 * (1 - x["energy_total"] / first)]
            for x in levers
        ]
        + [
            [f"{_said(x)} alone", x["energy_total"], first - x["energy_total"], 100 * (1 - x["energy_total"] / first)]
            for x in document["levers_alone"]
        ]
        + (
            []
            if document["bound"] is None
            else [["lower bound of these curves", document["bound"], first - document["bound"], None]]
        ),
        digits=7,
    )
    for robot in document["robots"]:
        report.section(str(robot["name"])).table(
            ["step", "begins [s]", "takes [s]", "mode", "energy [J]"],
            [[s["name"], s["start"], s["duration"], s["mode"] or "moves", s["energy_total"]] for s in robot["steps"]],
            digits=6,
        )
    return report.command(document.get("request"))


def headline(document: Mapping[str, Any]) -> str:
    """One sentence: energy, bound, and what was saved."""
    total, first = document["energy_total"], document["levers"][0]["energy_total"]
    gap = document["optimality"]["gap_percent"]
    text = f"{total:.6g} J a cycle"
    if gap is not None:
        text += f", at most {gap:.2g} % above the least of these curves"
    return f"{text}; {100 * (1 - total / first):.3g} % less than at full speed." if total < first else f"{text}."


def _said(lever: Mapping[str, Any]) -> str:
    return str(lever["name"]).replace("_", " ")
