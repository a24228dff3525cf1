"""Output of `identify`: identify.json, the models of both methods, a plot and a page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.files import write_json
from energy_opt.folders import written_whole
from energy_opt.power import PowerModel
from energy_opt.reports.charts import Chart, Line
from energy_opt.reports.page import Report

ANSWER = "identify.json"


def write(out: Path, document: Mapping[str, Any], models: Mapping[str, PowerModel | None]) -> None:
    """Write identify.json (`document`), the models by their names, plot.png and report.html into the folder `out`."""
    with written_whole(out, ANSWER) as aside:
        for name, model in models.items():
            if model is not None:
                model.save(aside / f"{name}.toml")
        write_json(aside / ANSWER, document)
        page(document).write(aside / "report.html", aside / "plot.png")


def page(document: Mapping[str, Any]) -> Report:
    """The report of an identify.json."""
    load, power = (np.array([p[name] for p in document["poses"]]) for name in ("gravity_torque_squared", "power"))
    report = Report(f"{document['robot']}: overhead and copper loss from {len(power)} static poses")
    first, second = document["method1"], document.get("method2")
    ends = np.array([0.0, 1.05 * load.max()])
    lines = [
        Line("poses", load, power, "points", "measured"),
        Line("Method 1", ends, np.full(2, first["standby"]), "dash", "declared"),
    ]
    records: list[list[object]] = [["Method 1", first["standby"], None, None, None, None]]
    if second is not None:
        r, p0, ci = second["r_over_kt2"], second["standby"], second["ci95"]
        lines.append(Line("Method 2", ends, p0 + r * ends, "line", "calibrated"))
        records.append(["Method 2", p0, ci["standby"], r, ci["r_over_kt2"], second["r_squared"]])
        report.headline(
            f"Overhead {p0:.2f} W and copper loss {r:.4g} W/(N m)^2 by Method 2; {first['standby']:.2f} W by Method 1."
        )
    else:
        report.headline(f"Method 1: {first['standby']:.2f} W of overhead; for Method 2 the poses do not suffice.")
    report.charts(Chart("Static power", "squared gravity torque [(N m)^2]", "power [W]", lines, pictured=True))
    report.table(
        ["", "overhead [W]", "95 % [W]", "R/Kt^2 [W/(N m)^2]", "95 % [W/(N m)^2]", "R^2 of the line [1]"], records
    )
    expected = [None if second is None else p0 + r * x for x in load]
    report.section("Poses").table(
        ["pose", "squared gravity torque [(N m)^2]", "measured [W]", "Method 2 [W]"],
        [[k, x, y, e] for k, (x, y, e) in enumerate(zip(load, power, expected, strict=True), start=1)],
    )
    return report.command(document.get("request"))
