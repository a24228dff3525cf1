"""The page of a front: energy against duration, its optima, and the arm at any of its points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.reports.charts import Chart, Line
from energy_opt.reports.motion import Motion, Played, player
from energy_opt.reports.optimize import assumed
from energy_opt.reports.page import Report
from energy_opt.reports.words import energy_words, least_of, yearly
from energy_opt.robot import Robot


def page(
    document: Mapping[str, Any], motions: Mapping[float, Motion], robot: Robot, cell: Cell | None = None
) -> Report:
    """The report of a tradeoff.json.

    Args:
        motions: trajectories by duration [s].
        cell: bodies for drawing the moving arm; None: the arm's own.
    """
    report = Report(f"{document['robot']}: energy against duration, {document['mode']}")
    best = document["minimum"]
    if best is not None:
        report.headline(
            f"Least {energy_words(document)}: {least_of(document, best):.4g} J at {best['duration']:.4g} s."
        )
    report.numbers(yearly(document)).warning(*document.get("warnings", ()))
    points = [p for p in document["points"] if p.get("energy_total") is not None]
    x = np.array([p["duration"] for p in points])
    lines = [
        Line(part, x, np.array([p[f"energy_{part}"] for p in points], dtype=float), "dots")
        for part in ("total", "standby", "loss", "stored")
    ]
    if "robust" in document:
        name = {"mean": "mean", "worst": "largest"}[document["robust"]["kind"]]  # short, for the legend
        lines.append(Line(name, x, np.array([p["energy_robust"] for p in points]), "dots"))
    marks = {} if best is None else {"least energy": (best["duration"], least_of(document, best))}
    cycle = document.get("cycle")
    edges = {} if document["fastest"] is None else {"fastest": document["fastest"]}
    charts = [Chart("Energy of the move", "duration [s]", "energy [J]", lines, marks=marks, edges=edges, pictured=True)]
    charts.append(Chart("Loss: the part that can be changed", "duration [s]", "energy [J]", lines[2:3]))
    if cycle is not None:
        inside = [p for p in points if p.get("cycle")]
        over = np.array([least_of(document, p["cycle"]) for p in inside], dtype=float)
        at = np.array([p["duration"] for p in inside])
        least, title = cycle["minimum"], f"Energy over the cycle of {cycle['length']:g} s, waiting included"
        marks = {} if least is None else {"least over the cycle": (least["duration"], least_of(document, least))}
        lines = [Line("cycle", at, over, "dots")]
        charts.append(Chart(title, "duration of the move [s]", "energy [J]", lines, marks=marks, pictured=True))
    report.charts(*charts)
    chosen = min(motions, key=lambda d: abs(d - best["duration"])) if best is not None and motions else None
    played = [Played(f"{d:.4g} s", motion, shown=d == chosen) for d, motion in sorted(motions.items())]
    if played:
        report.section("Motion at any point of the front").player(player(robot, played, cell))
    columns = {"total [J]": "total", "loss [J]": "loss", "saved against evenly slowed [J]": "saving_joules"}
    report.models("The front's minimum under other models", document.get("models"), columns)
    assumed(report, document)
    columns = {"duration [s]": "duration", "total [J]": "energy_total", "standby [J]": "energy_standby"}
    columns |= {"loss [J]": "energy_loss", "status": "status", "reason": "reason"}
    report.section("Points").records(({"reason": "", **p} for p in document["points"]), columns)
    return report.command(document.get("request"))
