"""The joints' own readings on the report: a table, and friction torque against speed for every joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from energy_opt.diagnose.joints import STILL, JointSide
from energy_opt.diagnose.unmetered import JointDiagnosis
from energy_opt.reports.charts import Chart, Line
from energy_opt.reports.page import Report


def page_of_joints(result: JointDiagnosis) -> Report:
    """report.html of a set without a meter."""
    d = result.document
    report = Report(f"Diagnosis of {result.measured.path.name}: {d['verdict']}")
    report.headline(d["headline"])
    report.text(d["next_step"])
    for remark in d["remarks"]:
        report.warning(remark)
    joints_section(report, d["joint_side"], result.side)
    return report


def joints_section(report: Report, rows: Sequence[dict[str, Any]], side: JointSide) -> None:
    """What the joints' readings say beside the power, and what is measured of friction."""
    report.section("The joints' own readings")
    table = []
    for row in rows:
        words = [row[key] for key in ("own", "power", "together")]
        shown = [x for w in words for x in ((w["friction"], w["ci95"]) if w else (None, None))]
        table.append([row["joint"], row["scale"], row["scale_ci95"], row["speed"], *shown])
    what = "Kt [N m/A]" if side.unit == "A" else "reading / torque"
    report.table(
        ["joint", what, "95 %", "speed [rad/s]", "friction there [N m]", "95 %", "by the power alone", "95 %",
         "by both", "95 %"],
        table,
        digits=3,
    )  # fmt: skip
    report.charts(*_charts(rows, side))


def _charts(rows: Sequence[dict[str, Any]], side: JointSide) -> list[Chart]:
    charts = []
    for j, row in enumerate(rows):
        if row["own"] is None:
            continue
        v = side.rows.v[:, j]
        moves = np.abs(v) > STILL
        grid = np.linspace(v.min(), v.max(), 121)
        seen = [side.friction(j, abs(x)) for x in grid]
        own, wide = (np.array([s[k] for s in seen]) for k in (0, 1))
        way = np.sign(grid)
        here = np.array([side.friction(j, abs(x))[0] for x in v[moves]]) * np.sign(v[moves])
        charts.append(
            Chart(
                f"Friction of {row['joint']} by its own readings",
                "speed [rad/s]",
                "friction [N m]",
                [
                    Line("measured", v[moves], here + side.left[moves, j], "points"),
                    Line("fitted", grid, own * way, low=own * way - 2 * wide, high=own * way + 2 * wide),
                ],
            )
        )
    return charts
